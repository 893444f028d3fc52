"""Joints of a body whose noise is a gear that their unit tells wrongly.

Before links that nobody knows exactly a body bends until only part of the errors follows the
reading, and what is left looks like noise. The scores of all residuals count what it gave way by.
"""

import numpy as np

from nico_selfmodel.estimation.diagnosis.gear_check import AS_MUCH, LEAST_SIGMAS, DoubtfulGear
from nico_selfmodel.estimation.diagnosis.score_test import ScoreTest
from nico_selfmodel.estimation.diagnosis.systematic_residuals import FEWEST_POSES
from nico_selfmodel.estimation.tree.timing.weighed_body import WeighedBody
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_solution import TreeSolution

_LARGEST_GEAR = 0.01
"""A gear that is told and off by more is no play."""


def noisy_gears(problem: TreeProblem, solution: TreeSolution) -> list[DoubtfulGear]:
    """Return gears of joints that are read worse than others, as one step of least squares asks.

    A gear counts that explains nearly as much as it and waves in the joint's angle do: what is
    uneven over a part of a turn looks like a gear there.

    Args:
        problem: What was solved.
        solution: Where it ended.
    """
    seen = problem.observations
    suspects = [
        (k, seen.noisy_joints[k][0])
        for k in sorted(solution.noise.loud)
        if seen.data.joints[seen.noisy_joints[k][0]].gear_known and not seen.unread[k]
    ]
    if not suspects or solution.joint_errors is None:
        return []
    weighed = WeighedBody.of(problem, solution)
    test = ScoreTest(weighed, weighed.slopes, weighed.fitted)
    found = []
    for k, i in suspects:
        if (solution.joint_errors[:, k] != 0.0).sum() < FEWEST_POSES:
            continue
        place = seen.data.si_readings[seen.sample, i]
        place = np.where(np.isfinite(place), place, 0.0)
        waves = np.stack([f(h * place) for h in (1.0, 2.0) for f in (np.sin, np.cos)], axis=1)
        turn = weighed.by_angle[:, :, k, None]
        gear = turn * -place[:, None, None]
        score, both = test.of(gear), test.of(np.concatenate([gear, turn * waves[:, None]], axis=2))
        step, sigma = float(score.values[0]), float(score.sigma[0])
        if is_off(step, sigma, score.gain, both.gain):
            found.append(DoubtfulGear(f"{seen.data.joints[i].name}.gear", 1.0 + step, sigma))
    return found


def is_off(step: float, sigma: float, gain: float, with_waves: float) -> bool:
    """Return whether it is a gear that is off, no play and nothing that is uneven over a turn.

    Args:
        step: By how much.
        sigma: Of that.
        gain: Fall of chi square by the gear.
        with_waves: By it and waves in the angle.
    """
    sure = abs(step) > max(_LARGEST_GEAR, LEAST_SIGMAS * sigma)
    return sure and gain > AS_MUCH * with_waves

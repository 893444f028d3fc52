"""Joints, links and poses of which so much is set aside, or off, that it is no accident."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import ANY_POSE, BodyDataset
from nico_selfmodel.dataset.body.sensors import SIGHTS
from nico_selfmodel.estimation.diagnosis.gear_check import AS_MUCH, LEAST_SIGMAS, DoubtfulGear
from nico_selfmodel.estimation.diagnosis.score_test import ScoreTest
from nico_selfmodel.estimation.diagnosis.systematic_residuals import FEWEST_POSES
from nico_selfmodel.estimation.noise.contradictions import (
    LEAST_SHARE,
    Contradictions,
    most_expected,
)
from nico_selfmodel.estimation.results.verdict import MOST_OUTLIERS, outliers_are_many
from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.timing.weighed_body import WeighedBody
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_solution import TreeSolution

_LARGEST_GEAR = 0.01
"""A gear that is told and off by more is no play."""
_TELLING = 3
"""Observations of a pose, or of a marker, from which on most of them being off is no matter of
single labels."""


def read_wrongly(
    linear: TreeLinear, seen: TreeObservations, solution: TreeSolution
) -> dict[str, tuple[int, int]]:
    """Return joints that were read wrongly in more poses than a few, of those that show them.

    Args:
        linear: Residuals at the solution.
        seen: What was seen.
        solution: Where the adjustment ended.

    Returns:
        Joint -> in how many poses, of how many.
    """
    found = {}
    for j, (i, _) in enumerate(seen.noisy_joints):
        visits = np.unique(seen.visit[linear.by_joint[:, j] != 0.0])
        slipped = solution.slipped[visits[visits < len(solution.slipped)], j]
        if not seen.unread[j] and slipped.sum() > 1 and outliers_are_many(slipped) is not None:
            found.setdefault(seen.data.joints[i].name, (int(slipped.sum()), len(slipped)))
    return found


def seen_wrongly(seen: TreeObservations, solution: TreeSolution) -> dict[str, tuple[int, int]]:
    """Return links of which more than a few observations are outliers: how many, of how many.

    Args:
        seen: What was seen.
        solution: Where the adjustment ended.
    """
    found = {}
    for i, joint in enumerate(seen.data.joints):
        own = solution.outliers[seen.data.seen_on == i]
        if own.sum() > 1 and outliers_are_many(own) is not None:
            found[joint.name] = (int(own.sum()), len(own))
    return found


def markers_elsewhere(seen: TreeObservations, outliers: NDArray) -> dict[str, tuple[int, int]]:
    """Return markers of which more observations are outliers than by chance: how many, of how many.

    Args:
        seen: What was seen.
        outliers: By row of the table. Boolean, shape (N,).
    """
    table, found = seen.data.observations, {}
    kinds = np.array([sensor.kind for sensor in seen.data.sensors])
    sights = np.isin(kinds[table.sensor], SIGHTS)
    for m, marker in enumerate(seen.data.markers):
        own, others = (outliers[sights & one] for one in (table.marker == m, table.marker != m))
        if outliers_are_many(own) is None or not len(others):
            continue
        wrong, share = int(own.sum()), min(max(float(others.mean()), LEAST_SHARE), MOST_OUTLIERS)
        if wrong >= _TELLING and wrong > most_expected(len(own), share):
            found[marker.name] = (wrong, len(own))
    return found


def contradicted_sensors(seen: TreeObservations, outliers: NDArray) -> dict[str, tuple[int, int]]:
    """Return sensors of which most observations are outliers: how many, of how many.

    Args:
        seen: What was seen.
        outliers: By row of the table. Boolean, shape (N,).
    """
    asked = ((rows.name, outliers[rows.rows]) for rows in seen.sensors)
    return {name: (int(out.sum()), len(out)) for name, out in asked if 2 * out.sum() > len(out)}


def poses_off(data: BodyDataset, off: NDArray, share: float = LEAST_SHARE) -> Contradictions:
    """Return poses of which most observations are off, of those that have a few.

    Args:
        data: The recording.
        off: Observations that nothing explains. Boolean, by row of the table, shape (N,).
        share: Of such poses that is to be expected.
    """
    pose, counts = data.observations.pose, len(data.sample)
    told = pose != ANY_POSE
    of = np.bincount(pose[told], minlength=counts)
    aside = np.bincount(pose[told & off], minlength=counts)
    asked = of >= _TELLING
    found = (2 * aside >= of)[asked]
    return Contradictions(data.sample[asked], found, most_expected(len(found), share))


def noisy_gears(problem: TreeProblem, solution: TreeSolution) -> list[DoubtfulGear]:
    """Return gears of joints that are read worse than others, as one step of least squares asks.

    Before links that nobody knows exactly a body bends until only part of the errors follows the
    reading, and what is left looks like noise. The scores of all residuals count what it gave way
    by.

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

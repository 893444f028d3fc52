"""Joints that are read wrongly now and then, and noise that is now and then large at any joint.

A joint that slips in more poses than by chance is named: what it does there is a fault. Where it
is likelier that all joints slip alike, it is noise with heavy tails. Parameters are learned beside
each slip, but a reading to come may slip as well: predictions count the variance of all that is
no fault, sigma^2 + p d^2 of slips of N(0, d^2) in a share p of the poses.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.joint_slips import FEWEST_SLIPS, all_slip_alike
from nico_selfmodel.estimation.tree.pose_tests import LOUDEST, far_observations
from nico_selfmodel.estimation.tree.tree_noise import likeliest_noise, tree_whitening
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise, TreeSolution

_MOST_SLIPS = 0.02
"""Share of poses with a wrong reading of one joint from which on it is named, `FEWEST_SLIPS` at
least."""
_LARGER = 5.0
"""Times usual joint noise that its tails reach."""


def slipping_joints(problem: TreeProblem, solution: TreeSolution) -> NDArray:
    """Return which of `TreeObservations.noisy_joints` slip more than by chance, and than others.

    Args:
        problem: What was solved.
        solution: Where it ended.

    Returns:
        Boolean, shape (m,).
    """
    seen, slipped = problem.observations, solution.slipped
    read = np.array([part == 0 for _, part in seen.noisy_joints], dtype=bool)
    often = read & (slipped.sum(axis=0) >= max(FEWEST_SLIPS, _MOST_SLIPS * len(slipped)))
    group = seen.joint_groups(solution.noise.loud)
    alike = np.isin(group, group[often]) & ~seen.unread
    if not often.any() or (alike == often).all():
        return often
    _, linear, groups, _, noise, known = problem.asking_at(solution)
    scale = noise.sensor[seen.noise_group]
    whitening = tree_whitening(seen, linear, groups, noise)
    r, J = linear.r / scale, (linear.J / scale).T
    found = solution.slipped_in(groups.numbers)
    return often & ~all_slip_alike(whitening, r, J, known, found, often, alike)


def noise_to_expect(problem: TreeProblem, solution: TreeSolution) -> TreeNoise:
    """Return what disturbs readings to come: slips that are no fault of a joint are a part of it.

    Args:
        problem: What was solved.
        solution: Where it ended.
    """
    noise, seen, slipped = solution.noise, problem.observations, solution.slipped
    aside = slipped.any() or solution.outliers.any()
    if problem.noise_known or noise.alike or not (aside and solution.variances_known):
        return noise
    off = np.zeros(slipped.shape)
    real = seen.data.visit < len(off)
    if solution.joint_errors is not None:
        np.maximum.at(off, seen.data.visit[real], np.abs(solution.joint_errors[real]))
    faults = slipped & ((off > LOUDEST * seen.moved) | slipping_joints(problem, solution))
    outliers = solution.outliers & _beyond_joint_noise(problem, solution)
    if (faults == slipped).all() and (outliers == solution.outliers).all():
        return noise
    sound = replace(solution, slipped=faults, outliers=outliers)
    joint = likeliest_noise(*problem.asking_at(sound)).joint
    return replace(noise, joint=np.maximum(noise.joint, joint))


def _beyond_joint_noise(problem: TreeProblem, solution: TreeSolution) -> NDArray:
    """Return observations that joint noise is not large enough for, were it `_LARGER` times so."""
    seen, linear, groups, slipped, noise, known = problem.asking_at(solution)
    loud = replace(noise, joint=_LARGER * noise.joint)
    slipped = np.zeros((groups.poses, len(loud.joint)), bool) if slipped is None else slipped
    whitening = tree_whitening(seen, linear, groups, loud, slipped)
    return far_observations(seen, whitening, linear, loud, known, solution.outliers, slipped)

"""Sensors of a body, or its encoders, of another moment than the rest: `diagnosis.lag_in_time`."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.sensors import SIGHTS
from nico_selfmodel.errors import SelfModelError
from nico_selfmodel.estimation.diagnosis.changes_in_time import Change
from nico_selfmodel.estimation.diagnosis.lag_in_time import Steps, lag_in_time, lag_taken_for_noise
from nico_selfmodel.estimation.diagnosis.score_test import ScoreTest
from nico_selfmodel.estimation.tree.forward.joint_errors import MOST_SLIPS
from nico_selfmodel.estimation.tree.guesses.start_search import FoundStart
from nico_selfmodel.estimation.tree.timing.weighed_body import WeighedBody
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_solution import TreeSolution
from nico_selfmodel.geometry.rotation import rotation_vectors_of
from nico_selfmodel.model.tree.body_tree import WHOLE_POSES, BodyTree


def late_sensors(
    problem: TreeProblem,
    solution: TreeSolution,
    besides: BodyDataset | None = None,
    *,
    bends: bool = False,
) -> Change | None:
    """Find sensors that lag behind the readings or lead them, and encoders that do.

    Args:
        besides: Samples of the same recording that were held out, which tell how joints moved
            between the others.
        bends: Whether the body has what bends in it, which else is granted to all joints.

    Returns:
        The lags, or None where there is none.
    """
    seen = problem.observations
    kinds = {rows.name: rows for rows in seen.sensors if rows.kind in SIGHTS and not rows.apart}
    if not solution.variances_known or not kinds:
        return None
    weighed = WeighedBody.of(problem, _as_read(solution))
    test = ScoreTest(weighed, weighed.slopes, weighed.fitted)
    tree = problem.residuals.parameters.tree_of(solution.values)
    steps = _steps(_in_order(seen.data, besides), tree, seen)
    told = {f"what {name!r} saw": np.zeros(seen.scalars, dtype=bool) for name in kinds}
    for rows in seen.sensors:
        if rows.name in kinds:
            told[f"what {rows.name!r} saw"][rows.scalars] = True
    joints = seen.data.joints
    alone = {
        joints[i].name: k
        for k, (i, _) in enumerate(seen.noisy_joints)
        if joints[i].motion not in WHOLE_POSES
    }
    late = lag_in_time(steps, test, told, alone, granted=not bends)
    if late is not None or solution.joint_errors is None:
        return late
    first = np.full(len(seen.data.sample), -1)
    first[seen.sample[::-1]] = np.arange(seen.scalars)[::-1]
    for name, k in alone.items():
        shown = np.flatnonzero((solution.joint_errors[:, k] != 0.0) & (first >= 0))
        if k in solution.noise.loud and late is None:
            errors = solution.joint_errors[shown, k]
            late = lag_taken_for_noise(steps, test, name, k, errors, first[shown])
    return late


def explained_by_lag(found: FoundStart) -> bool:
    """Return whether sensors or encoders of another moment explain what a first body does not.

    Args:
        found: The first body.
    """
    try:
        late = late_sensors(*found.refined)
    except SelfModelError:
        return False
    return late is not None and late.explains


def _as_read(solution: TreeSolution) -> TreeSolution:
    """Return a solution in which joints that slip all the time do not: they tell what is late."""
    slips = solution.slipped.mean(axis=0) <= MOST_SLIPS
    return replace(solution, slipped=solution.slipped & slips)


def _in_order(data: BodyDataset, besides: BodyDataset | None) -> tuple[NDArray, NDArray, NDArray]:
    """Return all samples in the order of time, with their readings and flanges."""
    all_of = [data]
    if besides is not None and not np.isin(besides.sample, data.sample).any():
        all_of.append(besides)
    parts = ((one.sample, one.si_readings, one.X_flange) for one in all_of)
    sample, read, X = (np.concatenate(both) for both in zip(*parts, strict=True))
    order = np.argsort(sample)
    return sample[order], read[order], X[order]


def _steps(
    moments: tuple[NDArray, NDArray, NDArray], tree: BodyTree, seen: TreeObservations
) -> Steps:
    """Return how what is read moved about each number's sample."""
    sample, read, X = moments
    place = np.zeros((len(sample), len(seen.noisy_joints)))
    moves = np.zeros((len(sample) - 1, len(seen.noisy_joints)))
    for k, (i, part) in enumerate(seen.noisy_joints):
        if tree.motions[i] not in WHOLE_POSES:
            place[:, k] = read[:, i] / tree.gear[i]
            moves[:, k] = np.diff(place[:, k])
        elif not part:  # turns in its own frame and shifts in its parent's, as derivatives are by
            R, p = X[:, i, :3, :3], X[:, i, :3, 3]
            turns = rotation_vectors_of(np.swapaxes(R[:-1], 1, 2) @ R[1:])
            place[:, k : k + 6] = np.hstack([rotation_vectors_of(R), p])
            moves[:, k : k + 6] = np.hstack([turns, np.diff(p, axis=0)])
    rows = np.searchsorted(sample, seen.data.sample)
    return Steps.of(sample, place, moves).at(rows[seen.sample])

"""Calibration of any body by any sensors: first body, adjustment, noise, error bars."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.link_joint import WORLD_NAME
from nico_selfmodel.dataset.body.sensors import DISTANCE, MarkerInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.results.folds import FOLDS, fold_of, splits
from nico_selfmodel.estimation.tree.first_guess import first_bodies
from nico_selfmodel.estimation.tree.tree_observations import SensorRows, TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem, TreeSolution
from nico_selfmodel.estimation.tree.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_setup import (
    Description,
    TreeSetup,
    Wishes,
    blank_body,
    setup_of,
)
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.tree.body_tree import WORLD, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.names import listed
from nico_selfmodel.optimization.uncertainty import Uncertainty

_AGREE = 1e-3
"""Difference of robust costs, a scalar, below which two starts reached one minimum."""


@dataclass(frozen=True, eq=False)
class TreeErrors:
    """What a body leaves of a recording."""

    observations: TreeObservations
    """What was measured."""
    residuals: NDArray
    """Predicted minus measured, in the sensors' units. Shape (R,)."""

    def of_kind(self, *kinds: str) -> NDArray:
        """Return the lengths of the residuals of some kinds of sensors; places, of poses. (N,)."""
        parts = [self._distances(rows) for rows in self.observations.sensors if rows.kind in kinds]
        return np.concatenate(parts) if parts else np.zeros(0)

    def by_row(self) -> NDArray:
        """Return the length of each observation's residual; nan where there is none. (N,)."""
        out = np.full(len(self.observations.data.observations), np.nan)
        for rows in self.observations.sensors:
            out[rows.rows] = self._distances(rows)
        return out

    def _distances(self, rows: SensorRows) -> NDArray:
        r = self.residuals[rows.scalars].reshape(len(rows.rows), -1)
        return np.asarray(np.linalg.norm(r[:, :3], axis=1))


@dataclass(frozen=True, eq=False)
class TreeCalibration:
    """A body learned from a recording, with all that it is judged by."""

    tree: BodyTree
    """The body."""
    name: str
    """Its name."""
    data: BodyDataset
    """What it was learned from."""
    setup: TreeSetup
    """What was free, what stood for the world, what held the scale."""
    parameters: TreeParameters
    """Names and values are told from these."""
    solution: TreeSolution
    """The adjustment."""
    uncertainty: Uncertainty
    """Covariance of what was free."""
    train: TreeErrors
    """Of the training data."""
    test: TreeErrors | None
    """Of held-out data."""
    cross_validation: TreeErrors | None
    """Of the training data, each pose predicted without its fold."""
    described: TreeErrors | None
    """Of the robot as described, sensors and markers placed; on the held-out data, if any."""
    label: str
    """Where the best first body came from."""
    starts: int
    """How many first bodies were tried."""
    agreeing: int
    """How many of them reached the best minimum."""
    seconds: float
    """Time taken."""
    description: Description | None = field(default=None)
    """The robot as described, where it was."""

    @cached_property
    def values(self) -> NDArray:
        """Values of all parameters. Shape (P,)."""
        return self.solution.values


def calibrate_tree(
    data: BodyDataset,
    *,
    test: BodyDataset | None = None,
    description: Description | None = None,
    lenses: Mapping[str, Camera] | None = None,
    wishes: Wishes | None = None,
    name: str | None = None,
    seed: int = 0,
) -> TreeCalibration:
    """Learn a body from all that any sensors measured of it.

    Args:
        data: The recording.
        test: Held-out data, for judging only.
        description: The robot as described: a first guess, and priors on its frames.
        lenses: Intrinsics of cameras, by name; the recording's own where they are not given.
        wishes: What the user holds, frees or knows by name.
        name: Name of the body; the recording's if omitted.
        seed: Of random starts.

    Returns:
        The calibration. A failed check does not raise: see `estimation.judging.judge`.

    Raises:
        DataError: If the recording cannot tell a first body, or nothing stands for the world.
        ValueError: If a name does not exist.
    """
    clock, wishes = time.perf_counter(), wishes or Wishes()
    observations = TreeObservations.of(data)
    blank = blank_body(data, lenses or {})
    best: _Start | None = None
    costs: list[float] = []
    for label, tree in first_bodies(data, blank, observations, description, seed):
        start = _Start.from_body(label, tree, data, observations, description, wishes)
        costs.append(start.cost)
        if best is None or start.cost < best.cost:
            best = start
        if _agreeing(costs, observations) >= 2:
            break
    assert best is not None
    return _finished(best, data, test, description, name, costs, clock)


def _agreeing(costs: list[float], observations: TreeObservations) -> int:
    return int(np.sum(np.array(costs) - min(costs) < _AGREE * observations.scalars))


@dataclass(frozen=True, eq=False)
class _Start:
    """A first body, adjusted roughly."""

    label: str
    parameters: TreeParameters
    setup: TreeSetup
    values: NDArray
    cost: float

    @classmethod
    def from_body(
        cls,
        label: str,
        tree: BodyTree,
        data: BodyDataset,
        observations: TreeObservations,
        description: Description | None,
        wishes: Wishes,
    ) -> "_Start":
        """Adjust a first body, bearings before pixels where it comes from a description."""
        base = tree if description is None else _base_of(description, tree)
        parameters = TreeParameters(base)
        setup = setup_of(data, parameters, description, wishes)
        values = parameters.values_of(tree)
        for name, value in setup.fixed.items():
            values[parameters.index[name]] = value
        if description is not None and tree.lenses:
            rays = TreeResiduals(observations.as_bearings(tree.lenses), parameters)
            inside = _inside_lenses(parameters)
            arms = {f"{j}.{p}" for j in tree.joints for p in ("rx", "ry", "rz", "x", "y", "z")}
            for held in (inside | arms, inside):
                values = TreeProblem(rays, setup.free - held, setup.priors).rough(values)[0]
        problem = TreeProblem(TreeResiduals(observations, parameters), setup.free, setup.priors)
        values, cost = problem.rough(values)
        return cls(label, parameters, setup, values, cost)


def _base_of(description: Description, tree: BodyTree) -> BodyTree:
    """Return the described joints with the tree's markers and sensors, to tell changes from."""
    return replace(tree, X_PJ=description.tree.X_PJ)


def _inside_lenses(parameters: TreeParameters) -> frozenset[str]:
    return frozenset(parameters.names[parameters.gears.stop :])


def _finished(
    start: _Start,
    data: BodyDataset,
    test: BodyDataset | None,
    description: Description | None,
    name: str | None,
    costs: list[float],
    clock: float,
) -> TreeCalibration:
    parameters, setup = start.parameters, start.setup
    residuals = TreeResiduals(TreeObservations.of(data), parameters)
    if len(setup.free) > residuals.observations.scalars + len(setup.priors):
        raise DataError(
            f"data set {data.name!r} has {residuals.observations.scalars} numbers for "
            f"{len(setup.free)} parameters: record more poses, or fix parameters"
        )
    problem = TreeProblem(residuals, setup.free, setup.priors)
    solution = problem.refine(start.values)
    tree = parameters.tree_of(solution.values)
    if description is None:
        parameters = TreeParameters(tree)
    values = parameters.values_of(tree)
    described = None
    if description is not None:
        described = _as_described(start, data if test is None else test, setup, solution)
    return TreeCalibration(
        tree,
        name or data.name,
        data,
        setup,
        parameters,
        solution if description is not None else _told_from(solution, values),
        _uncertainty(parameters, problem, solution, values, residuals.observations),
        TreeErrors(residuals.observations, residuals.residuals(solution.values)),
        None if test is None else errors_of(tree, test),
        _cross_validated(problem, solution, residuals),
        described,
        start.label,
        len(costs),
        _agreeing(costs, residuals.observations),
        time.perf_counter() - clock,
        description,
    )


def _told_from(solution: TreeSolution, values: NDArray) -> TreeSolution:
    return replace(solution, values=values)


def errors_of(tree: BodyTree, data: BodyDataset) -> TreeErrors:
    """Return what a body leaves of a recording of its joints, markers and sensors, in any order.

    Args:
        tree: The body.
        data: The recording.

    Raises:
        DataError: If it is of another body.
    """
    data = _told_as(tree, data)
    observations = TreeObservations.of(data)
    parameters = TreeParameters(tree)
    residuals = TreeResiduals(observations, parameters)
    return TreeErrors(observations, residuals.residuals(parameters.values_of(tree)))


def _told_as(tree: BodyTree, data: BodyDataset) -> BodyDataset:
    """Return a recording with the body's markers, in its order."""
    sensors = {s.name for s in tree.sensors} | {s.name for s in data.sensors if s.kind == DISTANCE}
    known = [m.name for m in tree.markers]
    for kind, has, wants in (
        ("joints", tree.joints, data.joint_names),
        ("markers", known, [m.name for m in data.markers]),
        ("sensors", sensors, [s.name for s in data.sensors]),
    ):
        strange = [name for name in wants if name not in has]
        if strange or (kind == "joints" and tree.joints != data.joint_names):
            raise DataError(
                f"data set {data.name!r} has the {kind} {listed(strange or wants)}, the body has "
                f"{listed(sorted(has))}: both must be of one robot"
            )
    moved = np.array([*(known.index(m.name) for m in data.markers), -1])
    table = data.observations
    new = replace(table, marker=moved[table.marker], other=moved[table.other])
    names = tree.joints
    markers = tuple(
        MarkerInfo(m.name, WORLD_NAME if m.on == WORLD else names[m.on]) for m in tree.markers
    )
    return replace(data, markers=markers, observations=new)


def _as_described(
    start: _Start, data: BodyDataset, setup: TreeSetup, solution: TreeSolution
) -> TreeErrors:
    """Return the errors of the robot as described, with sensors and markers placed as they fit."""
    parameters = start.parameters
    residuals = TreeResiduals(TreeObservations.of(data), parameters)
    values = solution.values.copy()
    n = len(parameters.base.joints)
    values[: 6 * n] = 0.0
    joints = {f"{j}.{p}" for j in parameters.base.joints for p in ("rx", "ry", "rz", "x", "y", "z")}
    problem = TreeProblem(residuals, setup.free - joints, {})
    values = problem.rough(values)[0]
    return TreeErrors(residuals.observations, residuals.residuals(values))


def _uncertainty(
    parameters: TreeParameters,
    problem: TreeProblem,
    solution: TreeSolution,
    values: NDArray,
    observations: TreeObservations,
) -> Uncertainty:
    """Return the covariance of what was free; a scale that nothing tells is named."""
    count, names = len(solution.whitened), problem.free_names
    squares = (
        float(count - len(names))
        if solution.variances_known
        else float(solution.rest @ solution.rest)
    )
    scales = parameters.scales(_size(parameters.tree_of(values), observations.data), values)[
        problem.columns
    ]
    return Uncertainty.from_jacobian(names, solution.whitened, scales, squares, count)


def _size(tree: BodyTree, data: BodyDataset) -> float:
    """Return about how far a body's markers are spread [m]; 0.1 at least."""
    motion = TreeMotion.at(tree, data.si_readings, data.X_flange)
    p = np.concatenate([motion.pose_of(marker)[1] for marker in tree.markers], axis=1)
    return max(float(np.sqrt(np.var(p, axis=1).sum())), 0.1)


def _cross_validated(
    problem: TreeProblem, solution: TreeSolution, residuals: TreeResiduals
) -> TreeErrors | None:
    """Return residuals of inliers by bodies learned without their fold of poses.

    One Gauss-Newton step from the solution, by the whitened rows that are left: the rest is small.
    """
    observations = residuals.observations
    pose = observations.pose
    keep = ~solution.outliers[observations.row]
    rows = solution.whitened[: int(keep.sum())]
    prior = solution.whitened[int(keep.sum()) :]
    if len(np.unique(pose)) < 2 * FOLDS:
        return None
    out = residuals.residuals(solution.values)
    white = solution.rest
    fold = fold_of(pose)
    for learn, left in splits(fold):
        mine = learn[keep]
        H = rows[mine].T @ rows[mine] + prior.T @ prior
        g = rows[mine].T @ white[: len(rows)][mine] + prior.T @ white[len(rows) :]
        unit = np.sqrt(np.maximum(np.diag(H), np.finfo(float).tiny))
        step = -np.linalg.lstsq(H / np.outer(unit, unit), g / unit, rcond=1e-11)[0] / unit
        values = solution.values.copy()
        values[problem.columns] += step
        out[left] = residuals.residuals(values)[left]
    out[~keep] = np.nan
    return TreeErrors(observations, out)

"""What a body leaves of a recording: residuals by observation, of what it learned and of more."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.link_joint import coupling_of
from nico_selfmodel.dataset.body.of_tree import marker_infos
from nico_selfmodel.dataset.body.sensors import DISTANCE, POINTS, POSES, SIGHTS, TOUCHES
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.results.folds import FOLDS, Fold, cross_validate, fold_of, told_step
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_observations import SensorRows, TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_solution import TreeSolution
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.encoder_units import COUNTS, unit_size
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import FREE, Attached, BodyTree
from nico_selfmodel.model.tree.free_joints import body_alone, with_free_joints
from nico_selfmodel.names import listed

_NO_PART = 1e-6
"""Share of what a fold alone tells that is rounding."""
_SAME_RATIO = 2e-3
"""Difference of ratios that were rounded."""
_PLAIN_UNITS = tuple(unit_size(unit) for unit in ("rad", "deg", "m", "mm"))
"""Sizes of units that are no counts: such a body takes counts as the recording states them."""
_SAME_COUNT = 1e-9
"""Share by which the size of a count may differ, by rounding."""


@dataclass(frozen=True, eq=False)
class TreeErrors:
    """What a body leaves of a recording."""

    observations: TreeObservations
    """What was measured."""
    residuals: NDArray
    """Predicted minus measured, in the sensors' units. Shape (R,)."""

    @property
    def in_space(self) -> tuple[str, ...]:
        """Kinds of sensors whose errors are those in space; of touches where nothing was seen."""
        seen = any(rows.kind in SIGHTS for rows in self.observations.sensors)
        return (POINTS, POSES) if seen else TOUCHES

    def of_kind(self, *kinds: str, keep: NDArray | None = None) -> NDArray:
        """Return the lengths of the residuals of some kinds of sensors; places, of poses.

        Args:
            keep: Rows of the table that count; all if omitted. Boolean, shape (N,).

        Returns:
            Those that are known, sensor by sensor. Shape (M,).
        """
        distance = self.by_row() if keep is None else np.where(keep, self.by_row(), np.nan)
        rows = [one.rows for one in self.observations.sensors if one.kind in kinds]
        found = distance[np.concatenate(rows)] if rows else np.zeros(0)
        return found[np.isfinite(found)]

    def of_touches(self, keep: NDArray | None = None) -> dict[str, NDArray]:
        """Return by how much touches and distances are missed, by sensor [m]. Shape (M,) each.

        Args:
            keep: Rows of the table that count; all if omitted. Boolean, shape (N,).
        """
        left, found = self.by_row(), dict[str, NDArray]()
        for one in self.observations.sensors:
            rows = one.rows if keep is None else one.rows[keep[one.rows]]
            if one.kind in TOUCHES and len(rows):
                found[one.name] = left[rows]
        return found

    def by_row(self) -> NDArray:
        """Return the length of each observation's residual; nan where there is none. (N,)."""
        out = np.full(len(self.observations.data.observations), np.nan)
        for rows in self.observations.sensors:
            out[rows.rows] = self._distances(rows)
        return out

    def _distances(self, rows: SensorRows) -> NDArray:
        r = self.residuals[rows.scalars].reshape(len(rows.rows), -1)
        return np.asarray(np.linalg.norm(r[:, :3], axis=1))


def errors_of(tree: BodyTree, data: BodyDataset) -> TreeErrors:
    """Return what a body leaves of a recording of its joints, markers and sensors, in any order.

    Raises:
        DataError: If it is of another body.
    """
    tree = beside_boards(tree, data)
    data = told_as(tree, data)
    observations = TreeObservations.of(data)
    parameters = TreeParameters(tree)
    residuals = TreeResiduals(observations, parameters)
    return TreeErrors(observations, residuals.residuals(parameters.values_of(tree)))


def beside_boards(tree: BodyTree, data: BodyDataset) -> BodyTree:
    """Return a body beside the boards of a recording, and no others."""
    new = [data.joints[i].name for i in data.free_joints]
    if new == [n for n, motion in zip(tree.joints, tree.motions, strict=True) if motion == FREE]:
        return tree
    tree = body_alone(tree)
    links = (*tree.joints, *new)
    markers = tuple(
        Attached(m.name, links.index(m.on), transform(np.eye(3), np.array(m.xyz)))
        for m in data.markers
        if m.on in new
    )
    return with_free_joints(tree, tuple(new), markers)


def told_by(model: BodyModel, data: BodyDataset) -> BodyDataset:
    """Return a recording as `told_as` does, of a body that knows how its joints are read.

    Raises:
        DataError: As `told_as`, or if counts of a turn, or which way readings rise, are others.
    """
    told = told_as(model.tree, data)
    for joint, known in zip(told.joints, model.si_per_unit.tolist(), strict=True):
        own, counted = joint.si_per_unit, abs(known) not in _PLAIN_UNITS
        other = counted and abs(own / known - 1.0) > _SAME_COUNT
        if joint.encoder_unit == COUNTS and joint.is_read and other:
            raise DataError(
                f"a count of joint {joint.name!r} is {own:.6g} of what it turns or slides by in "
                f"data set {data.name!r} (rad, m), {known:.6g} where the body was learned: correct "
                "counts_per_turn or sign there, or learn the body anew"
            )
    return told


def told_as(tree: BodyTree, data: BodyDataset) -> BodyDataset:
    """Return a recording with the body's markers, in its order.

    Raises:
        DataError: If it has other joints, or markers or sensors that the body lacks, or says of
            something that another link carries it, or that it moves otherwise.
    """
    sensors = {item.name for item in (*tree.sensors, *tree.planes)} | set(tree.contacts)
    sensors |= {s.name for s in data.sensors if s.kind == DISTANCE}
    known = [m.name for m in tree.markers]
    for kind, has, wants in (
        ("joints", tree.joints, data.joint_names),
        ("markers", known, [m.name for m in data.markers]),
        ("sensors", sensors, [s.name for s in data.sensors]),
    ):
        strange = [name for name in wants if name not in has]
        touched = [s.name for s in data.sensors if s.kind in TOUCHES and s.name in strange]
        if touched:
            raise DataError(
                f"data set {data.name!r} has touches of {listed(touched)}, which the body does not "
                "know: learn it from a recording with them, or leave their rows and sensors out"
            )
        if strange or (kind == "joints" and tree.joints != data.joint_names):
            raise DataError(
                f"data set {data.name!r} has the {kind} {listed(strange or wants)}, the body has "
                f"{listed(sorted(has))}: both must be of one robot"
            )
    _refuse_other_structure(tree, data)
    known_mirrors = [mirror.name for mirror in tree.mirrors]
    if unknown := [mirror for mirror in data.mirrors if mirror not in known_mirrors]:
        raise DataError(
            f"data set {data.name!r} has reflections in {listed(unknown)}, the body knows "
            f"{listed(known_mirrors) if known_mirrors else 'no mirror'}: learn it with "
            "`nico-selfmodel calibrate mirror`"
        )
    moved = np.array([*(known.index(m.name) for m in data.markers), -1])
    table = data.observations
    new = replace(table, marker=moved[table.marker], other=moved[table.other])
    places = {m.name: m.xyz for m in data.markers if m.xyz is not None}
    return replace(data, markers=marker_infos(tree, places), observations=new)


def _refuse_other_structure(tree: BodyTree, data: BodyDataset) -> None:
    """Refuse a recording that says of joints, markers or sensors what the body knows otherwise."""
    placed = {item.name: tree.link_name(item.on) for item in (*tree.markers, *tree.sensors)}
    said = [(f"{what} {one.name!r} is", "on", one.on, placed.get(one.name))
            for what, items in (("marker", data.markers), ("sensor", data.sensors))
            for one in items]  # fmt: skip
    for joint, parent, motion in zip(data.joints, tree.parent.tolist(), tree.motions, strict=True):
        what = f"joint {joint.name!r} is"
        said.append((what, "carried by", joint.parent, tree.link_name(parent)))
        said.append((what, "", joint.motion, motion))
    for what, how, there, known in said:
        if known is not None and there != known:
            raise DataError(
                f"{what} {' '.join(filter(None, (how, there)))} in data set {data.name!r}, "
                f"{' '.join(filter(None, (how, known)))} in the body: correct dataset.yaml, or "
                "learn the body anew"
            )
    follows = coupling_of(data.joints)
    other = np.flatnonzero((np.abs(follows - tree.coupling) > _SAME_RATIO).any(axis=1))
    if len(other):
        raise DataError(
            f"joint {data.joint_names[int(other[0])]!r} follows others otherwise in data set "
            f"{data.name!r} than in the body: correct 'follows' in dataset.yaml, or learn the body "
            "anew"
        )


def cross_validate_tree(
    problem: TreeProblem, solution: TreeSolution, residuals: TreeResiduals
) -> TreeErrors | None:
    """Return residuals of inliers by bodies learned without their fold of poses.

    Returns:
        nan where an observation is an outlier, or depends on what its own fold alone tells; None
        with too few poses for folds.
    """
    observations = residuals.observations
    pose = observations.pose
    if len(np.unique(pose)) < 2 * FOLDS:
        return None

    def predict(learned: tuple[NDArray, NDArray], part: Fold) -> NDArray:
        values, told = learned
        return np.where(told, residuals.residuals(values), np.nan)[part.left]

    without = WithoutFold(problem, solution)
    out = cross_validate(fold_of(pose), without.learn, predict)
    out[solution.outliers[observations.row]] = np.nan
    return TreeErrors(observations, out)


@dataclass(frozen=True, eq=False)
class WithoutFold:
    """Bodies learned without a fold: one Gauss-Newton step from the solution, the rest is small."""

    problem: TreeProblem
    """What was solved."""
    solution: TreeSolution
    """Where it ended, with its whitened rows."""

    def learn(self, part: Fold) -> tuple[NDArray, NDArray]:
        """Return all values, shape (P,), and which scalars hang on nothing but the other folds.

        Args:
            part: A fold of the scalars that the problem has, R.

        Returns:
            Values of shape (P,), and a mask of shape (R,).
        """
        problem, solution = self.problem, self.solution
        keep = ~solution.outliers[problem.observations.row]
        count, mine = int(keep.sum()), part.rest[keep]
        own = np.column_stack([solution.whitened[:count], solution.rest[:count]])
        own = own[mine] if solution.shared is None else solution.shared.of_some(own, mine)
        prior, pull = solution.whitened[count:], solution.rest[count:]
        H = own[:, :-1].T @ own[:, :-1] + prior.T @ prior
        g = own[:, :-1].T @ own[:, -1] + prior.T @ pull
        step, open_ways = told_step(H, g, self._unit)
        values = solution.values.copy()
        values[problem.columns] += step
        return values, _told(problem, solution, open_ways)

    @cached_property
    def _unit(self) -> NDArray:
        """By which parameters compare: see `told_step`. Shape (p,)."""
        return np.sqrt(np.sum(self.solution.whitened**2, axis=0))


def _told(problem: TreeProblem, solution: TreeSolution, open_ways: NDArray) -> NDArray:
    """Return which scalars changes of what is free leave as they are. (p, e) -> boolean, (R,)."""
    if not open_ways.shape[1]:
        return np.ones(len(problem.observations.row), dtype=bool)
    J = problem.linear_at(solution.values, problem.poses).J[problem.columns]
    largest = np.abs(J).T @ np.abs(open_ways)
    return np.asarray((np.abs(J.T @ open_ways) <= _NO_PART * largest).all(axis=1))


def errors_as_described(
    problem: TreeProblem, solution: TreeSolution, seen: BodyDataset
) -> TreeErrors:
    """Return what the robot as described leaves, with sensors and markers where training has them.

    Args:
        seen: The recording that is predicted.
    """
    parameters = problem.residuals.parameters.layout
    values = solution.values.copy()
    values[: 6 * len(parameters.base.joints)] = 0.0
    values[parameters.bends] = 0.0
    held = parameters.of_joint_frames | set(parameters.names[parameters.bends])
    free = frozenset(problem.free_names) - held
    residuals = problem.residuals.erring(None)
    placed = TreeProblem(residuals, free, {}).rough(values)[0]
    return errors_of(parameters.tree_of(placed), seen)

"""Whether a body of any tree still fits what is known of it; see `health`."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.blas_threads import on_one_blas_thread
from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.sensors import SIGHTS
from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.estimation.monitoring.body_causes import body_causes, body_changes
from nico_selfmodel.estimation.monitoring.encoder_jumps import SlipSearch
from nico_selfmodel.estimation.monitoring.health import HealthReport, innovations, watched
from nico_selfmodel.estimation.monitoring.misread import ReadPoses, off_by_mended, some_of
from nico_selfmodel.estimation.noise.contradictions import (
    LEAST_SHARE,
    Contradictions,
    contradictions,
)
from nico_selfmodel.estimation.noise.hand_observations import laid_out
from nico_selfmodel.estimation.noise.pose_residuals import PoseResiduals
from nico_selfmodel.estimation.tree.compared_errors import alone_off, usual_by
from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_errors import TreeErrors, told_by
from nico_selfmodel.estimation.tree.tree_noise import noise_named
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise
from nico_selfmodel.model.noise_mixture import NoiseMixture
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import REVOLUTE
from nico_selfmodel.optimization.uncertainty import root_of

WIDER, TAIL_SHARE = 3.0, 0.05
"""A body says what noise is usual. Rarer noise is taken so many times as wide, and of so large a
share of the poses."""
_DIRECTIONS = 30
"""Of what a body is uncertain by, that count."""
_ABOUT = 100
"""Poses that a noise is taken to rest on where a body does not tell."""


@on_one_blas_thread
def check_body_health(model: BodyModel, data: BodyDataset) -> HealthReport:
    """Watch a body over new poses, in their order.

    Args:
        model: The body, with its covariance and the noise of its training.
        data: What its sensors saw of its markers since.

    Returns:
        Whether it still fits, and what changed if it does not.

    Raises:
        DataError: If the recording is of another body, or nothing saw anything.
        ModelError: If the model does not say what noise to expect.
    """
    poses, share = _seen_poses(model, data)
    noise, covariance = _with_tail(model), _shown_covariance(model, poses)
    causes = body_causes(model.tree, poses.names)
    report = watched(poses, noise, covariance, body_changes(model.tree, causes), causes, share)
    report = report.beside(_read_poses(model, data, report, covariance))
    if report.changed_at is None or not report.diagnoses:
        return report
    rows = _WhiteRows.of(model, data)
    assert rows is not None, "poses were made of them"
    slips = rows.slips(model, poses, noise, covariance, report.changed_at)
    return replace(report, diagnoses=slips.ranked(report.diagnoses))


def _read_poses(
    model: BodyModel, data: BodyDataset, report: HealthReport, covariance: NDArray
) -> ReadPoses:
    since = np.flatnonzero(data.sample == report.sample[report.changed_at or 0])
    few = some_of(int(since[0]), len(data.sample))

    def read(readings: NDArray) -> PoseResiduals | None:
        found = white_poses(model, replace(data, readings=readings).select(few))
        return None if found is None else found[0]

    units, readings = tuple(joint.encoder_unit for joint in data.joints), np.asarray(data.readings)
    off_by = off_by_mended(read, lambda p: innovations(p, report.noise, covariance), readings)
    return ReadPoses(data.joint_names, units, data.sample, readings, off_by)


def _false_share(detections: NDArray) -> float:
    """Return the share of poses with n detections that may be false, 1 - (1 - g)^n. (N,)."""
    return float(np.mean(1.0 - (1.0 - LEAST_SHARE) ** detections))


def _shown_covariance(model: BodyModel, poses: PoseResiduals) -> NDArray:
    """Return the covariance of the poses' parameters, as far as poses show it. Shape (P, P)."""
    if model.covariance is None:
        return np.zeros((len(poses.names),) * 2)
    known = model.covariance
    return _leading(poses, laid_out(known.names, known.matrix, poses.names))


def _leading(poses: PoseResiduals, covariance: NDArray) -> NDArray:
    """Return the part of a covariance that the poses show most. Shape (P, P).

    With C = L L' and A what the poses show of L, L V of the largest singular values of A: a body
    has hundreds of parameters, a recording's error by them few directions.
    """
    root = root_of(covariance)
    shown = poses.slopes.reshape(-1, len(covariance)) @ root
    vectors = np.linalg.eigh(shown.T @ shown)[1][:, -_DIRECTIONS:]
    main = root @ vectors
    return main @ main.T


def _seen_poses(model: BodyModel, data: BodyDataset) -> tuple[PoseResiduals, float]:
    """Return poses in standard deviations, and the share that holds false detections."""
    found = white_poses(model, data)
    if found is not None:
        poses, detections = found
        return poses, _false_share(detections)
    kinds = {sensor.kind for sensor in data.sensors}
    if not kinds & set(SIGHTS):
        raise DataError(f"data set {data.name!r} has nothing that a camera or tracker saw")
    raise ModelError(
        f"body {model.name!r} does not say the noise of all that saw data set {data.name!r}: learn "
        "it by `calibrate body` or `learn --head`"
    )


def _with_tail(model: BodyModel) -> NoiseMixture:
    """Return what a body's learned noise, as 1, is taken for: a core, and an unmeasured tail.

    What was learned is the second moment of both, 1 = (1 - e) s^2 + e (w s)^2.
    """
    core = float(1.0 / np.sqrt(1.0 + TAIL_SHARE * (WIDER**2 - 1.0)))
    poses = max((int(entry.get("n", 0)) for entry in model.expected.values()), default=0)
    tail = WIDER * core
    return NoiseMixture(core, core, tail, tail, TAIL_SHARE, LEAST_SHARE, poses or _ABOUT)


def body_contradictions(model: BodyModel, data: BodyDataset) -> Contradictions | None:
    """Return which poses are further off than a body and its sensors' noise explain.

    What is off on its own, as a wrong label is, does not count.

    Returns:
        None where the body does not say a sensor's noise, where boards move freely, or nothing was
        seen.

    Raises:
        DataError: If the recording is of another body.
    """
    found = None if data.free_joints else white_poses(model, data)
    if found is None:
        return None
    poses, detections = found
    covariance, share = _shown_covariance(model, poses), _false_share(detections)
    return contradictions(poses, _with_tail(model), covariance, share)


def white_poses(model: BodyModel, data: BodyDataset) -> tuple[PoseResiduals, NDArray] | None:
    """Return what a body leaves of all that saw it, but of what is off on its own.

    Coordinates and joint angles are taken in their own standard deviations, so that metres, pixels
    and turns stand side by side.

    Returns:
        Residuals by pose, noise of sensors and joints being 1, and how many detections each pose
        has; None where the body does not say the noise of all that saw it, or nothing did.

    Raises:
        DataError: If the recording is of another body.
    """
    rows = _WhiteRows.of(model, data)
    if rows is None:
        return None
    first = np.unique(rows.row, return_index=True)[1]
    detections = np.unique(rows.pose[first], return_counts=True)[1]
    return rows.poses(rows.values), detections


@dataclass(frozen=True, eq=False)
class _WhiteRows:
    """What was seen, but of what is off on its own, to be held against a body."""

    residuals: TreeResiduals
    """Of all that was seen."""
    noise: TreeNoise
    """Of it."""
    values: NDArray
    """Of the body as it was. Shape (P,)."""
    kept: NDArray
    """Scalars that count. Boolean, shape (R,)."""
    sample: NDArray
    """Number of each pose. Shape (N,)."""

    @classmethod
    def of(cls, model: BodyModel, data: BodyDataset) -> "_WhiteRows | None":
        """Take a recording; None as of `white_poses`."""
        told = told_by(model, data)
        kinds = np.array([sensor.kind for sensor in told.sensors])
        seen = TreeObservations.of(told, np.isin(kinds[told.observations.sensor], SIGHTS))
        silent = (name for name in model.tree.joints if f"{name} turn" not in model.noise)
        known = noise_named({**dict.fromkeys(silent, 0.0), **model.noise}, seen)
        if known is None or min(known.sensor, default=0.0) <= 0.0:
            return None
        parameters = TreeParameters(model.tree)
        residuals, values = TreeResiduals(seen, parameters), parameters.values_of(model.tree)
        linear = residuals.linear(values)
        aside = alone_off(TreeErrors(seen, linear.r), usual_by(linear, known, seen))
        return cls(residuals, known, values, ~aside[seen.row], data.sample)

    @property
    def row(self) -> NDArray:
        """Row of the table of each scalar that counts."""
        return np.asarray(self.residuals.observations.row[self.kept])

    @property
    def pose(self) -> NDArray:
        """Pose of each of these."""
        return np.asarray(self.residuals.observations.data.observations.pose[self.row])

    @property
    def scale(self) -> NDArray:
        """One over the noise of each of these."""
        return 1.0 / self.noise.sensor[self.residuals.observations.noise_group[self.kept]]

    def poses(self, values: NDArray) -> PoseResiduals:
        """Return poses held against a body, in standard deviations. Shape (P,)."""
        linear, scale = self.residuals.linear(values), self.scale
        white = replace(
            linear,
            r=linear.r[self.kept] * scale,
            J=linear.J[:, self.kept] * scale,
            by_joint=linear.by_joint[self.kept] * scale[:, None] * self.noise.joint,
        )
        return _stacked(white, self.pose, self.residuals.parameters.names, self.sample)

    def slips(
        self, model: BodyModel, poses: PoseResiduals, noise: NoiseMixture, covariance: NDArray,
        since: int,
    ) -> SlipSearch:  # fmt: skip
        """Return the search for slips of any size, of joints that turn."""
        tree = model.tree
        turning = (j for j, m in zip(tree.joints, tree.motions, strict=True) if m == REVOLUTE)
        turns = {f"{joint}.rz": 2.0 * np.pi for joint in turning}

        def at(column: int, change: float) -> NDArray:
            elsewhere = self.values.copy()
            elsewhere[column] += change
            return elsewhere

        def residuals(column: int, change: float, count: int) -> NDArray:
            r = self.residuals.residuals(at(column, change))[self.kept] * self.scale
            return -_laid(r, self.pose)[since : since + count]

        def slope(column: int, change: float, count: int) -> NDArray:
            J = self.residuals.linear(at(column, change)).J[column, self.kept] * self.scale
            return _laid(J, self.pose)[since : since + count]

        return SlipSearch(poses, noise, covariance, since, turns, residuals, slope)


def _stacked(
    linear: TreeLinear, pose: NDArray, names: tuple[str, ...], sample: NDArray
) -> PoseResiduals:
    """Lay scalars into the places of their poses, zeros where there are fewer."""
    by_angle = _laid(linear.by_joint, pose)
    return PoseResiduals(
        "pixels",
        names,
        _laid(-linear.r, pose),
        by_angle,
        np.zeros_like(by_angle),
        _laid(linear.J.T, pose),
        _laid(np.ones(len(pose)), pose) > 0.0,
        sample[np.unique(pose)],
    )


def _laid(values: NDArray, pose: NDArray) -> NDArray:
    """Return values of scalars by their poses. Shapes (R, ...) and (R,) -> (N, K, ...)."""
    of = np.unique(pose, return_inverse=True)[1]
    order, count = np.argsort(of, kind="stable"), np.bincount(of)
    place = np.empty(len(of), dtype=int)
    place[order] = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    out = np.zeros((len(count), int(count.max()), *values.shape[1:]))
    out[of, place] = values
    return out

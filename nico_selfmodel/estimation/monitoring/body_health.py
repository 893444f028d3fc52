"""Whether a body of any tree still fits what is known of it; see `health`."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.blas_threads import on_one_blas_thread
from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.sensors import CAMERA
from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.estimation.monitoring.body_causes import body_causes, body_changes
from nico_selfmodel.estimation.monitoring.diagnosis import ranked_causes
from nico_selfmodel.estimation.monitoring.health import HealthReport, in_turn, watched
from nico_selfmodel.estimation.noise.contradictions import LEAST_SHARE
from nico_selfmodel.estimation.noise.hand_observations import laid_out
from nico_selfmodel.estimation.noise.pose_residuals import PoseResiduals
from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_errors import told_as
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.model.noise_mixture import NoiseMixture
from nico_selfmodel.model.tree.body_model import BodyModel
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
        data: What its cameras saw of its markers since.

    Returns:
        Whether it still fits, and what changed if it does not.

    Raises:
        DataError: If the recording is of another body, or no camera saw anything.
        ModelError: If the model does not say what noise to expect.
    """
    noise = expected_body_noise(model, data)
    poses = body_poses(model, data)
    covariance = shown_covariance(model, poses)
    causes = body_causes(model.tree, poses.names)
    changes, share = body_changes(model.tree, causes), false_share(poses.dof // 2)
    report = watched(poses, noise, covariance, changes, share)
    if report.alarm_at is None or report.changed_at is None:
        return report
    since, found = in_turn(
        lambda at: ranked_causes(poses, noise, covariance, causes, at),
        report.changed_at,
        report.alarm_at,
    )
    return replace(report, changed_at=since, diagnoses=found)


def false_share(detections: NDArray) -> float:
    """Return the share of poses in which a sensor is to be expected to be wrong, 1 - (1 - g)^n.

    Args:
        detections: How many each pose has, any of which may be false, n. Shape (N,).
    """
    return float(np.mean(1.0 - (1.0 - LEAST_SHARE) ** detections))


def shown_covariance(model: BodyModel, poses: PoseResiduals) -> NDArray:
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


def expected_body_noise(model: BodyModel, data: BodyDataset) -> NoiseMixture:
    """Return the noise that new poses are expected to have.

    Raises:
        ModelError: If the model does not say it.
    """
    cameras = [model.noise.get(s.name) for s in data.sensors if s.kind == CAMERA]
    joints = [model.noise.get(name) for name in model.tree.joints]
    known = [value for value in cameras if value], [value for value in joints if value]
    if not model.tree.lenses:
        raise ModelError(
            f"body {model.name!r} has no camera, by whose pixels it would be watched: hold what "
            "trackers measured against it with `evaluate`"
        )
    if not known[0]:
        raise ModelError(
            f"body {model.name!r} does not say the noise of its cameras: learn it by `calibrate "
            "body` or `learn --head`"
        )
    sensor = float(np.sqrt(np.mean(np.square(known[0]))))
    joint = float(np.sqrt(np.mean(np.square(known[1])))) if known[1] else 0.0
    return with_tail(model, sensor, joint)


def with_tail(model: BodyModel, sensor: float, joint: float) -> NoiseMixture:
    """Return what a body's learned noise is taken for: a core, and a tail that nobody measured.

    What was learned is the second moment of both, s^2 = (1 - e) s0^2 + e (w s0)^2.
    """
    core = 1.0 / np.sqrt(1.0 + TAIL_SHARE * (WIDER**2 - 1.0))
    sensor, joint = core * sensor, core * joint
    poses = max((int(entry.get("n", 0)) for entry in model.expected.values()), default=0)
    return NoiseMixture(
        sensor, joint, WIDER * sensor, WIDER * joint, TAIL_SHARE, LEAST_SHARE, poses or _ABOUT
    )


def body_poses(model: BodyModel, data: BodyDataset) -> PoseResiduals:
    """Return what cameras saw at each sample against what the body expects, stacked.

    Args:
        model: The body.
        data: The recording.

    Raises:
        DataError: If it is of another body, or no camera saw anything.
    """
    told = told_as(model.tree, data)
    kinds = np.array([sensor.kind for sensor in told.sensors])
    seen = TreeObservations.of(told, kinds[told.observations.sensor] == CAMERA)
    if not seen.sensors:
        raise DataError(f"data set {data.name!r} has nothing that a camera saw")
    parameters = TreeParameters(model.tree)
    linear = TreeResiduals(seen, parameters).linear(parameters.values_of(model.tree))
    pose = told.observations.pose[seen.row]
    return stacked(linear, pose, parameters.names, data.sample)


def stacked(
    linear: TreeLinear, pose: NDArray, names: tuple[str, ...], sample: NDArray
) -> PoseResiduals:
    """Lay scalars into the places of their poses, zeros where there are fewer."""
    poses, of = np.unique(pose, return_inverse=True)
    order = np.argsort(of, kind="stable")
    place = np.empty(len(of), dtype=int)
    count = np.bincount(of)
    place[order] = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    shape = (len(poses), int(count.max()))

    def laid(values: NDArray) -> NDArray:
        out = np.zeros((*shape, *values.shape[1:]))
        out[of, place] = values
        return out

    by_angle = laid(linear.by_joint)
    return PoseResiduals(
        "pixels",
        names,
        laid(-linear.r),
        by_angle,
        np.zeros_like(by_angle),
        laid(linear.J.T),
        laid(np.ones(len(of))) > 0.0,
        sample[poses],
    )

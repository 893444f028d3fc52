"""Where a learned body expects its markers, and how surely."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset, ObservationTable
from nico_selfmodel.dataset.body.of_tree import link_joints_of, marker_infos
from nico_selfmodel.dataset.body.sensors import POINTS, SensorInfo
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import FLANGE, WORLD, Attached, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.names import refuse_unknown

_WATCHER = "the world itself"


@dataclass(frozen=True, eq=False)
class BodyPrediction:
    """Markers at poses; the pose comes first."""

    p_FM: NDArray
    """Positions in the frame that was asked for, W or a sensor's [m]. Shape (N, markers, 3)."""
    R_FM: NDArray
    """Orientations in it, of markers that have one. Shape (N, markers, 3, 3)."""
    sigma: NDArray
    """Standard deviation of a position in it, rms of its coordinates, by what the body and the
    sensor's place are known to, as one [m]. Shape (N, markers)."""
    total_sigma: NDArray
    """As `sigma`, with the joints' noise [m]. Shape (N, markers)."""
    pixels: dict[str, NDArray]
    """By camera; nan out of its view [px]. Shape (N, markers, 2) each."""
    reflected: dict[tuple[str, str], NDArray]
    """By camera and mirror, where the glass is as large as it likes; nan out of view, and behind
    the glass [px]. Shape (N, markers, 2) each."""


def predict_body(
    model: BodyModel,
    readings: NDArray,
    approach: NDArray | None = None,
    frame: str | None = None,
) -> BodyPrediction:
    """Predict all markers of a body.

    Where a sensor sees a marker is often known far better than where either is in W: errors of the
    world that both share cancel.

    Args:
        model: The body; none of its joints is a flange.
        readings: In each joint's own unit; nan of a joint without an encoder. Shape (N, n).
        approach: How each reading last changed, -1, 1, or 0 where it is not known, as all are if
            omitted: where a joint has backlash its half width is uncertain then. Shape (N, n).
        frame: The sensor in whose frame places are told; W if omitted.

    Returns:
        Where they are, how surely, and where cameras would see them.

    Raises:
        ValueError: If the shape is another, a joint is a flange, or there is no such sensor.
    """
    tree = model.tree
    watcher = _watcher(tree, frame)
    if readings.ndim != 2 or readings.shape[1] != len(tree.joints):
        raise ValueError(f"readings must have shape (N, {len(tree.joints)}), got {readings.shape}")
    if FLANGE in tree.motions:
        raise ValueError("a flange's pose is read, not predicted from encoders")
    count, markers = len(readings), len(tree.markers)
    data = replace(
        _asked(model, readings, watcher), approach=_sides(model, approach, readings.shape)
    )
    watched = tree
    if frame is None:
        watched = replace(tree, sensors=(*tree.sensors, watcher))
    parameters = TreeParameters(watched)
    residuals = TreeResiduals(TreeObservations.of(data), parameters)
    linear = residuals.linear(parameters.values_of(watched))
    p_FM = linear.r.reshape(count, markers, 3)
    motion = TreeMotion.at(watched, data.si_readings, approach=data.si_approach)
    X_WM = np.stack([motion.poses(m) for m in tree.markers], axis=1)
    p_WM = X_WM[..., :3, 3]
    R_FW = np.swapaxes(motion.poses(watcher)[:, :3, :3], 1, 2)
    sigma, total = (
        np.sqrt(variance.reshape(count, markers) / 3.0)
        for variance in _variances(model, parameters, linear.J, linear.by_joint, residuals)
    )
    cameras = {name: _seen(motion, name, p_WM) for name in tree.lenses}
    reflected = {
        (name, mirror.name): _reflected(motion, name, mirror.plane, p_WM)
        for mirror in tree.mirrors
        for name in tree.lenses
    }
    R_FM = R_FW[:, None] @ X_WM[..., :3, :3]
    return BodyPrediction(p_FM, R_FM, sigma, total, cameras, reflected)


def _watcher(tree: BodyTree, frame: str | None) -> Attached:
    """Return the sensor in whose frame places are told, or one at the origin of W.

    Raises:
        ValueError: If there is no such sensor.
    """
    if frame is None:
        return Attached(_WATCHER, WORLD)
    names = [sensor.name for sensor in tree.sensors]
    refuse_unknown("sensor", frame, names)
    return tree.sensors[names.index(frame)]


def _seen(motion: TreeMotion, camera: str, p_WQ: NDArray) -> NDArray:
    """Return where a camera sees points of each pose, nan out of its picture [px].

    Shape (N, m, 3) -> (N, m, 2).
    """
    X_CW = inverse(_poses(motion, camera))
    seen = apply(X_CW[:, None], p_WQ).reshape(-1, 3)
    lens = motion.tree.lenses[camera].at(np.eye(4))
    pixels = lens.project(seen).reshape(*p_WQ.shape[:2], 2)
    inside = (pixels > -0.5) & (pixels < np.array(lens.image_size) - 0.5)
    return np.where(np.all(inside, axis=-1, keepdims=True), pixels, np.nan)


def _reflected(motion: TreeMotion, camera: str, plane: Plane, p_WQ: NDArray) -> NDArray:
    """Return where a camera sees points of each pose in a glass [px]. (N, m, 3) -> (N, m, 2)."""
    p_WC = _poses(motion, camera)[:, :3, 3]
    before = (plane.distance_to(p_WQ) > 0.0) & (plane.distance_to(p_WC) > 0.0)[:, None]
    pixels = _seen(motion, camera, reflect(plane, p_WQ))
    return np.where(before[..., None], pixels, np.nan)


def _poses(motion: TreeMotion, camera: str) -> NDArray:
    """Return the poses of a camera in W. Shape (N, 4, 4)."""
    (sensor,) = [s for s in motion.tree.sensors if s.name == camera]
    return motion.poses(sensor)


def _variances(
    model: BodyModel,
    parameters: TreeParameters,
    J: NDArray,
    by_joint: NDArray,
    residuals: TreeResiduals,
) -> tuple[NDArray, NDArray]:
    """Return the trace of each point's covariance, J C J' + A P^2 A', and that with A D^2 A' too.

    Play P of joints that came from nobody knows where is no noise: it is the same each time.

    Returns:
        Shape (points,) each.
    """
    noisy = [i for i, _ in residuals.observations.noisy_joints]
    play = _unknown_play(model, residuals.observations.data)[:, noisy]
    noise = np.array([model.noise.get(model.tree.joints[i], 0.0) for i in noisy])
    rows = 3 * len(model.tree.markers)
    by_play, by_noise = (
        np.sum((by_joint * np.repeat(sigma, rows, axis=0)) ** 2, axis=1)
        for sigma in (play, np.broadcast_to(noise, play.shape))
    )
    if model.covariance is not None:
        own = [parameters.index[name] for name in model.covariance.names]
        by_play = by_play + np.einsum("ir,ij,jr->r", J[own], model.covariance.matrix, J[own])
    known, noisy_too = (trace.reshape(-1, 3).sum(axis=1) for trace in (by_play, by_play + by_noise))
    return known, noisy_too


def _sides(model: BodyModel, approach: NDArray | None, shape: tuple[int, ...]) -> NDArray:
    """Return how each joint last moved, in the sense of its displacement. Shape (N, n)."""
    side = np.zeros(shape) if approach is None else np.asarray(approach, dtype=float)
    if side.shape != shape or not np.isin(side, (-1.0, 0.0, 1.0)).all():
        raise ValueError(f"approach must be -1, 0 or 1, of shape {shape} as the readings")
    return side * np.sign(model.si_per_unit)


def _unknown_play(model: BodyModel, data: BodyDataset) -> NDArray:
    """Return the half width of the backlash of joints that came from nobody knows where. (N, n)."""
    bending = model.tree.bending
    half = np.zeros(len(model.tree.joints)) if bending is None else np.abs(bending.backlash)
    return np.where(data.si_approach == 0.0, half, 0.0)


def _asked(model: BodyModel, readings: NDArray, watcher: Attached) -> BodyDataset:
    """Return the recording of a tracker that sees everything, where `watcher` is."""
    tree = model.tree
    count, markers = len(readings), len(tree.markers)
    rows = count * markers
    values = np.hstack([np.zeros((rows, 3)), np.full((rows, 3), np.nan)])
    pose, marker = np.divmod(np.arange(rows), markers)
    table = ObservationTable(pose, np.zeros(rows, int), marker, np.full(rows, -1), values)
    return BodyDataset(
        "asked",
        link_joints_of(tree),
        marker_infos(tree),
        (SensorInfo(watcher.name, POINTS, tree.link_name(watcher.on)),),
        np.arange(count),
        np.asarray(readings, dtype=float) * model.si_per_unit,
        table,
    )

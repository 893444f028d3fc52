"""Which poses of a whole body to record next: see `next_poses`.

What is known is the covariance C = L L' of the body's parameters: in z, with x = L z, the recorded
poses say as much as the unit matrix. A pose adds what cameras and trackers see of one marker says
beyond what joint noise does to it.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset, ObservationTable
from nico_selfmodel.dataset.body.sensors import CAMERA, POINTS, POSES, SIGHTS
from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_errors import told_by
from nico_selfmodel.estimation.tree.tree_noise import sensor_noise_named
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import WORLD
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.names import listed
from nico_selfmodel.optimization.uncertainty import root_of
from nico_selfmodel.planning.pose_selection import (
    NextPoses,
    choose_poses,
    drawn_between,
    hand_sigma,
)

POOL = 500
"""Poses to choose from."""
_DRAWN, _ROUNDS = 4000, 20
"""Poses drawn at once, and how often, to find some in view."""
_MARGIN = 0.05
"""Share of the image at each edge in which a planned hand is not trusted to be seen."""


def choose_next_body_poses(
    model: BodyModel,
    data: BodyDataset,
    count: int,
    rng: np.random.Generator,
    *,
    criterion: str = "I",
    marker: str | None = None,
) -> NextPoses:
    """Choose poses between the readings that were recorded, a marker in view of all that saw it.

    The marker's error is by what the body is uncertain of, in pixels where cameras saw it [px, m].

    What hides the marker, and what collides, is not known here.

    Args:
        model: What was learned from the data.
        criterion: `I` for the prediction of the marker, `D` for all parameters.
        marker: On a link of the body; the first one by default.

    Raises:
        DataError: If the data are of another body, or no pose is in view.
        ModelError: If the body has no covariance or no such marker.
        ValueError: If the number, the criterion or the marker is wrong.
    """
    if model.covariance is None:
        raise ModelError(
            f"body {model.name!r} has no covariance: learn it by `calibrate body` from what "
            "cameras or trackers saw"
        )
    index, told = _marker(model, marker), told_by(model, data)
    kinds = np.array([info.kind for info in told.sensors])[told.observations.sensor]
    own = (told.observations.marker == index) & np.isin(kinds, SIGHTS)
    seen = np.unique(told.observations.pose[own])
    if not len(seen):
        raise DataError(f"data set {data.name!r} has no view of {model.tree.markers[index].name!r}")
    seeing = np.unique(told.observations.sensor[own]).tolist()
    cameras = [told.sensors[s].name for s in seeing if told.sensors[s].kind == CAMERA]
    recorded = told.readings[seen]
    # Far beside a camera a pixel moves without bound.
    recorded = recorded[_in_view(model, recorded, index, cameras)]
    if not len(recorded):
        raise DataError(
            f"no recorded pose of {data.name!r} shows {model.tree.markers[index].name!r} to every "
            f"camera that saw it ({listed(cameras)})"
        )
    pool = _pool(model, recorded, index, cameras, rng)
    known = _rows(model, told, recorded, index, seeing, whiten=False)
    told_already = np.eye(known.shape[2])[None]
    choice = choose_poses(
        _rows(model, told, pool, index, seeing, whiten=True),
        count,
        criterion=criterion,
        targets=known,
        given=told_already,
    )
    before = hand_sigma(told_already, known)
    unit = "px" if cameras else "m"
    return NextPoses(pool[choice.rows], before, choice.hand_sigma, choice, unit)


def _marker(model: BodyModel, name: str | None) -> int:
    """Return which marker is meant."""
    markers = model.tree.markers
    own = [m.name for m in markers if m.on != WORLD]
    room = listed((m.name for m in markers if m.on == WORLD), name) or "none"
    if not own:
        raise ModelError(
            f"no marker that moves on the body: it carries none, and knows {room} in the room. "
            "Poses are chosen by what is seen of one: fix one to a link, record and learn anew; "
            "or record poses all over the joints' ranges without choosing"
        )
    if name is not None and name not in own:
        raise ModelError(
            f"no marker {name!r} on the body: it carries {listed(own, name)}, and knows {room} in "
            "the room; choose one that it carries"
        )
    return model.tree.marker_index(own[0] if name is None else name)


def _pool(
    model: BodyModel,
    recorded: NDArray,
    marker: int,
    cameras: Collection[str],
    rng: np.random.Generator,
) -> NDArray:
    """Draw poses between recorded readings that show the marker to all cameras. Shape (N, n)."""
    found: list[NDArray] = []
    for _ in range(_ROUNDS):
        drawn = drawn_between(recorded, _DRAWN, rng)
        found += list(drawn[_in_view(model, drawn, marker, cameras)])
        if len(found) >= POOL:
            break
    if not found:
        raise DataError(
            f"none of {_ROUNDS * _DRAWN} poses between the recorded readings shows "
            f"{model.tree.markers[marker].name!r} to every camera"
        )
    return np.array(found[:POOL])


def _in_view(model: BodyModel, readings: NDArray, marker: int, cameras: Collection[str]) -> NDArray:
    """Return whether all of some cameras have the marker in their images. Shape (N,)."""
    tree, inside = model.tree, np.ones(len(readings), dtype=bool)
    motion = TreeMotion.at(tree, model.readings(readings))
    p_WM = motion.pose_of(tree.markers[marker])[1].T
    for sensor in tree.sensors:
        if sensor.name not in cameras:
            continue
        lens = tree.lenses[sensor.name].at(np.eye(4))
        p_CM = apply(inverse(motion.poses(sensor)), p_WM)
        uv, size = lens.project(p_CM), np.array(lens.image_size, dtype=float)
        with np.errstate(invalid="ignore"):
            inside &= ((uv > _MARGIN * size) & (uv < (1.0 - _MARGIN) * size)).all(axis=1)
    return inside


def _rows(
    model: BodyModel,
    told: BodyDataset,
    readings: NDArray,
    marker: int,
    seeing: Sequence[int],
    *,
    whiten: bool,
) -> NDArray:
    """Return derivatives by z of what sensors show of the marker. Shape (N, k, p).

    Args:
        told: A recording of it, for its joints and sensors.
        readings: In the joints' own units. Shape (N, n).
        seeing: Sensors that see it.
        whiten: Take off what joint noise and sensors do: rows of unit variance; else of pixels
            [px], or where no camera sees it of places [m].
    """
    count = len(readings)
    pose = np.repeat(np.arange(count), len(seeing))
    values = np.full((len(pose), 6), np.nan)
    sensor = np.tile(seeing, count)
    # Of whole poses, too, the place is what is asked for.
    sensors = tuple(replace(s, kind=POINTS) if s.kind == POSES else s for s in told.sensors)
    kinds = np.array([info.kind for info in sensors])[sensor]
    values[:, :2], values[kinds == POINTS, 2] = 0.0, 0.0
    none = np.full(len(pose), -1)
    table = ObservationTable(pose, sensor, np.full(len(pose), marker), none, values)
    asked = replace(
        told,
        sensors=sensors,
        sample=np.arange(count),
        readings=readings,
        flanges=None,
        approach=None,
        observations=table,
    )
    seen, parameters = TreeObservations.of(asked), TreeParameters(model.tree)
    linear = TreeResiduals(seen, parameters).linear(parameters.values_of(model.tree))
    assert model.covariance is not None
    own = [parameters.index[name] for name in model.covariance.names]
    order = np.argsort(seen.data.observations.pose[seen.row], kind="stable")
    J = (linear.J[own].T @ root_of(model.covariance.matrix))[order]
    J = J.reshape(count, len(order) // count, -1)
    if not whiten:
        by_pixel = (kinds[seen.row] == CAMERA)[order].reshape(count, -1)[0]
        return J[:, by_pixel] if by_pixel.any() else J
    sigma = np.array([model.noise.get(model.tree.joints[i], 0.0) for i, _ in seen.noisy_joints])
    A = (linear.by_joint * sigma)[order].reshape(*J.shape[:2], -1)
    own_sigma = np.nan_to_num(sensor_noise_named(model.noise, seen), nan=1.0)
    variance = np.square(own_sigma[seen.noise_group][order]).reshape(count, -1)
    S = A @ np.swapaxes(A, 1, 2) + np.eye(J.shape[1]) * variance[:, None]
    return np.linalg.solve(np.linalg.cholesky(S), J)

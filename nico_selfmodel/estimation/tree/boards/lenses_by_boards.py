"""Lenses that a recording does not tell, from the flat boards in it (Zhang 2000)."""

import contextlib
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.sensors import CAMERA
from nico_selfmodel.errors import DataError, EstimationError, ModelError
from nico_selfmodel.estimation.cameras.camera_adjustment import CameraCalibration
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_options import AUTO, CameraOptions
from nico_selfmodel.estimation.cameras.lenses.lens_choice import lens_of
from nico_selfmodel.estimation.tree.boards.board_views import places_on_boards
from nico_selfmodel.estimation.tree.tree_observations import SensorRows, TreeObservations
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import intrinsics_of
from nico_selfmodel.names import listed

_LAST, _TOLD = "k3", 2.0
"""A coefficient that few boards tell, and how many sigmas from zero it is where they do."""


def lenses_by_boards(
    data: BodyDataset, known: Mapping[str, Camera]
) -> tuple[dict[str, Camera], frozenset[str]]:
    """Return lenses of cameras of which nothing else tells, and the names of what is free of them.

    Each camera is calibrated alone, with the kind of lens that boards left out ask for; what is
    seen in a mirror is a board like any other, for a flat board's mirror image is one.

    Args:
        known: Intrinsics of other cameras, by name.

    Raises:
        DataError: If such a camera saw no flat board that moves freely, or has no image size.
        NotIdentifiableError: If it saw too few.
    """
    wanted = [
        s
        for s, info in enumerate(data.sensors)
        if info.kind == CAMERA and info.camera is None and info.name not in known
    ]
    lenses: dict[str, Camera] = {}
    free: set[str] = set()
    seen = TreeObservations.of(data).sensors
    for s in wanted if data.free_joints else ():
        info = data.sensors[s]
        if info.image_size is None:
            raise DataError(f"camera {info.name!r} has no 'image_size' in dataset.yaml")
        views = _views(
            data, [rows for rows in seen if rows.sensor == s], info.name, info.image_size
        )
        found = _calibrated(views)
        (lens,) = found.cameras
        inside = {f"{info.name}.{part}" for part in intrinsics_of(lens.lens)}
        lenses[info.name] = lens
        free |= inside & set(found.uncertainty.names)
    return lenses, frozenset(free)


def _calibrated(views: BoardViews) -> CameraCalibration:
    """Calibrate one camera; a third coefficient that boards do not tell from zero is left out."""
    options = CameraOptions(lens=AUTO)
    with contextlib.suppress(EstimationError, ModelError):
        found = calibrate_cameras(views, CameraOptions())
        (name,), (lens,), known = views.cameras, found.cameras, found.uncertainty
        sigma = known.sigma[known.names.index(f"{name}.{_LAST}")]
        if known.unobservable or abs(lens.named_values[_LAST]) < _TOLD * sigma:
            options = replace(options, pinned={_LAST: 0.0})
    return lens_of(views, options).calibration


def _views(
    data: BodyDataset, seen: list[SensorRows], camera: str, size: tuple[int, int]
) -> BoardViews:
    """Return every view of the flat board that a camera saw most."""
    places = places_on_boards(data)
    counts = {
        joint: sum(int(np.sum(data.seen_on[rows.rows] == joint)) for rows in seen)
        for joint in data.free_joints
    }
    joint = max(counts, key=lambda joint: counts[joint])
    corners = np.array([i for i, m in enumerate(data.markers) if data.on_link(m.on) == joint])
    p = places[corners]
    if not counts[joint] or np.ptp(p[:, 2]) > 0.0:
        boards = listed([data.joint_names[i] for i in data.free_joints])
        raise DataError(
            f"nothing tells the lens of camera {camera!r}: it saw no flat board (z = 0) of "
            f"{boards}; put 'lens' into dataset.yaml, or give calibrated cameras"
        )
    names, pixels = [], []
    for rows in seen:
        for sample in np.unique(rows.pose).tolist():
            own = (rows.pose == sample) & (data.seen_on[rows.rows] == joint)
            picture = np.full((len(data.markers), 2), np.nan)
            picture[rows.marker[own]] = rows.measured[own]
            names.append(f"{data.sample[sample]} {rows.mirror}".strip())
            pixels.append(picture[corners])
    return BoardViews(p, tuple(names), (camera,), np.stack(pixels), (size,))

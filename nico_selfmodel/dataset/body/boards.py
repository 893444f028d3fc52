"""Boards that a recording's cameras saw besides: samples of their own, in which the body rests."""

from dataclasses import replace

import numpy as np

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.dataset.body.body_dataset import WIDTH, BodyDataset, ObservationTable
from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.dataset.body.sensors import CAMERA, MarkerInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.model.tree.body_tree import FREE, WORLD_NAME
from nico_selfmodel.names import listed

BOARD = "board"
"""What the joint of such a board is called; its corners are `board0`, `board1`, ..."""


def with_boards(data: BodyDataset, views: BoardViews) -> BodyDataset:
    """Return a recording with views of a board behind it.

    Where the body was while the board was held does not matter: its cameras stand in the world, and
    nothing else was seen.

    Args:
        views: Corners, in cameras that the recording has.

    Raises:
        DataError: If the recording has no such cameras, or they move with a joint.
    """
    _check_cameras(data, views)
    at, pixels = [s.name for s in data.sensors], views.pixels.reshape(len(views), -1, 2)
    seen = np.isfinite(pixels).all(axis=2).reshape(len(views), len(views.p_GQ), -1)
    view, corner, camera = np.nonzero(seen)
    values = np.full((len(view), WIDTH), np.nan)
    values[:, :2] = pixels.reshape(*seen.shape, 2)[view, corner, camera]
    count, old = len(data.sample), data.observations
    table = ObservationTable(
        np.append(old.pose, count + view),
        np.append(old.sensor, np.array([at.index(name) for name in views.cameras])[camera]),
        np.append(old.marker, len(data.markers) + corner),
        np.append(old.other, np.full(len(view), -1)),
        np.vstack([old.values, values]),
        np.append(old.mirror, np.full(len(view), "")),
    )
    more = len(views)
    places = [tuple(map(float, p)) for p in views.p_GQ.tolist()]
    return replace(
        data,
        joints=(*data.joints, LinkJoint(BOARD, motion=FREE, encoder_unit="pose")),
        markers=(
            *data.markers,
            *(MarkerInfo(f"{BOARD}{k}", BOARD, (x, y, z)) for k, (x, y, z) in enumerate(places)),
        ),
        sample=np.append(data.sample, int(data.sample.max()) + 1 + np.arange(more)),
        readings=_longer(np.asarray(data.readings), more),
        flanges=_longer(np.asarray(data.flanges), more),
        approach=np.pad(np.asarray(data.approach), ((0, more), (0, 1))),
        observations=table,
    )


def _longer(values: np.ndarray, more: int) -> np.ndarray:
    """Return readings with the middle of all for more samples, and none of another joint."""
    middle = np.repeat(np.sort(values, axis=0)[len(values) // 2][None], more, axis=0)
    width = [(0, 0), (0, 1), *[(0, 0)] * (values.ndim - 2)]
    return np.pad(np.concatenate([values, middle]), width, constant_values=np.nan)


def _check_cameras(data: BodyDataset, views: BoardViews) -> None:
    cameras = {s.name: s for s in data.sensors if s.kind == CAMERA}
    unknown = [name for name in views.cameras if name not in cameras]
    if unknown:
        raise DataError(
            f"the boards were photographed by {listed(unknown)}; data set {data.name!r} has the "
            f"cameras {listed(list(cameras)) if cameras else 'none'}: call the folders or files as "
            "these"
        )
    carried = [name for name in views.cameras if cameras[name].on != WORLD_NAME]
    if carried:
        raise DataError(
            f"cameras {listed(carried)} move with a joint: where they were while the board was "
            "held must be recorded, too; give the board's corners as observations of these samples"
        )
    if any(joint.name == BOARD for joint in data.joints):
        raise DataError(f"data set {data.name!r} has a joint called {BOARD!r} already")
    for name in views.cameras:
        width, height = views.size_of(name)
        size = cameras[name].image_size or (width, height)
        if size != (width, height):
            raise DataError(
                f"the photographs of boards have {width} x {height} px, camera {name!r} of data "
                f"set {data.name!r} has {size[0]} x {size[1]}: both must be of the same cameras"
            )

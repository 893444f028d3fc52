"""Recordings in which nothing moved that should tell where joints are."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import ANY_POSE, BodyDataset
from nico_selfmodel.dataset.body.sensors import SIGHTS
from nico_selfmodel.errors import DataError
from nico_selfmodel.model.tree.body_tree import REVOLUTE
from nico_selfmodel.names import listed

_STILL = 1e-3
"""Travel of a joint that tells no axis [rad]."""
_FEWEST = 3
"""Poses in which a value that is the same to the last digit is no accident."""


def check_that_it_moved(data: BodyDataset, moving: NDArray, *, described: bool) -> None:
    """Refuse a recording in which nothing moved.

    Args:
        data: The recording.
        moving: Which joints move anything against what sees it. Boolean, shape (n,).
        described: Whether a description tells where joints are that stood still.

    Raises:
        DataError: If no joint moves what was seen, a joint stood still whose axis nothing else
            tells, or what a sensor told of a marker never changed though joints before it moved.
    """
    if data.joints and not moving.any():
        raise DataError(
            f"no joint of data set {data.name!r} moves what was seen: say by 'on' which link "
            "carries each marker and sensor, and see that what a joint moves was seen"
        )
    travel = np.ptp(data.si_readings, axis=0)
    still = [
        joint.name
        for joint, far, moves in zip(data.joints, travel.tolist(), moving.tolist(), strict=True)
        if joint.motion == REVOLUTE and not joint.follows and moves and far < _STILL
    ]
    if still and not described:
        raise DataError(
            f"{listed(still)} stood still in all {len(data.sample)} samples of data set "
            f"{data.name!r}: nothing tells where such axes are; record poses that turn them, leave "
            "them out of the joints, or give the robot's description"
        )
    if frozen := _frozen(data, travel):
        raise DataError(
            f"what {frozen[0]!r} measured of {frozen[1]!r} is the same to the last digit in all "
            f"{frozen[2]} poses, though joints moved: the sensor hangs, or the marker is 'on' "
            "another link"
        )


def _frozen(data: BodyDataset, travel: NDArray) -> tuple[str, str, int] | None:
    """Return a sensor and a marker that moved before it of which it told one value throughout."""
    table, moved = data.observations, bool((travel > _STILL).any())
    kinds = np.array([sensor.kind for sensor in data.sensors])[table.sensor]
    own = moved & np.isin(kinds, SIGHTS) & (table.pose != ANY_POSE) & (data.seen_on >= 0)
    rows = np.flatnonzero(own)
    keys = np.column_stack([table.sensor[rows], table.marker[rows]])
    for sensor, marker in np.unique(keys, axis=0).tolist():
        mine = rows[(keys == [sensor, marker]).all(axis=1)]
        poses = len(np.unique(table.pose[mine]))
        values = np.nan_to_num(table.values[mine])
        if poses >= _FEWEST and (values == values[0]).all() and _turned(data, marker, mine):
            return data.sensors[sensor].name, data.markers[marker].name, poses
    return None


def _turned(data: BodyDataset, marker: int, rows: NDArray) -> bool:
    """Whether the joint that carries a marker moved over some rows of the table."""
    joint = data.on_link(data.markers[marker].on)
    readings = data.si_readings[data.observations.pose[rows], joint]
    return bool(np.ptp(readings) > _STILL)

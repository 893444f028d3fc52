"""Recordings in which nothing moved that should tell where joints are."""

from collections.abc import Collection
from math import comb

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import ANY_POSE, BodyDataset
from nico_selfmodel.dataset.body.sensors import SIGHTS
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.observations.outlier_words import stood_in_a_row
from nico_selfmodel.model.tree.body_tree import PRISMATIC, REVOLUTE
from nico_selfmodel.names import listed

_STILL = 1e-3
"""Travel of a joint that tells no axis [rad]."""
_STILL_SLIDE = 1e-5
"""The same of a joint that shifts [m]."""
_HARDLY = 0.01
"""And of one that hardly moved beside others of its kind, as a share of their median travel."""
_FEWEST = 3
"""Poses in which a value that is the same to the last digit is no accident, or that contradict the
rest while a joint stands."""
_BY_CHANCE = 0.02
"""How often as many may lie there by chance; that one joint alone stands is rare by itself."""


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
    moved = zip(data.joints, moving.tolist(), strict=True)
    still = sorted(still_readings(data) & {joint.name for joint, moves in moved if moves})
    if still and not described:
        raise DataError(
            f"{listed(still)} stood still in all {len(data.sample)} samples of data set "
            f"{data.name!r}: nothing tells where such axes are; record poses that move them, leave "
            "them out of the joints, or give the robot's description; if they did move, their "
            "encoders stand still"
        )
    if frozen := _frozen(data, np.ptp(data.si_readings, axis=0)):
        raise DataError(
            f"what {frozen[0]!r} measured of {frozen[1]!r} is the same to the last digit in all "
            f"{frozen[2]} poses, though joints moved: the sensor hangs, or the marker is 'on' "
            "another link"
        )


def still_readings(data: BodyDataset) -> set[str]:
    """Return joints that turn or shift whose readings never changed."""
    travel = np.ptp(data.si_readings, axis=0)
    least = {REVOLUTE: _STILL, PRISMATIC: _STILL_SLIDE}
    return {
        joint.name
        for joint, far in zip(data.joints, travel.tolist(), strict=True)
        if not joint.follows and far < least.get(joint.motion, 0.0)
    }


def dead_encoders(data: BodyDataset, joints: Collection[str]) -> str:
    """Say which joints stand still in their readings, where a body does not fit; or nothing.

    One that stands in some samples in a row is said to where no other does so ever.
    """
    never = still_readings(data)
    still = sorted((never | _hardly_moved(data)) & set(joints))
    if not still:
        return _stood_in_between(data, joints)
    change = "never change" if never >= set(still) else "hardly change"
    return f"readings of {listed(still)} {change}: if it moved, its encoder stands still"


def frozen_reading(data: BodyDataset, aside: NDArray) -> str:
    """Say that a joint stood still in its readings where most of what contradicts the rest lies.

    Samples that were set aside lie there far more often than by chance (Fisher's exact test).

    Args:
        data: The recording.
        aside: Samples of which something was set aside. Boolean, shape (P,).

    Returns:
        Nothing where none stood so, or no more lie there than may.
    """
    found = _stood_in_a_row(data)
    if found is None:
        return ""
    span = np.isin(data.sample, found[1])
    n, m, inside = len(data.sample), int(aside.sum()), int((aside & span).sum())
    ways = [
        comb(int(span.sum()), k) * comb(n - int(span.sum()), m - k) for k in range(inside, m + 1)
    ]
    if inside < _FEWEST or 2 * inside <= m or sum(ways) > _BY_CHANCE * comb(n, m):
        return ""
    return f"{found[2]}; of {m} samples that contradict the rest {inside} are among these"


def _stood_in_between(data: BodyDataset, joints: Collection[str]) -> str:
    """Say which joint alone reads the same in many samples in a row while others move."""
    found = _stood_in_a_row(data)
    return found[2] if found is not None and found[0] in joints else ""


def _stood_in_a_row(data: BodyDataset) -> tuple[str, NDArray, str] | None:
    """Find that joint, see `stood_in_a_row`."""
    read = [i for i, joint in enumerate(data.joints) if joint.is_read]
    names = [data.joints[i].name for i in read]
    units = [data.joints[i].encoder_unit for i in read]
    return stood_in_a_row(names, units, data.sample, data.readings[:, read])


def _hardly_moved(data: BodyDataset) -> set[str]:
    """Return joints whose readings changed far less than those of most others of their kind."""
    travel = np.ptp(data.si_readings, axis=0)
    found = set[str]()
    for motion in (REVOLUTE, PRISMATIC):
        own = [i for i, j in enumerate(data.joints) if j.motion == motion and j.is_read]
        usual = _HARDLY * float(np.median(travel[own])) if own else 0.0
        found |= {data.joints[i].name for i in own if travel[i] < usual}
    return found


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

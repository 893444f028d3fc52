"""Recordings of one body, one after the other, as one."""

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from typing import TypeVar

import numpy as np

from nico_selfmodel.dataset.body.body_dataset import (
    ANY_POSE,
    COLUMNS,
    BodyDataset,
    ObservationTable,
)
from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.dataset.body.sensors import MarkerInfo, SensorInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.names import listed, shown

_Entry = TypeVar("_Entry", LinkJoint, MarkerInfo, SensorInfo)
_GUESSED = ("lower", "upper", "pose", "sigma_m", "sigma_px", "sigma_rad", "noise")
"""Keys that may differ between recordings: the first one's count."""


def joined(first: BodyDataset, second: BodyDataset, name: str) -> BodyDataset:
    """Return two recordings of one body as one; the second's samples are numbered anew.

    What has one name in both is one marker, sensor or mirror.

    Args:
        first: The earlier recording.
        second: The later one, of the same joints.

    Raises:
        DataError: If it is of other joints, or a name means something else there.
    """
    ours, theirs = ([joint.name for joint in data.joints] for data in (first, second))
    if ours != theirs:
        raise DataError(
            f"data set {first.name!r} has the joints {listed(ours)}, {second.name!r} has "
            f"{listed(theirs)}: both must be of one body"
        )
    where = f"in data set {first.name!r}", f"in {second.name!r}"
    second = _in_units_of(first, second)
    _of_both(first.joints, second.joints, where)
    both = replace(
        first,
        markers=_of_both(first.markers, second.markers, where),
        sensors=_of_both(first.sensors, second.sensors, where),
    )
    later = second.like(both).observations
    pose = np.where(later.pose == ANY_POSE, ANY_POSE, later.pose + len(first.sample))
    tables = [first.observations, replace(later, pose=pose)]
    columns = (np.concatenate([getattr(table, key) for table in tables]) for key in COLUMNS)
    numbers = second.sample - second.sample.min() + first.sample.max() + 1
    arrays: dict[str, np.ndarray] = {
        key: np.concatenate([np.asarray(getattr(data, key)) for data in (first, second)])
        for key in ("readings", "flanges", "approach")
    }
    return replace(
        both,
        name=name,
        sample=np.append(first.sample, numbers),
        observations=ObservationTable(*columns),
        source=first.source
        if first.source == second.source
        else f"{first.source}; {second.source}",
        **arrays,
    )


def all_joined(recordings: Sequence[BodyDataset], name: str) -> BodyDataset:
    """Return recordings of one body as one, see `joined`.

    Raises:
        DataError: If one is given twice, which would count as evidence, or they do not fit.
    """
    held = [(r.readings.tobytes(), r.observations.values.tobytes()) for r in recordings]
    twice = [f"{k} ({r.name})" for k, r in enumerate(recordings, 1) if held.count(held[k - 1]) > 1]
    if twice:
        raise DataError(f"recordings {listed(twice)} are one and the same: give it once")
    return replace(reduce(lambda one, other: joined(one, other, name), recordings), name=name)


def _in_units_of(first: BodyDataset, second: BodyDataset) -> BodyDataset:
    """Return a recording with angles read as those of another: 1 deg of one is 1 deg of both."""
    factors, joints = np.ones(len(second.joints)), list(second.joints)
    for i, (one, other) in enumerate(zip(first.joints, joints, strict=True)):
        if {one.encoder_unit, other.encoder_unit} == {"rad", "deg"} and one.sign == other.sign:
            factors[i] = other.si_per_unit / one.si_per_unit
            joints[i] = replace(other, encoder_unit=one.encoder_unit, lower=None, upper=None)
    return replace(second, joints=tuple(joints), readings=second.readings * factors)


def _of_both(
    ours: Sequence[_Entry], theirs: Sequence[_Entry], where: tuple[str, str]
) -> tuple[_Entry, ...]:
    """Return what is listed in either; refuse what is not the same in both."""
    known = {item.name: item.to_mapping() for item in ours}
    for item in theirs:
        one, other = known.get(item.name, item.to_mapping()), item.to_mapping()
        keys = [key for key in {**one, **other} if one.get(key) != other.get(key)]
        for key in (key for key in keys if key not in _GUESSED):
            raise DataError(
                f"{item.name!r} has {key!r} {shown(one.get(key, 'nothing'))} {where[0]} and "
                f"{shown(other.get(key, 'nothing'))} {where[1]}: what has one name must be the "
                "same, give it another name there"
            )
    return (*ours, *(item for item in theirs if item.name not in known))

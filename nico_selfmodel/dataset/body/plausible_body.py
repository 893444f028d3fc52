"""Recordings of bodies that are well formed but can hardly be what they say: units."""

import warnings

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import numbered_rows
from nico_selfmodel.dataset.body.body_dataset import ANY_POSE, BodyDataset
from nico_selfmodel.dataset.body.sensors import (
    CAMERA,
    DISTANCE,
    FIRST_SIGMA,
    POINTS,
    POSES,
    SIGHTS,
)
from nico_selfmodel.dataset.plausibility import (
    MAX_SPREAD_M,
    check_radians,
    check_spread,
    refuse_copies,
    refuse_nothings,
    stood_still,
    warn_of_outside,
    warn_of_specks,
    warn_of_stops,
    warn_of_twins,
)
from nico_selfmodel.errors import DataError
from nico_selfmodel.model.tree.body_tree import FLANGE, PRISMATIC, WORLD_NAME
from nico_selfmodel.names import TAGS_OF_ONE_ID, listed

_LENGTHS = "Lengths are"
_ONE_PLACE = 0.05
"""Of what a sensor's sights spread: places of one marker at one pose that are farther apart are of
two markers, where they are farther apart ..."""
_SURELY = 10.0
"""... than so many standard deviations of the sensor: frames of a robot that stands differ, too."""
_FEW, _ACCIDENTS = 2, 0.1
"""So many sights of a marker, and so large a part of them, may be at two places by wrong labels."""


def check_plausible_body(data: BodyDataset) -> None:
    """Refuse a recording that cannot be what it says; warn of what it hardly is.

    Raises:
        DataError: If places spread over more than 100 m, distances or markers of known place over
            more than 20 m, a rotation vector turns by more than a whole turn, some samples are in
            degrees, many observations are copies, places exactly 0, or a marker often at two
            places at once.

    Warns:
        UserWarning: If places spread over more than 20 m or less than 5 mm, a joint read in
            `rad` turned by more than two whole turns, readings lie beyond a joint's ends, two
            joints read the same throughout, or a marker was at two places at once.
    """
    table, widest = data.observations, np.zeros((1, 3))
    for s, sensor in enumerate(data.sensors):
        own = table.values[table.sensor == s]
        if not len(own):
            continue
        what = f"what sensor {sensor.name!r} measured"
        if sensor.kind == DISTANCE:
            _check_stated(what, float(np.abs(own[:, 0]).max()))
        rows = table.pose[table.sensor == s]
        if sensor.kind in (POINTS, POSES, CAMERA) and (rows != ANY_POSE).all():
            width = 2 if sensor.kind == CAMERA else 3
            refuse_nothings(data.sample[rows], own[:, :width], f"places by sensor {sensor.name!r}")
        if sensor.kind in (POINTS, POSES):
            check_spread(f"{what}: up to", _from_middle(own[:, :3]), _LENGTHS)
            widest = max(widest, own[:, :3], key=_from_middle)
        if sensor.kind == CAMERA:
            warn_of_outside(own[:, :2], sensor.image_size, what)
        if sensor.kind == POSES:
            _check_turns(f"orientations of sensor {sensor.name!r}", own[:, 3:6])
    _check_one_place(data)
    if not stood_still(data.si_as_read):
        warn_of_specks("all places that sensors measured lie", widest, _LENGTHS)
    xyz = np.array([marker.xyz for marker in data.markers if marker.xyz is not None])
    if len(xyz):
        _check_stated("'xyz' of markers", _from_middle(xyz))
    on_links = [one.xyz for one in data.markers if one.xyz and one.on != WORLD_NAME]
    if on_links:
        _check_stated("'xyz' of markers on links", float(np.abs(on_links).max()))
    there = (table.pose != ANY_POSE) & np.isfinite(table.values).any(axis=1)
    pose = table.pose[there]
    flanges = [i for i, joint in enumerate(data.joints) if joint.motion == FLANGE]
    told = [data.readings[pose], *(np.asarray(data.flanges)[pose, i] for i in flanges)]
    seen = [table.values[there], table.sensor[there, None], table.marker[there, None]]
    refuse_copies(data.sample[pose], np.hstack([*told, *seen]), "observations.csv")
    for i, joint in enumerate(data.joints):
        if joint.motion == FLANGE:
            assert data.flanges is not None
            middle = _from_middle(data.flanges[:, i, :3])
            check_spread(f"places of flange {joint.name!r}: up to", middle, _LENGTHS)
            warn_of_specks(f"places of flange {joint.name!r} lie", data.flanges[:, i, :3], _LENGTHS)
            _check_turns(f"orientations of flange {joint.name!r}", data.flanges[:, i, 3:])
        elif joint.motion == PRISMATIC and joint.is_read and joint.counts_per_turn is None:
            middle = _from_middle(data.si_readings[:, i])
            check_spread(f"readings of joint {joint.name!r}: up to", middle, _LENGTHS)
    in_rad = [i for i, j in enumerate(data.joints) if j.is_read and j.encoder_unit == "rad"]
    names = [data.joints[i].name for i in in_rad]
    check_radians(names, data.readings[:, in_rad], data.sample, "poses.csv")
    ends = [(joint.name, joint.lower, joint.upper) for joint in data.joints]
    warn_of_stops(ends, data.readings, "poses.csv")
    read = [i for i, joint in enumerate(data.joints) if joint.is_read]
    warn_of_twins([data.joint_names[i] for i in read], data.readings[:, read], "poses.csv")


def _check_one_place(data: BodyDataset) -> None:
    """Refuse markers that were seen at two places at once too often for a wrong label now and then.

    Raises:
        DataError: If there is one.

    Warns:
        UserWarning: If there is one, but seldom.
    """
    table, kinds = data.observations, [sensor.kind for sensor in data.sensors]
    sights, twice = [], []
    for s in np.unique(table.sensor[table.pose != ANY_POSE]).tolist():
        if kinds[s] not in SIGHTS:
            continue
        rows = np.flatnonzero((table.sensor == s) & (table.pose != ANY_POSE))
        own = table.select(rows)
        mirror = np.unique(own.mirror, return_inverse=True)[1]
        first, same = numbered_rows(np.column_stack([own.pose, own.marker, mirror]))
        p = own.values[:, : 2 if kinds[s] == CAMERA else 3]
        apart = np.linalg.norm(p - p[first[same]], axis=1)
        least = max(_ONE_PLACE * np.linalg.norm(np.std(p, axis=0)), _SURELY * FIRST_SIGMA[kinds[s]])
        sights.append(rows[first])
        twice.append(rows[first[np.unique(same[apart > least])]])
    if not any(map(len, twice)):
        return
    all_of, off = (np.concatenate(rows) for rows in (sights, twice))
    for m in np.unique(table.marker[off]).tolist():
        own = off[table.marker[off] == m]
        most = _FEW + _ACCIDENTS * np.count_nonzero(table.marker[all_of] == m)
        who = listed(repr(data.sensors[s].name) for s in np.unique(table.sensor[own]).tolist())
        what = (
            f"{who} saw {data.markers[m].name!r} at two places at once ({len(own)} times, first "
            f"in sample {data.sample[table.pose[own]].min()}): {TAGS_OF_ONE_ID}, tell reflections "
            "by `mirror`, or leave these rows out"
        )
        if len(own) > most:
            raise DataError(what)
        warnings.warn(what, stacklevel=4)


def _from_middle(places: NDArray) -> float:
    """Return how far places lie from where most of them are: the origin may be anywhere."""
    return float(np.abs(places - np.median(places, axis=0)).max())


def _check_stated(what: str, spread: float) -> None:
    if spread > MAX_SPREAD_M:
        raise DataError(
            f"{what}: up to {spread:.4g} m: were millimetres given as metres? {_LENGTHS} metres"
        )


def _check_turns(what: str, turns: NDArray) -> None:
    largest = float(np.linalg.norm(turns, axis=1).max())
    if largest > 2.0 * np.pi + 1e-6:
        raise DataError(
            f"{what} turn by up to {largest:.4g} rad: were degrees given as radians, or other "
            "angles as a rotation vector? rx, ry, rz are axis times angle [rad]"
        )

"""A first body of one flange, whose pose a controller tells: hand-eye calibration."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.sensors import CAMERA, POINTS, POSES
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.diagnosis.turns_written import AS_CONVENTIONS, SMALLER, meant_turns
from nico_selfmodel.estimation.tree.guesses.among_unknown import FEWEST_PAIRS, on_link_among_unknown
from nico_selfmodel.estimation.tree.guesses.by_first_body import (
    with_orientations,
    with_others,
    with_sensors,
)
from nico_selfmodel.estimation.tree.guesses.carried_cameras import known_places, placed_by_known
from nico_selfmodel.estimation.tree.guesses.hand_eye import HandEye
from nico_selfmodel.estimation.tree.tree_observations import SensorRows, TreeObservations
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.tree.body_tree import FLANGE, WORLD, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.names import listed

CHECK_FLANGE = (
    "check units, which way they go (of the flange in the base, or the other way round), how turns "
    "are written, and the pairing with what was seen"
)
"""What poses of a flange that are contradicted may come of."""
_MISFIT = 0.01
"""Usual misfit [rad, spread of the flange] below which the inverse of poses is not tried."""
_FEWEST_EITHER = 4
"""Poses that tell which way they go: three fit inverted as well."""
CARRIED_NEARER = 2.0
"""What a flange carries is not so many times as far from it as what stands is from its base."""


def from_flange(
    data: BodyDataset, blank: BodyTree, observations: TreeObservations, seed: int
) -> BodyTree:
    """Return a body of one flange whose target a sensor tells in whole poses, or by its corners.

    Args:
        blank: The body with nothing known of its geometry but known markers and lenses.

    Raises:
        DataError: If no sensor tells a target, or poses hardly turn.
    """
    (flange,) = [i for i, joint in enumerate(data.joints) if joint.motion == FLANGE][:1]
    for rows in observations.sensors:
        if rows.kind == POSES:
            return _by_target(data, blank, observations, rows, flange)
    cameras = [rows for rows in observations.sensors if rows.kind == CAMERA and not rows.mirror]
    carried = [r for r in cameras if data.on_link(data.sensors[r.sensor].on) == flange]
    if carried and known_places(data).any():
        return _by_corners(data, blank, carried, flange, seed)
    found = _by_unknown(data, blank, cameras, seed)
    if found is None:
        raise DataError(_why_nothing_fits(data, cameras, flange))
    return found


def _why_nothing_fits(data: BodyDataset, cameras: Sequence[SensorRows], flange: int) -> str:
    """Say what contradicts the flange's poses, or what is missing."""
    seen = [(rows.name, np.bincount(rows.marker)) for rows in cameras]
    told = [name for name, count in seen if np.sum(count * (count - 1)) >= 2 * FEWEST_PAIRS]
    if told:
        return (
            f"wherever {listed(told)} might sit, what was seen contradicts the poses of flange "
            f"{data.joint_names[flange]!r}: {CHECK_FLANGE}"
        )
    return (
        "a flange's hand-eye calibration needs a sensor that tells whole poses of a target "
        "(kind 'poses'), such as a board's or a tag's, or a camera of known lens that sees "
        "corners at known places in the room (xyz), or each of some tags from many poses"
    )


def _by_target(
    data: BodyDataset,
    tree: BodyTree,
    observations: TreeObservations,
    rows: SensorRows,
    flange: int,
) -> BodyTree:
    """Return a body by whole poses of the target that was seen most."""
    info = data.sensors[rows.sensor]
    m = int(np.bincount(rows.marker).argmax())
    own = rows.marker == m
    F = data.X_flange[rows.pose[own], flange]
    on_hand, vectors = tree.markers[m].on != WORLD, rows.measured[own, 3:]
    M = transform(rotation_from_vector(vectors), rows.measured[own, :3])
    M = M if on_hand else inverse(M)
    names = data.joint_names[flange], info.name, data.markers[m].name
    told = np.asarray(data.flanges)[rows.pose[own], flange, 3:]
    _refuse_other_turns(F, M, told, vectors, names, carried=not on_hand)
    found = either_way(F, M, names, carried=not on_hand)
    # On the hand F X = Z M; a sensor on the hand that sees the world: F X M = Z.
    at, sensor_at = (found.X, found.Z) if on_hand else (found.Z, found.X)
    markers = list(tree.markers)
    markers[m] = replace(markers[m], X_LA=at)
    tree = with_sensors(tree.with_markers(tuple(markers)), {info.name: sensor_at})
    return _other_markers(data, tree, observations)


def _by_corners(
    data: BodyDataset, tree: BodyTree, cameras: Sequence[SensorRows], flange: int, seed: int
) -> BodyTree:
    """Return a body by cameras on the flange that saw corners at known places in the room.

    With F the flange in its base B, X_BW (X_WC) = F X: the room takes the target's part.
    """
    rng, X_PJ, places = np.random.default_rng((seed, 5)), np.array(tree.X_PJ), {}
    known = known_places(data)
    for rows in cameras:
        placed = placed_by_known(data, tree, rows, rng, known).X_WC
        F, M = data.X_flange[list(placed), flange], np.array(list(placed.values()))
        names = data.joint_names[flange], rows.name, "what it sees"
        told = np.asarray(data.flanges)[list(placed), flange, 3:]
        _refuse_other_turns(F, M, told, None, names, carried=True)
        found = either_way(F, M, names, carried=True, told=False)
        places[rows.name] = found.X
        X_PJ[flange] = inverse(found.Z)
    tree = replace(with_sensors(tree, places), X_PJ=X_PJ)
    located = np.flatnonzero(known)
    return with_others(data, tree, {r.name: r for r in cameras}, list(places), located, seed)


def either_way(
    F: NDArray,
    M: NDArray,
    names: tuple[str, str, str],
    *,
    carried: bool,
    told: bool = True,
) -> HandEye:
    """Return what stands where; refuse poses that fit when they are inverted, and not as they are.

    Of F X = Z M the inverse of either side alone fits as well, with X and Z exchanged: the flange
    carries X, and what it carries is nearer to it than what stands is to its base.

    Args:
        F: Poses of the flange. Shape (K, 4, 4).
        M: What was seen. Shape (K, 4, 4).
        names: Of the flange, the sensor and the target.
        carried: Whether the flange is said to carry the sensor, or else the target.
        told: Whether the sensor's poses were told, or come of corners.

    Raises:
        DataError: If they fit the other way round alone; it names which to invert.
    """
    found = HandEye.from_poses(F, M)
    off = found.misfit(F, M)
    if off < _MISFIT or len(F) < _FEWEST_EITHER:
        return found
    other = HandEye.from_poses(inverse(F), M)
    if other.misfit(inverse(F), M) > SMALLER * off:
        return found
    flange, sensor, target = names
    on, standing = (sensor, target) if carried else (target, sensor)
    near, far = (1e3 * float(np.linalg.norm(one[:3, 3])) for one in (other.X, other.Z))
    cases = []
    if near < CARRIED_NEARER * far:
        cases.append(
            f"invert poses of the flange, which seem to tell the base in it ({on!r} is then "
            f"{near:.0f} mm from the flange)"
        )
    if far < CARRIED_NEARER * near:
        cases += [f"invert the poses that {sensor!r} tells of {target!r}"] * told
        cases.append(
            f"exchange 'on' of both, if {standing!r} is on the flange and {on!r} stands ({far:.0f} "
            "mm from the flange either way)"
        )
    raise DataError(
        f"what {sensor!r} saw contradicts the poses of flange {flange!r}, and fits them the other "
        f"way round: {', or '.join(cases)}"
    )


def _refuse_other_turns(
    F: NDArray,
    M: NDArray,
    of_flange: NDArray,
    of_sensor: NDArray | None,
    names: tuple[str, str, str],
    *,
    carried: bool,
) -> None:
    """Refuse poses that fit once turns are read as they were meant: as angles, w first and so on.

    They must fit better than inverted poses would, which may seem to fit by chance.

    Args:
        F, M: See `either_way`.
        of_flange: Turns of the flange as rotation vectors [rad], as they were told. Shape (K, 3).
        of_sensor: Those of the target in the sensor, if they were told. Shape (K, 3).
        names, carried: See `either_way`.

    Raises:
        DataError: If there are such.
    """
    off = _misfit(F, M)
    if not _MISFIT <= off < np.inf:  # who hardly turns is told so
        return
    off = min(off, _misfit(inverse(F), M) / SMALLER)

    def with_flange(R: NDArray, seen: NDArray = M) -> float:
        return _misfit(transform(R, F[:, :3, 3]), seen)

    def seen_as(R: NDArray) -> NDArray:
        seen = transform(R, (inverse(M) if carried else M)[:, :3, 3])
        return inverse(seen) if carried else seen

    ways = [f"in turns of the flange {way}" for way in meant_turns(off, with_flange, of_flange)]
    if of_sensor is not None:
        said = meant_turns(off, lambda R: _misfit(F, seen_as(R)), of_sensor)
        ways += [f"in the turns that {names[1]!r} tells {way}" for way in said]
    if of_sensor is not None and not ways:
        said = meant_turns(off, lambda R, S: with_flange(R, seen_as(S)), of_flange, of_sensor)
        ways = [f"in turns of both {way}" for way in said]
    if ways:
        raise DataError(
            f"what {names[1]!r} saw contradicts the poses of flange {names[0]!r}, and fits them if "
            f"{', or '.join(ways)}: {AS_CONVENTIONS}"
        )


def _misfit(F: NDArray, M: NDArray) -> float:
    """Return how badly poses fit at best; inf where they hardly turn."""
    try:
        return HandEye.from_poses(F, M).misfit(F, M)
    except DataError:
        return np.inf


def _by_unknown(
    data: BodyDataset, tree: BodyTree, cameras: Sequence[SensorRows], seed: int
) -> BodyTree | None:
    """Return a body by a camera that saw markers of unknown place; None where none tells enough.

    It is on the flange before a room, or stands before the flange.
    """
    rng = np.random.default_rng((seed, 9))
    motion = TreeMotion.at(tree, data.si_readings, data.X_flange)
    for rows in sorted(cameras, key=lambda one: -len(one.rows)):
        link = data.on_link(data.sensors[rows.sensor].on)
        at = on_link_among_unknown(motion, rows, link, rng)
        if at is not None:
            placed = with_sensors(tree, {rows.name: at})
            every = {one.name: one for one in cameras}
            return with_others(data, placed, every, [rows.name], np.zeros(0, dtype=int), seed)
    return None


def _other_markers(data: BodyDataset, tree: BodyTree, observations: TreeObservations) -> BodyTree:
    """Place markers that a sensor of known place measured in space."""
    for rows in observations.sensors:
        if rows.kind in (POSES, POINTS):
            tree = with_markers_seen_by(data, tree, rows)
    return with_orientations(data, tree, observations)


def with_markers_seen_by(data: BodyDataset, tree: BodyTree, rows: SensorRows) -> BodyTree:
    """Place markers that a sensor of known place measured in space, in their links."""
    motion = TreeMotion.at(tree, data.si_readings, data.X_flange)
    markers = list(tree.markers)
    R_WS, p_WS = motion.pose_of(next(s for s in tree.sensors if s.name == rows.name))
    for m in np.unique(rows.marker).tolist():
        own = rows.marker == m
        pose = rows.pose[own]
        p = np.einsum("ijn,nj->ni", R_WS[:, :, pose], rows.measured[own, :3]) + p_WS[:, pose].T
        R_WL = motion.R_WL[markers[m].on][:, :, pose].transpose(2, 0, 1)
        local = p - motion.p_WL[markers[m].on][:, pose].T
        at = np.median((np.swapaxes(R_WL, 1, 2) @ local[:, :, None])[:, :, 0], axis=0)
        markers[m] = replace(markers[m], X_LA=transform(markers[m].X_LA[:3, :3], at))
    return tree.with_markers(tuple(markers))

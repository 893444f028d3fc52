"""First bodies, by what is unknown: from nothing, from a description, from flange poses."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import ANY_POSE, BodyDataset
from nico_selfmodel.dataset.body.sensors import CAMERA, DISTANCE, POINTS, POSES, SIGHTS
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.guesses.among_unknown import on_link_among_unknown
from nico_selfmodel.estimation.tree.guesses.by_first_body import (
    before_tracker,
    with_orientations,
    with_others,
    with_sensors,
    with_tracker,
)
from nico_selfmodel.estimation.tree.guesses.camera_guess import (
    cameras_from_markers,
    resected,
    together,
)
from nico_selfmodel.estimation.tree.guesses.cameras_around import cameras_all_around
from nico_selfmodel.estimation.tree.guesses.carried_cameras import (
    body_from_carried_cameras,
    known_places,
    points_on_known_links,
    reconstructed_by,
    with_known_links,
)
from nico_selfmodel.estimation.tree.guesses.carried_trackers import (
    body_from_carried_poses,
    with_carried_tracker,
)
from nico_selfmodel.estimation.tree.guesses.carrying_joints import with_carrying_joints
from nico_selfmodel.estimation.tree.guesses.flange_guess import from_flange
from nico_selfmodel.estimation.tree.guesses.lost_joints import before_known_joints, with_lost_joints
from nico_selfmodel.estimation.tree.guesses.point_guess import SeenPoints, body_from_points
from nico_selfmodel.estimation.tree.tree_observations import SensorRows, TreeObservations
from nico_selfmodel.estimation.tree.tree_setup import Description
from nico_selfmodel.geometry.alignment import Alignment
from nico_selfmodel.geometry.resection import FEWEST
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_tree import FLANGE, WORLD_NAME, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.names import listed

_TRIES = 4
"""Searches from nothing at most; two that agree end it."""
_FEWEST_COMMON = 3
"""Markers that tracker and cameras saw at the same poses by which they are placed to each other."""
_FAR = 0.15
"""Angle within which a marker of a described robot must appear where it is expected [rad]."""


def first_bodies(
    data: BodyDataset,
    blank: BodyTree,
    observations: TreeObservations,
    description: Description | None,
    standing: Mapping[str, NDArray],
    seed: int,
) -> Iterator[tuple[str, BodyTree]]:
    """Yield labelled bodies to start from, the most trusted first.

    Args:
        blank: The body with nothing known of its geometry.
        standing: Poses of cameras that boards told already, in the first one's frame, by name.

    Raises:
        DataError: If the data cannot tell a first body.
    """
    if description is not None:
        first = _described(data, description, observations, seed)
        yield "robot description", first
        if any(rows.kind == CAMERA for rows in observations.sensors):
            for tree in cameras_all_around(data, first):
                yield "cameras all around", tree
        return
    if any(joint.motion == FLANGE for joint in data.joints):
        yield "hand-eye", from_flange(data, blank, observations, seed)
        return
    for attempt in range(_TRIES):
        drawn = seed + 1000 * attempt
        yield "random axes", _from_nothing(data, blank, observations, standing, drawn)


def _from_nothing(
    data: BodyDataset,
    blank: BodyTree,
    observations: TreeObservations,
    standing_at: Mapping[str, NDArray],
    seed: int,
) -> BodyTree:
    """Return a body from points in space, measured, seen by two cameras, or known on a link."""
    if known_places(data).any():
        return body_from_carried_cameras(data, blank, observations, seed)
    standing = [rows for rows in observations.sensors if data.sensors[rows.sensor].on == "world"]
    trackers = [rows for rows in standing if rows.kind in (POINTS, POSES)]
    cameras = {r.name: r for r in standing if r.kind == CAMERA}
    if trackers:
        tree = _by_trackers(data, blank, trackers, cameras, seed)
        tree = _with_carried(data, tree, observations, seed)
        return with_orientations(data, tree, observations)
    if len(cameras) >= 2 and set(cameras) <= set(standing_at):
        places = dict(standing_at)
        points = reconstructed_by(data, blank, tuple(cameras.values()), places)
    elif len(cameras) >= 2:
        places, points = cameras_from_markers(cameras, blank.lenses, seed)
        factor = _scale(data, points)
        points = replace(points, p_WM=factor * points.p_WM)
        places = {name: _larger(X, factor) for name, X in places.items()}
    elif not any(rows.kind in SIGHTS for rows in observations.sensors):
        raise DataError(
            "touches and distances alone cannot tell a body from nothing: give the robot's "
            "description, or record with two cameras or a tracker, too"
        )
    elif len(cameras) == 1 and any(m.xyz is not None for m in data.markers):
        ((name, rows),) = cameras.items()
        places, points = {name: np.eye(4)}, points_on_known_links(data, blank, rows, seed)
    elif not cameras and (tree := body_from_carried_poses(data, blank, observations, seed)):
        return tree
    else:
        _refuse_cameras(data, cameras)
    tree = _by_cameras(data, blank, cameras, places, points, seed)
    if len(cameras) == 1:
        tree = with_known_links(data, tree, np.unique(points.marker))
    tree = _with_carried(data, tree, observations, seed)
    return with_orientations(data, tree, observations)


def _refuse_cameras(data: BodyDataset, standing: Mapping[str, SensorRows]) -> NoReturn:
    """Say why cameras cannot tell a body from nothing."""
    carried = [s.name for s in data.sensors if s.kind == CAMERA and s.name not in standing]
    if carried:
        raise DataError(
            f"no camera stands in the world, of {listed(carried)}, and nothing tells where they "
            "moved: let them see six markers or more whose places in the room are known (xyz), or "
            "tell whole poses of a tag there (kind 'poses'), or give the robot's description"
        )
    raise DataError(
        "one camera alone cannot tell a body from nothing: give the robot's description, "
        "whose lengths tell it, say where six markers or more are on their link (xyz), or record "
        "with two cameras or a tracker"
    )


def _by_cameras(
    data: BodyDataset,
    blank: BodyTree,
    cameras: Mapping[str, SensorRows],
    places: Mapping[str, NDArray],
    points: SeenPoints,
    seed: int,
) -> BodyTree:
    """Return a body by points in space, and what else its cameras tell of it.

    Args:
        blank: The body with nothing known of its geometry.
        cameras: What standing cameras saw, by name.
        places: Where some of them stand. Shape (4, 4) each.
        points: Markers in space.
    """
    tree = body_from_points(data, with_sensors(blank, places), points, seed, sized=False)
    located = np.unique(points.marker)
    tree = with_others(data, tree, cameras, list(places), located, seed)
    return with_lost_joints(data, tree, cameras, located, seed)


def _by_trackers(
    data: BodyDataset,
    blank: BodyTree,
    trackers: Sequence[SensorRows],
    cameras: Mapping[str, SensorRows],
    seed: int,
) -> BodyTree:
    """Return a body in the first tracker's frame, with cameras that saw the same or something else.

    Cameras that share no markers with the tracker find a body of their own, in which the tracker is
    placed then; one camera alone is placed by the tracker's.
    """
    first, rng = trackers[0], np.random.default_rng(seed)
    tracked = SeenPoints(first.pose, first.marker, first.measured[:, :3])
    points, seen = tracked, [rows.marker for rows in cameras.values()]
    places: dict[str, NDArray] | None = None
    if len(cameras) >= 2 and not np.isin(np.concatenate(seen), tracked.marker).all():
        places, apart = cameras_from_markers(cameras, blank.lenses, seed)
        points = apart
        if _common(tracked, apart) >= _FEWEST_COMMON:
            points, places = _joined(tracked, apart), None
    if places is not None:
        tree = _by_cameras(data, blank, cameras, places, points, seed)
        tree = before_tracker(data, tree, first)
    elif all(len(together(rows, points)[0]) >= FEWEST for rows in cameras.values()):
        at = {n: resected(r, blank.lenses[n], points, n, rng) for n, r in cameras.items()}
        tree = _by_cameras(data, blank, cameras, at, points, seed)
    else:
        tree = body_from_points(data, blank, points, seed)
        located = np.unique(points.marker)
        before = before_known_joints(data, tree, cameras, located, seed)
        tree = before or next(cameras_all_around(data, tree))
    for rows in trackers[1:]:
        tree = with_tracker(data, tree, rows)
    return tree


def _common(one: SeenPoints, other: SeenPoints) -> int:
    """Return how many markers two saw at the same poses."""
    keys = (set(zip(p.pose.tolist(), p.marker.tolist(), strict=True)) for p in (one, other))
    return len(set.intersection(*keys))


def _joined(tracked: SeenPoints, seen: SeenPoints) -> SeenPoints:
    """Return tracked points, and those that cameras reconstructed, in the tracker's frame."""
    most = int(max(tracked.marker.max(), seen.marker.max())) + 1
    one, two = (points.pose * most + points.marker for points in (tracked, seen))
    _, i, j = np.intersect1d(one, two, return_indices=True)
    found = Alignment.from_points(seen.p_WM[j], tracked.p_WM[i], with_scale=True)
    alone = ~np.isin(two, one)
    moved = found.scale * seen.p_WM[alone] @ found.rotation.T + found.translation
    return SeenPoints(
        np.append(tracked.pose, seen.pose[alone]),
        np.append(tracked.marker, seen.marker[alone]),
        np.vstack([tracked.p_WM, moved]),
    )


def _larger(X: NDArray, factor: float) -> NDArray:
    return transform(X[:3, :3], factor * X[:3, 3])


def _scale(data: BodyDataset, points: SeenPoints) -> float:
    """Return what makes reconstructed points as large as known distances say, by the median.

    Without any the points' rms distance from their middle becomes 0.3 m.
    """
    table = data.observations
    known = np.array([s.kind == DISTANCE for s in data.sensors])[table.sensor]
    ratios = []
    for row in np.flatnonzero(known):
        a, b = (points.of_markers(np.array([table.marker[row], table.other[row]])), table.pose[row])
        one, two = (a.of_markers(np.array([m[row]])) for m in (table.marker, table.other))
        _, i, j = np.intersect1d(one.pose, two.pose, return_indices=True)
        keep = np.ones(len(i), dtype=bool) if b == ANY_POSE else one.pose[i] == b
        d = np.linalg.norm(one.p_WM[i] - two.p_WM[j], axis=1)[keep]
        if len(d):
            ratios.append(table.values[row, 0] / float(np.median(d)))
    if ratios:
        return float(np.median(ratios))
    return 0.3 / float(np.sqrt(np.var(points.p_WM, axis=0).sum()))


def _described(
    data: BodyDataset, description: Description, observations: TreeObservations, seed: int
) -> BodyTree:
    """Return the described robot with its sensors where they see it."""
    tree, rng = description.tree, np.random.default_rng((seed, 4))
    motion = TreeMotion.at(tree, data.si_readings, data.X_flange)
    places = {}
    for rows in observations.sensors:
        info = data.sensors[rows.sensor]
        if info.kind not in SIGHTS:
            continue
        if info.X_LS is not None:
            places[info.name] = info.X_LS
        elif rows.kind == CAMERA:
            places[info.name] = _on_its_link(motion, rows, data.on_link(info.on), rng, _FAR)
        elif (beside := with_carried_tracker(data, tree, rows)) is not None:
            tree = beside
        else:
            p_LM = motion.points_from(data.on_link(info.on), rows.marker, rows.pose)
            found = Alignment.from_points(rows.measured[:, :3], p_LM)
            places[info.name] = transform(found.rotation, found.translation)
    return with_orientations(data, with_sensors(tree, places), observations)


def _with_carried(
    data: BodyDataset, tree: BodyTree, observations: TreeObservations, seed: int
) -> BodyTree:
    """Return a body with cameras on its links, by markers that what stands has placed, and others.

    Raises:
        DataError: If a camera saw too little to be placed.
    """
    table, rng = data.observations, np.random.default_rng((seed, 8))
    standing = np.array([sensor.on == WORLD_NAME for sensor in data.sensors])[table.sensor]
    located = np.unique(np.append(table.marker[standing], np.flatnonzero(known_places(data))))
    cameras = {
        rows.name: rows
        for rows in observations.sensors
        if rows.kind == CAMERA and data.sensors[rows.sensor].on != WORLD_NAME and not rows.mirror
    }
    told = {s.name: s.X_LS for s in data.sensors if s.name in cameras and s.X_LS is not None}
    tree = with_sensors(tree, told)
    tree, found = with_carrying_joints(data, tree, cameras, frozenset(told), located, seed)
    motion, places = TreeMotion.at(tree, data.si_readings, data.X_flange), {}
    for name, rows in cameras.items():
        if name not in told and name not in found:
            places[name] = _carried_at(data, motion, rows, located, rng)
    tree = with_sensors(tree, places)
    return with_others(data, tree, cameras, list(cameras), located, seed) if cameras else tree


def _carried_at(
    data: BodyDataset,
    motion: TreeMotion,
    rows: SensorRows,
    located: NDArray,
    rng: np.random.Generator,
) -> NDArray:
    """Return where a camera is on its link, by markers that are placed, else by how it moves.

    Raises:
        DataError: If it saw too little for either.
    """
    link = data.on_link(data.sensors[rows.sensor].on)
    own = np.isin(rows.marker, located)
    carried = np.array([marker.on == link for marker in motion.tree.markers])[rows.marker]
    # What its own link carries is where it was in every picture.
    told = int((own & ~carried).sum()) + len(np.unique(rows.marker[own & carried]))
    if told >= FEWEST:
        return _on_its_link(motion, rows.only(own), link, rng)
    found = on_link_among_unknown(motion, rows, link, rng)
    if found is None:
        raise DataError(
            f"camera {rows.name!r} on {data.sensors[rows.sensor].on!r} saw {told} markers that "
            f"something else places, {FEWEST} are needed to tell where it is, or others from many "
            "poses each: say where markers in the room are (xyz), let what stands see some of them "
            "too, or tell its tags' whole poses (kind 'poses')"
        )
    return found


def _on_its_link(
    motion: TreeMotion,
    rows: SensorRows,
    link: int,
    rng: np.random.Generator,
    within: float = 0.05,
) -> NDArray:
    """Return where a camera is on its link that saw markers whose places are known. (4, 4)."""
    numbered = np.arange(len(rows.rows))
    seen = motion.points_from(link, rows.marker, rows.pose)
    points = SeenPoints(numbered, np.zeros_like(numbered), seen)
    alone: SensorRows = replace(rows, pose=numbered, marker=np.zeros_like(numbered))
    return resected(alone, motion.tree.lenses[rows.name], points, rows.name, rng, within)

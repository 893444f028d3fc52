"""A first body whose cameras turn with its joints, from markers at known places in the room.

A camera that sees six known points tells its own pose (resection). Three points fixed to it, seen
so from the room, are markers like any others: the search for axes finds the joints that carry them.
What two cameras see at once is reconstructed by where they are.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.sensors import CAMERA, MarkerInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.boards.board_pose import board_poses_seen, is_flat
from nico_selfmodel.estimation.tree.guesses.by_first_body import with_others, with_sensors
from nico_selfmodel.estimation.tree.guesses.camera_guess import together
from nico_selfmodel.estimation.tree.guesses.point_guess import SeenPoints, body_from_points
from nico_selfmodel.estimation.tree.tree_observations import SensorRows, TreeObservations
from nico_selfmodel.geometry.alignment import Alignment
from nico_selfmodel.geometry.resection import FEWEST, agreeing, cosines, robust_camera_pose
from nico_selfmodel.geometry.rotation import nearest_rotation
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.model.tree.body_tree import WORLD_NAME, Attached, BodyTree
from nico_selfmodel.names import listed

_WITHIN = 0.02
"""Angle between a ray and its known point within which they agree [rad]."""
_DRAWS = 20
"""Sets of six points that are tried for a pose of a camera."""
_ARM = 0.1
"""Distance of the points that stand for a camera's axes from its centre [m]."""
_CORNERS = _ARM * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_LEAST_ANGLE = 0.02
"""Angle between two rays below which they do not tell a depth [rad]."""


@dataclass(frozen=True, eq=False)
class PlacedCamera:
    """Where a camera was at the samples at which it saw enough known markers."""

    rows: SensorRows
    X_WC: Mapping[int, NDArray]
    """By sample. Shape (4, 4) each."""


def body_from_carried_cameras(
    data: BodyDataset, blank: BodyTree, observations: TreeObservations, seed: int
) -> BodyTree:
    """Return a body whose joints, cameras and markers are where markers of known place ask for.

    Args:
        blank: The body with nothing known of its geometry but the places of known markers.

    Raises:
        DataError: If a camera hardly ever saw six of the known markers, or what moves was seen too
            rarely or never.
    """
    _check_seen(data, blank)
    rng = np.random.default_rng((seed, 5))
    known = known_places(data)
    placed = [
        placed_by_known(data, blank, rows, rng, known)
        for rows in observations.sensors
        if rows.kind == CAMERA
    ]
    seen = _reconstructed_by_all(data, blank, placed)
    whole = body_by_carried(data, blank, placed, [seen], seed)
    located = np.unique(np.append(seen.marker, np.flatnonzero(known_places(data))))
    by_name = {item.rows.name: item.rows for item in placed}
    return with_others(data, whole, by_name, list(by_name), located, seed)


def body_by_carried(
    data: BodyDataset,
    blank: BodyTree,
    placed: Sequence[PlacedCamera],
    others: Sequence[SeenPoints],
    seed: int,
) -> BodyTree:
    """Return a body whose joints and sensors are where these were at many samples.

    Args:
        blank: The body with nothing known of its geometry.
        placed: Where sensors on its links were.
        others: Markers in space.

    Raises:
        DataError: If a link's points are too few for its joints.
    """
    sensors = [blank.sensors[_sensor(blank, data, item.rows)] for item in placed]
    first = len(blank.markers)
    corners = [
        Attached(f"{sensor.name} corner {k}", sensor.on) for sensor in sensors for k in range(3)
    ]
    names = [*data.joint_names, "world"]
    infos = tuple(MarkerInfo(corner.name, names[corner.on]) for corner in corners)
    extended = replace(data, markers=(*data.markers, *infos))
    tree = blank.with_markers((*blank.markers, *corners))
    points = [_corners(item, first + 3 * c) for c, item in enumerate(placed)]
    found = body_from_points(extended, tree, _all_of([*points, *others]), seed)
    places = {}
    for c, sensor in enumerate(sensors):
        p = np.array([m.X_LA[:3, 3] for m in found.markers[first + 3 * c : first + 3 * c + 3]])
        x, y = (p[1:] - p[0]) / _ARM
        places[sensor.name] = transform(
            nearest_rotation(np.column_stack([x, y, np.cross(x, y)])), p[0]
        )
    return with_sensors(found.with_markers(found.markers[:first]), places)


def _check_seen(data: BodyDataset, blank: BodyTree) -> None:
    """Refuse joints that moved, and moved nothing that sees or is seen."""
    table, beyond = data.observations, blank.beyond
    links = [blank.markers[m].on for m in np.unique(table.marker).tolist()]
    links += [sensor.on for sensor in blank.sensors]
    moved = np.ptp(np.asarray(data.si_readings), axis=0) > 0.0
    idle = np.flatnonzero(moved & ~beyond[links].any(axis=0)).tolist()
    if idle:
        names = listed([data.joint_names[i] for i in idle])
        raise DataError(
            f"data set {data.name!r}: the cameras saw nothing that {names} move: let the head look "
            "at the markers there, or record without these joints"
        )


def _sensor(tree: BodyTree, data: BodyDataset, rows: SensorRows) -> int:
    return [s.name for s in tree.sensors].index(rows.name)


def known_places(data: BodyDataset) -> NDArray:
    """Return which markers stand at known places in the room. Boolean, shape (m,)."""
    return _known_on(data, WORLD_NAME)


def _known_on(data: BodyDataset, link: str) -> NDArray:
    """Return which markers are at known places on a link. Boolean, shape (m,)."""
    return np.array([m.xyz is not None and m.on == link for m in data.markers], dtype=bool)


def placed_by_known(
    data: BodyDataset,
    blank: BodyTree,
    rows: SensorRows,
    rng: np.random.Generator,
    known: NDArray,
) -> PlacedCamera:
    """Place a camera at every sample at which it saw enough markers of known place on one link.

    Args:
        blank: The body with its lenses and the places of known markers.
        known: Which markers these are, of the room or of a link that takes its part. Shape (m,).

    Raises:
        DataError: If there are fewer than six such samples.
    """
    places = np.array([m.X_LA[:3, 3] for m in blank.markers])
    name = rows.name
    rays = blank.lenses[name].directions(rows.measured)
    # At a fold of its lens a camera may have no ray for a pixel.
    usable = known[rows.marker] & np.isfinite(rays).all(axis=1)
    found: dict[int, NDArray] = {}
    for sample in np.unique(rows.pose).tolist():
        own = np.flatnonzero((rows.pose == sample) & usable)
        if len(own) < FEWEST:
            continue
        p = places[rows.marker[own]]
        X, agree = pose_before(p, rays[own], rng)
        if agree.sum() >= FEWEST:
            found[sample] = X
    if len(found) < FEWEST:
        raise DataError(
            f"camera {name!r} saw {FEWEST} of the markers at known places in {len(found)} samples, "
            f"{FEWEST} samples are needed at least: let it look at them from more poses"
        )
    return PlacedCamera(rows, found)


def points_on_known_links(
    data: BodyDataset, blank: BodyTree, rows: SensorRows, seed: int
) -> SeenPoints:
    """Return three markers of each link with places known on it, in a standing camera's frame.

    Args:
        blank: The body with its lenses and the places of known markers.

    Raises:
        DataError: If it saw a link with six such markers in fewer than six samples.
    """
    rng, points = np.random.default_rng((seed, 5)), []
    for link in data.joint_names:
        known = _known_on(data, link)
        if known.sum() < FEWEST:
            continue
        own = _three_apart(blank, np.flatnonzero(known))
        p_L = np.array([blank.markers[m].X_LA[:3, 3] for m in own.tolist()])
        for sample, X_LC in placed_by_known(data, blank, rows, rng, known).X_WC.items():
            points.append(SeenPoints(np.full(len(own), sample), own, apply(inverse(X_LC), p_L)))
    return _all_of(points)


def _three_apart(blank: BodyTree, own: NDArray) -> NDArray:
    """Return three of some markers that stand for their link: far apart, and on no line."""
    p = np.array([blank.markers[m].X_LA[:3, 3] for m in own.tolist()])
    i, j = np.unravel_index(np.argmax(np.sum((p[:, None] - p) ** 2, axis=2)), (len(p), len(p)))
    along = (p[j] - p[i]) / np.linalg.norm(p[j] - p[i])
    beside = np.linalg.norm(np.cross(p - p[i], along), axis=1)
    return own[[i, j, int(np.argmax(beside))]]


def with_known_links(data: BodyDataset, tree: BodyTree, located: NDArray) -> BodyTree:
    """Return a body with all markers of known places on links, by three of each that are located.

    Args:
        tree: A body with these three where they were found.
        located: Which markers they are.
    """
    markers = list(tree.markers)
    for link in data.joint_names:
        known = _known_on(data, link)
        own = [m for m in located.tolist() if known[m]]
        if len(own) < len(_CORNERS):
            continue
        told = np.array([marker.xyz or (0.0, 0.0, 0.0) for marker in data.markers])
        found = Alignment.from_points(told[own], np.array([markers[m].X_LA[:3, 3] for m in own]))
        at = told @ found.rotation.T + found.translation
        for m in np.flatnonzero(known).tolist():
            markers[m] = replace(markers[m], X_LA=transform(markers[m].X_LA[:3, :3], at[m]))
    return tree.with_markers(tuple(markers))


def pose_before(p: NDArray, rays: NDArray, rng: np.random.Generator) -> tuple[NDArray, NDArray]:
    """Return X_WC of a camera before known points, which may be a flat board's, and who agrees.

    Args:
        p: Points. Shape (N, 3), N >= 6.
        rays: Unit directions in which the camera sees them. Shape (N, 3).
    """
    flat = board_poses_seen(p, rays) if is_flat(p) else None
    if flat is None:
        return robust_camera_pose(p, rays, _WITHIN, rng, _DRAWS)
    two = [
        (X, agreeing(X, p, rays, _WITHIN), cosines(X, p, rays).sum()) for X in map(inverse, flat)
    ]
    X, agree, _ = max(two, key=lambda one: (one[1].sum(), one[2]))
    return X, agree


def _corners(item: PlacedCamera, first: int) -> SeenPoints:
    """Return the points that stand for a camera, where it was."""
    samples = np.array(list(item.X_WC))
    X = np.array(list(item.X_WC.values()))
    p = np.einsum("nij,kj->nki", X[:, :3, :3], _CORNERS) + X[:, None, :3, 3]
    marker = np.tile(first + np.arange(3), len(samples))
    return SeenPoints(np.repeat(samples, 3), marker, p.reshape(-1, 3))


def reconstructed_by(
    data: BodyDataset,
    blank: BodyTree,
    seen: Sequence[SensorRows],
    places: Mapping[str, NDArray],
) -> SeenPoints:
    """Return markers of unknown place that two cameras saw at once which stand still.

    Args:
        blank: The body, with its lenses.
        places: X_WC by name. Shape (4, 4) each.
    """
    placed = [
        PlacedCamera(rows, dict.fromkeys(rows.pose.tolist(), places[rows.name])) for rows in seen
    ]
    return _reconstructed_by_all(data, blank, placed)


def _reconstructed_by_all(
    data: BodyDataset, blank: BodyTree, placed: Sequence[PlacedCamera]
) -> SeenPoints:
    pairs = [(a, b) for i, a in enumerate(placed) for b in placed[i + 1 :]]
    return _all_of([_reconstructed(data, blank, a, b) for a, b in pairs])


def _reconstructed(
    data: BodyDataset, blank: BodyTree, a: PlacedCamera, b: PlacedCamera
) -> SeenPoints:
    """Return markers of unknown place that two cameras saw at once, in the middle of their rays."""
    i, j = together(a.rows, b.rows)
    unknown = np.array([m.xyz is None for m in data.markers])[a.rows.marker[i]]
    both = np.array([pose in a.X_WC and pose in b.X_WC for pose in a.rows.pose[i].tolist()], bool)
    i, j = i[unknown & both], j[unknown & both]
    pose, marker = a.rows.pose[i], a.rows.marker[i]
    lines = []
    for item, rows in ((a, i), (b, j)):
        X = np.array([item.X_WC[p] for p in pose.tolist()]).reshape(-1, 4, 4)
        lens = blank.lenses[item.rows.name]
        d = lens.directions(item.rows.measured[rows])
        lines.append((X[:, :3, 3], np.einsum("nij,nj->ni", X[:, :3, :3], d)))
    (p, d), (q, e) = lines
    # s, t of |p + s d - q - t e| least: d.(p - q) + s - t c = 0, e.(p - q) + s c - t = 0.
    c, apart = np.sum(d * e, axis=1), q - p
    sine = np.maximum(1.0 - c * c, 1e-12)
    s = (np.sum(d * apart, axis=1) - c * np.sum(e * apart, axis=1)) / sine
    t = (c * np.sum(d * apart, axis=1) - np.sum(e * apart, axis=1)) / sine
    middle = 0.5 * (p + s[:, None] * d + q + t[:, None] * e)
    with np.errstate(invalid="ignore"):
        good = (s > 0.0) & (t > 0.0) & (sine > _LEAST_ANGLE**2)
    return SeenPoints(pose[good], marker[good], middle[good])


def _all_of(points: Sequence[SeenPoints]) -> SeenPoints:
    none = SeenPoints(np.zeros(0, dtype=int), np.zeros(0, dtype=int), np.zeros((0, 3)))
    parts = (none, *points)
    return SeenPoints(
        np.concatenate([part.pose for part in parts]),
        np.concatenate([part.marker for part in parts]),
        np.concatenate([part.p_WM for part in parts]),
    )

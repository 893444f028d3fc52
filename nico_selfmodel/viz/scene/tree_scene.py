"""A body learned from any sensors as a scene: its tree, what it carries, what saw it."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.rotation import frame_along, tangent_basis
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.tree.body_tree import FREE, WHOLE_POSES, WORLD, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.names import called
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.scene.camera_items import ImagePlane, camera_items
from nico_selfmodel.viz.scene.mirror_picture import plate_items
from nico_selfmodel.viz.scene.scene import LegendEntry, Scene, path_names
from nico_selfmodel.viz.scene.scene_items import Cylinder, Item, Markers, Triad, Tube
from nico_selfmodel.viz.scene.surroundings import camera_from, floor_items, turned, with_room

_PLANE, _OWN_PLANE = 0.25, 0.07
"""Distance of a camera's image from its centre, in units of the body's size: of cameras that stand
in the world, and of those that the body carries."""
_GLASS = palette.rgba("#8fb4d9", 0.45)
_MOST_SEEN = 400
"""Places of markers that are drawn: more say no more."""
_ROOM = 0.12
"""Left around points for what is drawn about them, in units of the body's size."""
_AZIMUTH, _FACING = -1.2, -0.75
"""From behind a camera that is the world, a little aside; on a body that looks along x, aside."""


def tree_scene(name: str, tree: BodyTree, data: BodyDataset) -> Scene:
    """Describe a body in the recorded pose nearest to the middle of all.

    Where the world is a camera the scene stands as that camera looks: its own up is up.
    """
    motion = TreeMotion.at(tree, *_middle(data))
    unit = _size(tree, motion)
    items = [item for _, item in carried_items(tree, motion)]
    X_SW, glasses, seen = _upright(tree), _glasses(tree, data), _seen_points(tree, data)
    items += [item for name, plate in glasses.items() for item in _glass_items(name, plate)]
    items += _cloud(seen, unit)
    centres, markers = axis_points(tree, motion), motion.places(tree.markers)[0]
    sensors = np.array([motion.pose_of(s)[1][:, 0] for s in tree.sensors]).reshape(-1, 3)
    points = apply(X_SW, np.vstack([centres, markers, sensors, seen, *glasses.values()]))
    own = _of_body(tree)
    near = apply(X_SW, np.vstack([centres, markers[own], sensors, seen, *glasses.values()]))
    behind = any(sensor.on == WORLD for sensor in tree.sensors)
    view = camera_from(with_room(near, _ROOM * unit), _AZIMUTH if behind else _FACING)
    floor = floor_items(points, 0.5 * unit, X_SW)
    return Scene(
        name, (*floor, *turned(items, X_SW)), view, tuple(_legend(tree, cloud=len(seen) > 0))
    )


def _middle(data: BodyDataset) -> tuple[NDArray, NDArray]:
    """Return readings and flanges of the pose nearest to the middle of all, as if of one row."""
    q, X = data.si_readings, data.X_flange
    poses = np.concatenate([q, X[:, :, :3, 3].reshape(len(q), -1)], axis=1)
    row = int(np.argmin(np.sum((poses - np.median(poses, axis=0)) ** 2, axis=1)))
    return q[row : row + 1], X[row : row + 1]


def _seen_points(tree: BodyTree, data: BodyDataset) -> NDArray:
    """Return where what the body carries was when it was seen, evenly of many. Shape (n, 3)."""
    table = data.observations
    free = {i for i, motion in enumerate(tree.motions) if motion == FREE}
    carried = np.array([m.on != WORLD and m.on not in free for m in tree.markers])
    pairs = np.stack([table.marker, table.pose], axis=1)
    pairs = np.unique(pairs[carried[table.marker] & (table.pose >= 0)], axis=0)
    if not len(pairs):
        return np.zeros((0, 3))
    chosen = pairs[np.linspace(0, len(pairs) - 1, min(len(pairs), _MOST_SEEN)).astype(int)]
    poses, pose = np.unique(chosen[:, 1], return_inverse=True)
    told = (told[poses] for told in (data.si_readings, data.X_flange, data.si_approach))
    return TreeMotion.at(tree, *told).points(chosen[:, 0], pose)


def _cloud(seen: NDArray, unit: float) -> list[Item]:
    """Return where the markers were seen as small grey balls."""
    if not len(seen):
        return []
    color = palette.rgba(palette.TRAINING)
    return [Markers(path="seen/poses", color=color, centers=seen, radius=0.006 * unit)]


def carried_items(tree: BodyTree, motion: TreeMotion) -> list[tuple[int, Item]]:
    """Return what a body is drawn by, each with the link that carries it.

    Returns:
        Links and items, in W.
    """
    unit = _size(tree, motion)
    centres, markers = axis_points(tree, motion), motion.places(tree.markers)[0]
    return [
        *_links(tree, centres, markers, unit),
        *_joints(tree, motion, centres, 0.6 * unit),
        *_markers(tree, markers, unit),
        *_sensors(tree, motion, unit),
    ]


def _size(tree: BodyTree, motion: TreeMotion) -> float:
    """Return how large a body and what it carries are at a pose [m]."""
    carried = _of_body(tree)
    bases = motion.p_WJ[np.isin(tree.motions, WHOLE_POSES), :, 0]
    points = np.vstack([axis_points(tree, motion), bases, motion.places(tree.markers)[0][carried]])
    return max(float(np.linalg.norm(np.ptp(points, axis=0))), 1e-3)


def _of_body(tree: BodyTree) -> NDArray:
    """Return which markers the body carries; all of a body that only looks. Boolean, shape (m,)."""
    carried = np.array([marker.on != WORLD for marker in tree.markers], dtype=bool)
    return carried if carried.any() else ~carried


def axis_points(tree: BodyTree, motion: TreeMotion) -> NDArray:
    """Choose a point on every axis: the one nearest to what it carries. Shape (n, 3).

    Estimates may hold a joint's frame anywhere along its axis. A joint whose whole pose is read or
    learned has no axis: its point is where it has moved to.
    """
    n = len(tree.joints)
    whole = np.isin(tree.motions, WHOLE_POSES)
    out = np.where(whole[:, None], motion.p_WL[:-1, :, 0], motion.p_WJ[:, :, 0])
    carried: list[list[NDArray]] = [[] for _ in range(n)]
    for marker in tree.markers:
        if marker.on != WORLD:
            carried[marker.on].append(motion.pose_of(marker)[1][:, 0])
    for i in range(n - 1, -1, -1):
        z = motion.R_WJ[i, :, 2, 0]
        if carried[i] and not whole[i]:
            target = np.mean(carried[i], axis=0)
            out[i] += ((target - out[i]) @ z) * z
        parent = int(tree.parent[i])
        if parent != WORLD:
            carried[parent].append(out[i])
    return out


def _upright(tree: BodyTree) -> NDArray:
    """Return the world in a scene whose z is up: turned where the world is a camera."""
    cameras = [s for s in tree.sensors if s.name in tree.lenses and s.on == WORLD]
    at_origin = [s for s in cameras if np.allclose(s.X_LA, np.eye(4))]
    if not at_origin:
        return np.eye(4)
    # The camera's z looks forward, its y down.
    return transform(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]), np.zeros(3))


def _links(
    tree: BodyTree, centres: NDArray, markers: NDArray, unit: float
) -> list[tuple[int, Item]]:
    """Return a rod from each joint to its parent, and a thin one to each marker.

    Joints that stand in the world are joined by thin rods: arms and neck of one trunk.
    """
    items: list[tuple[int, Item]] = []
    standing = np.flatnonzero(tree.parent == WORLD)
    middle = centres[standing].mean(axis=0)
    for i in standing.tolist() if len(standing) > 1 else ():
        path = f"body/trunk_{path_names(tree.joints)[i]}"
        items += ((WORLD, rod) for rod in _rod(path, middle, centres[i], 0.008 * unit))
    for i, name in enumerate(path_names(tree.joints)):
        parent = int(tree.parent[i])
        if parent != WORLD:
            ends = centres[parent], centres[i]
            items += ((parent, rod) for rod in _rod(f"body/link_{name}", *ends, 0.016 * unit))
    for name, marker, p in zip(
        path_names(m.name for m in tree.markers), tree.markers, markers, strict=True
    ):
        if marker.on != WORLD:
            ends = centres[marker.on], p
            items += ((marker.on, rod) for rod in _rod(f"body/to_{name}", *ends, 0.004 * unit))
    return items


def _rod(path: str, start: NDArray, end: NDArray, radius: float) -> list[Item]:
    if np.linalg.norm(end - start) < 1e-6:
        return []
    points = np.stack([start, end])
    return [Tube(path=path, color=palette.rgba(palette.LINK), points=points, radius=radius)]


def _joints(
    tree: BodyTree, motion: TreeMotion, centres: NDArray, unit: float
) -> list[tuple[int, Item]]:
    items: list[tuple[int, Item]] = []
    for i, name in enumerate(path_names(tree.joints)):
        z = motion.R_WJ[i, :, 2, 0]
        drawn = Cylinder(
            path=f"body/joint_{name}",
            color=palette.rgba(palette.joint_color(i)),
            X_WI=transform(frame_along(z), centres[i]),
            radius=0.028 * unit,
            length=0.07 * unit,
        )
        items.append((i, drawn))
    return items


def _markers(tree: BodyTree, markers: NDArray, unit: float) -> list[tuple[int, Item]]:
    on, names = np.array([marker.on for marker in tree.markers]), path_names(tree.joints)
    items: list[tuple[int, Item]] = []
    for link in np.unique(on).tolist():
        drawn = Markers(
            path=f"markers/{'world' if link == WORLD else names[link]}",
            color=palette.rgba(palette.HELD_OUT),
            centers=markers[on == link],
            radius=0.012 * unit,
            shape="diamond",
        )
        items.append((link, drawn))
    return items


def _sensors(tree: BodyTree, motion: TreeMotion, unit: float) -> list[tuple[int, Item]]:
    items: list[tuple[int, Item]] = []
    for name, sensor in zip(path_names(s.name for s in tree.sensors), tree.sensors, strict=True):
        X = motion.poses(sensor)[0]
        if sensor.name in tree.lenses:
            share = _PLANE if sensor.on == WORLD else _OWN_PLANE
            plane = ImagePlane(tree.lenses[sensor.name].at(X), share * unit)
            items += ((sensor.on, item) for item in camera_items(name, plane, None))
        else:
            axes = Triad(
                path=f"sensors/{name}",
                color=(1.0,) * 4,
                X_WI=X,
                length=0.1 * unit,
                radius=0.006 * unit,
            )
            items.append((sensor.on, axes))
    return items


def _glasses(tree: BodyTree, data: BodyDataset) -> dict[str, NDArray]:
    """Return corners of the part of each mirror that something was seen in. Shape (4, 3) each."""
    motion = TreeMotion.at(tree, data.si_readings, data.X_flange, data.si_approach)
    table, out = data.observations, {}
    sensors = {sensor.name: motion.pose_of(sensor)[1] for sensor in tree.sensors}
    for name, path in zip(data.mirrors, path_names(data.mirrors), strict=True):
        rows, plane = np.flatnonzero(table.mirror == name), tree.mirror(name).plane
        virtual = reflect(plane, motion.points(table.marker[rows], table.pose[rows]))
        by = [data.sensors[s].name for s in table.sensor[rows].tolist()]
        pose = table.pose[rows].tolist()
        centres = np.stack([sensors[s][:, k] for s, k in zip(by, pose, strict=True)])
        meets = plane.met_between(centres, virtual)
        axes = tangent_basis(plane.normal).T
        flat = meets @ axes.T
        low, high = np.percentile(flat, (2.0, 98.0), axis=0)
        square = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
        out[path] = square @ axes - plane.offset * plane.normal
    return out


def _glass_items(path: str, plate: NDArray) -> list[Item]:
    """Return a mirror as a plate with an edge."""
    size = 0.004 * float(np.linalg.norm(np.ptp(plate, axis=0)))
    return plate_items(f"mirrors/{path}", plate, plate, _GLASS, size)


def _legend(tree: BodyTree, *, cloud: bool) -> list[LegendEntry]:
    joints = [
        LegendEntry(name, palette.rgba(palette.joint_color(i)))
        for i, name in enumerate(tree.joints)
    ]
    mirrors = [LegendEntry(called("mirror", mirror.name), _GLASS) for mirror in tree.mirrors]
    markers = [LegendEntry("markers", palette.rgba(palette.HELD_OUT))]
    if cloud:
        markers.append(LegendEntry("where they were seen", palette.rgba(palette.TRAINING)))
    return [*joints, *markers, *mirrors]

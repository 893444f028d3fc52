"""Cameras and mirrors about boards: what sees one board at once stands where both see it."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.boards.board_pose import mean_pose, mirrored_back
from nico_selfmodel.estimation.tree.boards.board_views import (
    MIRRORED,
    BoardView,
    board_views,
    places_on_boards,
)
from nico_selfmodel.estimation.tree.boards.mirrors_alone import mirrors_alone
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.reflection import reflection, symmetry_plane
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.tree.body_tree import WORLD_NAME, BodyTree
from nico_selfmodel.model.tree.standing_mirror import StandingMirror
from nico_selfmodel.names import listed

_Key = tuple[int, int]
"""Sample and joint of a board."""
_ASIDE = 0.12
"""How far aside of their normals reflections may lie, in sizes of the board, for a rough lens."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What stands about boards."""

    cameras: Mapping[str, NDArray]
    """Poses by name, of cameras that share boards with the first, in its frame. (4, 4) each."""
    mirrors: tuple[StandingMirror, ...]
    """The mirrors in which boards were seen, in that frame."""

    @classmethod
    def of_boards(cls, observations: TreeObservations, lenses: Mapping[str, Camera]) -> Self:
        """Place the cameras that stand in the world, and the mirrors.

        Args:
            lenses: Intrinsics of the cameras, by name.

        Raises:
            DataError: If what was seen in a mirror is no reflection.
            NotIdentifiableError: If the views leave a mirror open.
        """
        data = observations.data
        standing = {sensor.name for sensor in data.sensors if sensor.on == WORLD_NAME}
        views = [view for view in board_views(observations, lenses) if view.camera in standing]
        if not views:
            return cls({}, ())
        cameras = _placed_cameras(views, {views[0].camera: np.eye(4)})
        known = [view for view in views if view.camera in cameras]
        return cls(cameras, _placed_mirrors(known, cameras, data))

    def alone(self, blank: BodyTree) -> BodyTree:
        """Return a body of which nothing but boards was seen, with its cameras where they are."""
        places = self.cameras
        sensors = tuple(replace(s, X_LA=places.get(s.name, s.X_LA)) for s in blank.sensors)
        return self.about(replace(blank, sensors=sensors))

    def about(self, tree: BodyTree) -> BodyTree:
        """Return a body with the mirrors, its first camera where the body has it."""
        if not self.mirrors:
            return tree
        X_WC = tree.camera(next(iter(self.cameras))).X_WC
        return tree.with_mirrors(tuple(_moved(mirror, X_WC) for mirror in self.mirrors))


def _placed_cameras(views: Sequence[BoardView], cameras: dict[str, NDArray]) -> dict[str, NDArray]:
    """Place camera by camera, the one that shares most boards with those placed first."""
    by_board = {(view.camera, view.sample, view.joint, view.mirror): view.X_CB[0] for view in views}
    while True:
        shared: dict[str, list[NDArray]] = {}
        for (name, *board), X_CB in by_board.items():
            for other, X_WO in cameras.items():
                X_OB = by_board.get((other, *board))  # type: ignore[arg-type]
                if name not in cameras and X_OB is not None:
                    shared.setdefault(name, []).append(X_WO @ X_OB @ inverse(X_CB))
        if not shared:
            return cameras
        best = max(shared, key=lambda name: len(shared[name]))
        cameras[best] = mean_pose(np.stack(shared[best]))


def _placed_mirrors(
    views: Iterable[BoardView], cameras: Mapping[str, NDArray], data: BodyDataset
) -> tuple[StandingMirror, ...]:
    """Place mirror by mirror: a board that is known and its image lie symmetrically about one."""
    boards: dict[_Key, NDArray] = {}
    virtual: dict[str, dict[_Key, NDArray]] = {}
    for view in views:
        X = cameras[view.camera] @ view.X_CB[0]
        where = virtual.setdefault(view.mirror, {}) if view.mirror else boards
        where.setdefault((view.sample, view.joint), X)
    planes: dict[str, Plane] = {}
    while len(planes) < len(virtual):
        left = {name: images for name, images in virtual.items() if name not in planes}
        name = max(left, key=lambda name: len(set(left[name]) & set(boards)))
        if set(left[name]) & set(boards):
            planes[name] = _symmetry(name, boards, left[name], data)
        else:
            found, placed = _alone(left, data)
            planes |= found
            boards |= placed
        _reflect_back(planes, virtual, boards)
    viewer = next(iter(cameras.values()))[:3, 3]
    return tuple(
        StandingMirror(name, _facing(planes[name], viewer))
        for name in data.mirrors
        if name in planes
    )


def _symmetry(
    name: str, boards: Mapping[_Key, NDArray], images: Mapping[_Key, NDArray], data: BodyDataset
) -> Plane:
    p, q, sizes = [], [], []
    for key in sorted(set(boards) & set(images)):
        corners = _corners(data, key[1])
        p.append(apply(boards[key], corners))
        q.append(apply(images[key], corners * MIRRORED))
        sizes.append(float(np.linalg.norm(np.ptp(corners, axis=0))))
    points, virtual = np.concatenate(p), np.concatenate(q)
    plane = symmetry_plane(points, virtual)
    aside = np.linalg.norm(np.cross(virtual - points, plane.normal), axis=1)
    if np.median(aside) > _ASIDE * max(sizes):
        raise DataError(
            f"what is seen in mirror {name!r} is no reflection of {_names(data)}: corners and "
            "reflections do not lie symmetrically about a plane; are its corners named as they are "
            "on the board, and not as they appear, and did the mirror keep still?"
        )
    return plane


def _alone(
    left: Mapping[str, Mapping[_Key, NDArray]], data: BodyDataset
) -> tuple[dict[str, Plane], dict[_Key, NDArray]]:
    """Place mirrors in which alone boards were seen, by the board of which most was."""
    keys = sorted({key for images in left.values() for key in images})
    joint = np.bincount([joint for _, joint in keys]).argmax()
    own = {
        name: {keys.index(key): X for key, X in images.items() if key[1] == joint}
        for name, images in left.items()
    }
    planes, placed = mirrors_alone(own)
    return planes, {keys[k]: X for k, X in placed.items()}


def _reflect_back(
    planes: Mapping[str, Plane],
    virtual: Mapping[str, Mapping[_Key, NDArray]],
    boards: dict[_Key, NDArray],
) -> None:
    """Add boards that were seen in a mirror which is known."""
    for name, plane in planes.items():
        for key, X in virtual[name].items():
            boards.setdefault(key, reflection(plane) @ mirrored_back(X))


def _corners(data: BodyDataset, joint: int) -> NDArray:
    """Return the outermost corners of a board, which say where it is. Shape (C, 3)."""
    p = places_on_boards(data)[[data.on_link(m.on) == joint for m in data.markers]]
    outer = {int(i) for way in (p, -p) for i in np.argmax(way, axis=0)}
    return np.asarray(p[sorted(outer | {0, len(p) - 1})])


def _names(data: BodyDataset) -> str:
    return listed([data.joint_names[i] for i in data.free_joints])


def _moved(mirror: StandingMirror, X_WC: NDArray) -> StandingMirror:
    """Return a mirror of a camera's frame in the world: n.x + d with x = R' (x_W - t)."""
    normal = X_WC[:3, :3] @ mirror.plane.normal
    offset = mirror.plane.offset - float(normal @ X_WC[:3, 3])
    return StandingMirror(mirror.name, Plane(normal / np.linalg.norm(normal), offset))


def _facing(plane: Plane, viewer: NDArray) -> Plane:
    """Return the plane with its normal towards who looks into it."""
    side = float(np.copysign(1.0, plane.distance_to(viewer)))
    return Plane(side * plane.normal, side * plane.offset)

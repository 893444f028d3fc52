"""From pictures in many mirrors to the shape of each link that stands still."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.mirrors.mark_place import GATE_3
from nico_selfmodel.estimation.shape.fair_surface import Neighbours
from nico_selfmodel.estimation.shape.fusion import DepthView, first_surface
from nico_selfmodel.estimation.shape.refinement import (
    STEPS,
    RefinedSurface,
    Step,
    moved,
    refine_surface,
    well_shown,
)
from nico_selfmodel.estimation.shape.shape_views import ShapeView, ShapeViews
from nico_selfmodel.estimation.shape.standpoints import InMirror
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.geometry.triangle_mesh import TriangleMesh
from nico_selfmodel.geometry.voxel_grid import VoxelGrid
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.shape.link_shape import BodyShape, LinkShape
from nico_selfmodel.plant.kinematic_tree import KinematicTree
from nico_selfmodel.sessions.looks.before_pictures import mirrors_and_cameras
from nico_selfmodel.sessions.looks.known_body import Shot
from nico_selfmodel.sessions.mirrors.shape_looks import FEWEST_MIRRORS, ShapeLooks
from nico_selfmodel.sessions.progress import Stage, telling
from nico_selfmodel.vision.images.body_outline import (
    beyond_body,
    beyond_by_depth,
    plain_color,
    shows_room,
)
from nico_selfmodel.vision.images.image_array import smoothed_within
from nico_selfmodel.vision.images.stereo_depth import RectifiedPair

_PITCH = 5e-3
"""Of the voxels [m]."""
REACH = 0.15
"""How far a link's surface may be from the lines between its joints [m]."""
_NEAREST = 0.3
"""What seems to be nearer in a mirror is not looked for [m]."""
_INSIDE = -1.0
"""Depths count so far inside of the outline [px]."""
_BODY = -0.5
"""What is so far inside of the outline is not mixed with the room [px]."""
_SHARE = 0.8
"""Of the way to a joint that a link's line goes."""
APART = 6e-3
"""How much nearer a place is to the lines of its own link than to another's: twice what the
difference of two such distances is off by, as joints are described to 2 mm a coordinate [m]."""
_VAGUE = 3e-3
"""What is less well known is not claimed: smoothness alone holds it, as across a notch [m]."""


@dataclass(frozen=True, eq=False)
class LearnedShape:
    """The surfaces of links."""

    body: BodyShape
    """Of each link, and where it stood in the left camera's frame."""
    all: RefinedSurface
    """All that was found about these links, in the left camera's frame."""


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Lines between the joints of a robot, by which places belong to links."""

    links: tuple[str, ...]
    """Of each line."""
    lines: NDArray
    """Both ends of each [m]. Shape (lines, 2, 3)."""

    @classmethod
    def of(
        cls, tree: KinematicTree, poses: Mapping[str, NDArray], whole: Sequence[str] = ()
    ) -> "Skeleton":
        """Draw lines from each link's origin to those of the links that hang on it.

        Lines end at four fifths of the way: what is about a joint is of the link beyond it.

        Args:
            poses: Link -> its pose in W; others are left out. Shape (4, 4) each.
            whole: Links that all that hangs on them counts to.
        """
        links, lines = [], []
        for link, joint in tree.joint_above.items():
            parent = joint.parent_body().name()
            if parent in poses and link in poses:
                start, end = poses[parent][:3, 3], poses[link][:3, 3]
                links.append(carried(tree, parent, whole))
                lines.append([start, start + _SHARE * (end - start)])
        return cls(tuple(links), np.array(lines))

    def within(self, p_WQ: NDArray, links: Sequence[str], reach: float) -> NDArray:
        """Return which points are within a distance [m] of a line of some links. Shape (N,)."""
        found = np.zeros(len(p_WQ), dtype=bool)
        for link, line in zip(self.links, self.lines, strict=True):
            if link in links:  # line by line: all at once a grid's points would take gigabytes
                found |= _apart(p_WQ, *line) < reach
        return found

    def distances(self, p_WQ: NDArray) -> NDArray:
        """Return how far points are from all lines [m]. Shape (N, 3) -> (N, lines)."""
        return np.stack([_apart(p_WQ, *line) for line in self.lines], axis=1)


def _apart(p_WQ: NDArray, start: NDArray, end: NDArray) -> NDArray:
    """Return how far points are from a line between two [m]. Shape (N, 3) -> (N,)."""
    way, off = end - start, p_WQ - start
    along = off @ way / max(float(way @ way), 1e-12)
    return np.linalg.norm(off - np.clip(along, 0.0, 1.0)[:, None] * way, axis=1)


def carried(tree: KinematicTree, link: str, whole: Sequence[str]) -> str:
    """Return the link among some that another one hangs on, or that one itself."""
    above = link
    while above not in whole and above in tree.joint_above:
        above = tree.joint_above[above].parent_body().name()
    return above if above in whole else link


def learn_shape(
    looks: ShapeLooks,
    model: SelfModel,
    skeleton: Skeleton,
    poses: Mapping[str, NDArray],
    wanted: Sequence[str],
    rng: np.random.Generator,
    stage: Stage | None = None,
) -> LearnedShape:
    """Learn the shape of links that stood still in all pictures.

    Mirrors that pictures move farther than the hand allows once in a thousand times are left out,
    and all is learned anew.

    Args:
        model: Who has learned the mirrors and the cameras; the left one is W.
        skeleton: Where the joints of the robot are, by which links are told apart.
        poses: Link -> its pose in W. Shape (4, 4) each.
        wanted: Links whose shape is learned.
        rng: Source of samples of what is not known.

    Raises:
        EstimationError: If no surface is found.
    """
    pair = RectifiedPair.of(model.rig)
    left = [pair.depth(shot.pictures, _NEAREST) for shot in looks.shots]
    views = outlined(looks, model, skeleton, pair, left)
    depths = _depths(views, pair, left)
    own = np.isin(skeleton.links, list(wanted))
    grid = VoxelGrid.about(skeleton.lines[own].reshape(-1, 3), REACH, _PITCH)
    near = skeleton.within(grid.points, wanted, REACH)
    while True:
        mesh = first_surface(grid, near, views, depths)
        found = refined(views, mesh, rng, telling(stage, "learning its shape"))
        values = np.concatenate([one.values for one in found.standpoints])
        trusted = np.flatnonzero(moved(views, values) < GATE_3).tolist()
        if not FEWEST_MIRRORS <= len(trusted) < len(views.standpoints):
            break
        views = views.only(trusted)
        depths = [replace(depths[look], look=k) for k, look in enumerate(trusted)]
    links = links_of(found, skeleton, poses, wanted)
    return LearnedShape(BodyShape(links, {link: poses[link] for link in links}), found)


def outlined(
    looks: ShapeLooks,
    model: SelfModel,
    skeleton: Skeleton,
    pair: RectifiedPair,
    left: Sequence[NDArray],
) -> ShapeViews:
    """Return all pictures with outlines; what the arm may cover is of no body and no room.

    A hand before the chest has other colours in one picture than the chest in all others: that
    these disagree would count as an error of the chest.

    Args:
        left: What the left one of the pair sees of depths in each look, asked for where the room
            is not plain [m]. Shape (h, w) each.
    """
    room = plain_color(looks.room)
    if all(
        shows_room(plain_color(picture), room) for shot in looks.shots for picture in shot.pictures
    ):
        beyond = [
            [beyond_body(p, room, n) for p, n in zip(shot.pictures, looks.noise, strict=True)]
            for shot in looks.shots
        ]
    else:
        beyond = [
            _beyond_by_depth(shot, room, mirror, pair, skeleton, depth)
            for shot, mirror, depth in zip(looks.shots, looks.mirrors.values(), left, strict=True)
        ]
    views = [
        ShapeView(k, side, picture, np.where(arm, np.nan, beyond[k][side]))
        for k, shot in enumerate(looks.shots)
        for side, (picture, arm) in enumerate(zip(shot.pictures, looks.covered[k], strict=True))
    ]
    cameras, covariance = mirrors_and_cameras(model, tuple(looks.mirrors))
    standpoints = [InMirror(mirror, model.rig.left.X_WC) for mirror in looks.mirrors.values()]
    return ShapeViews(tuple(views), model.rig, tuple(standpoints), cameras, covariance)


def _beyond_by_depth(
    shot: Shot,
    room: NDArray,
    mirror: Mirror,
    pair: RectifiedPair,
    skeleton: Skeleton,
    left: NDArray,
) -> list[NDArray]:
    """Return which pixels of both pictures show what is about the joints, and what is not."""
    found = []
    for side, picture in enumerate(shot.pictures):
        depth = pair.depth(shot.pictures, _NEAREST, side) if side else left
        v, u = np.nonzero(np.isfinite(depth))
        p_WQ = mirror.reflect(pair.points(depth[v, u], np.stack([u, v], axis=1), side))
        near = skeleton.within(p_WQ, skeleton.links, REACH)
        masks = [np.zeros(depth.shape, np.uint8) for _ in range(2)]
        masks[0][v, u], masks[1][v, u] = near, ~near
        own, other = (pair.unbent(mask, side) > 0 for mask in masks)
        found.append(beyond_by_depth(picture, room, own, other))
    return found


def _depths(views: ShapeViews, pair: RectifiedPair, left: Sequence[NDArray]) -> list[DepthView]:
    """Return what both cameras together tell of the body's depths in each mirror."""
    found = []
    for k, depth in enumerate(left):
        inside = pair.bent(views.views[2 * k].beyond, 0) < _INSIDE
        found.append(DepthView(k, pair.turned[0], np.where(inside, depth, np.nan)))
    return found


def refined(
    views: ShapeViews,
    mesh: TriangleMesh,
    rng: np.random.Generator,
    progress: Callable[[int, int], None] | None = None,
    steps: Sequence[Step] = STEPS,
    gate: float = np.inf,
    jumps: Callable[[NDArray], NDArray] | None = None,
) -> RefinedSurface:
    """Return what all pictures make of a first surface; blur mixes only what shows the body."""

    @lru_cache(maxsize=2)  # what is compared and what slopes are taken of; each takes 100 MB
    def blurred(sigma: float) -> ShapeViews:
        # nan is not below 0: what is neither body nor room does not count.
        smooth = [
            replace(v, picture=smoothed_within(v.picture, v.beyond < _BODY, sigma))
            for v in views.views
        ]
        return replace(views, views=tuple(smooth))

    return refine_surface(mesh, blurred, rng, progress, steps, gate, jumps)


def links_of(
    found: RefinedSurface,
    skeleton: Skeleton,
    poses: Mapping[str, NDArray],
    wanted: Sequence[str],
) -> dict[str, LinkShape]:
    """Give each place to the link whose lines are nearest.

    Where those of another link are hardly farther, nobody told which of both it is on, and it is
    not claimed: joints are described to a few millimetres. Two links meet in a crease, besides,
    which smoothness rounds off: abdomens, beside the chest, came out 2 mm too deep, of 1 mm said.

    Args:
        skeleton: Lines in the frame of the surface.
        poses: Link -> its pose in that frame. Shape (4, 4) each.
        wanted: Links whose places are kept.
    """
    far, names = skeleton.distances(found.mesh.vertices), np.array(skeleton.links)
    seen, shapes = claimed(found), {}
    for link in wanted:
        own = names == link
        nearer = far[:, ~own].min(axis=1, initial=np.inf) - far[:, own].min(axis=1)
        used, mesh = found.mesh.used(nearer > 0.0), found.mesh.of_vertices(nearer > 0.0)
        shapes[link] = LinkShape(
            link,
            mesh.moved(apply(inverse(poses[link]), mesh.vertices)),
            found.sigma[used],
            found.colors[used][:, ::-1] / 255.0,
            found.looks[used],
            (seen & (nearer > APART))[used],
        )
    return shapes


def claimed(found: RefinedSurface) -> NDArray:
    """Return which vertices are known, and shown by enough pictures as all about. Shape (V,).

    Where what is seen ends, a surface is held by smoothness from one side alone, and what hides it
    is near: vertices there are off by twice their sigma.
    """
    return well_shown(found, Neighbours.of(found.mesh)) & (found.sigma < _VAGUE)

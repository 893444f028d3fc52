"""Poses of a whole body in which its own cameras see enough: a room about it, or its own hands."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.tree.body_tree import WORLD, Attached, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.names import listed
from nico_selfmodel.planning.visible_workspace import FACING, ViewLimits
from nico_selfmodel.plant.body_description import BodyDescription
from nico_selfmodel.plant.collisions import CollisionShapes
from nico_selfmodel.systems.rendering.station_scene import CARD

_DRAWN = 2000
"""Poses that are drawn at once."""
_ROUNDS = 200
"""How often they are drawn before it is given up."""
_EDGE_PX = 20.0
"""A marker nearer to an image's edge may be out of it in a body that is not as described [px]."""

SIDE = 0.8 * CARD
"""Of the black square that is printed on a card on the hand [m]."""
_CORNERS = 0.5 * SIDE * np.array([(a, b, 0.0) for a in (-1, 0, 1) for b in (-1, 0, 1)])
"""On that square: corners and middles [m]. Shape (9, 3)."""
_LIFT, ROOM = 0.006, 0.011
"""Off the card, and free about lines of sight from there: links are drawn wider than they collide,
cards and joints are only nearly where they should be [m]."""
Turned = Callable[[NDArray], NDArray]
"""Changes drawn poses: angles of the commanded joints [rad], (N, k) -> (M, k), M up to N."""


@dataclass(frozen=True, eq=False)
class BodyView:
    """A body as described, and where markers about it are thought to be."""

    body: BodyDescription
    """The body; what it commands moves, the rest is held."""
    room: Sequence[Attached] = ()
    """Markers fixed in the room, in the frame of the root link."""
    limits: ViewLimits | None = None
    """What finding markers in pictures takes: distance, edge, cards that face a camera, an arm that
    touches nothing; where nothing is rendered, a point in the image is found."""

    @cached_property
    def shapes(self) -> CollisionShapes:
        """The body's collision shapes."""
        return CollisionShapes(self.body)

    @property
    def tree(self) -> BodyTree:
        """The nominal body with the room about it."""
        return self.body.tree.with_markers((*self.body.tree.markers, *self.room))

    def seen(self, q: NDArray) -> NDArray:
        """Return which cameras would see which markers, but for what hides them.

        Args:
            q: Angles of the commanded joints [rad]. Shape (N, k).

        Returns:
            Boolean, shape (N, cameras, markers).
        """
        tree = self.tree
        motion = TreeMotion.at(tree, self.posture(q))
        p_WM = motion.places(tree.markers)
        out = self.presented(motion)
        for c, sensor in enumerate(tree.sensors):
            out[:, c] &= self.inside(sensor.name, *motion.pose_of(sensor), p_WM)
        return out

    def presented(self, motion: TreeMotion) -> NDArray:
        """Return which markers pictures would show well, if cameras looked there.

        Args:
            motion: Of `tree`, at N poses.

        Returns:
            Whether they are near enough and turned to it. Boolean, shape (N, cameras, markers).
        """
        tree = self.tree
        places = [motion.pose_of(m) for m in tree.markers]
        p_WM = np.stack([p.T for _, p in places], axis=1)
        z_WM = np.stack([R[:, 2].T for R, _ in places], axis=1)
        cameras = [motion.pose_of(sensor)[1].T for sensor in tree.sensors]
        return np.stack([self._plain(p[:, None] - p_WM, z_WM) for p in cameras], axis=1)

    def inside(self, camera: str, R: NDArray, p: NDArray, points: NDArray) -> NDArray:
        """Return which points a camera has in its image, not next to its edges.

        Args:
            R: Its orientations in W. Shape (3, 3, N).
            p: Its places in W [m]. Shape (3, N).
            points: In W, of each pose [m]. Shape (N, m, 3).

        Returns:
            Boolean, shape (N, m).
        """
        edge = _EDGE_PX if self.limits is None else self.limits.margin
        X_CW = inverse(transform(R.transpose(2, 0, 1), p.T))
        p_CM = np.einsum("nij,nmj->nmi", X_CW[:, :3, :3], points) + X_CW[:, None, :3, 3]
        lens = self.tree.lenses[camera].at(np.eye(4))
        uv = lens.project(p_CM.reshape(-1, 3)).reshape(*p_CM.shape[:2], 2)
        far = np.array(lens.image_size) - 1.0 - edge
        with np.errstate(invalid="ignore"):
            return np.asarray(((uv > edge) & (uv < far)).all(axis=2))

    def _plain(self, p_MC_W: NDArray, z_WM: NDArray) -> NDArray:
        """Return which markers a camera's pictures show well, by the way to it. Shape (N, m).

        Args:
            p_MC_W: From each marker to the camera [m]. Shape (N, m, 3).
            z_WM: Out of each marker. Shape (N, m, 3).
        """
        limits, markers = self.limits, self.tree.markers
        if limits is None:
            return np.ones(p_MC_W.shape[:2], dtype=bool)
        distance = np.linalg.norm(p_MC_W, axis=2)
        own = np.array([marker.on != WORLD for marker in markers])
        cards = np.array([marker.oriented for marker in markers])
        near_enough = (distance > limits.near) & (distance < limits.far)
        faces = np.sum(p_MC_W * z_WM, axis=2) > FACING * distance
        return (near_enough | ~own) & (faces | ~cards)

    def poses(
        self, markers: Sequence[str], fewest: int, count: int, rng: np.random.Generator,
        also: tuple[Sequence[str], int] = ((), 0), turned: Turned | None = None,
    ) -> NDArray:  # fmt: skip
        """Draw poses in which every camera sees enough of some markers.

        Args:
            fewest: How many of them each camera shall see.
            also: More markers, and how many of those each camera shall see too.
            turned: What becomes of drawn poses before they are looked at; nothing if omitted.

        Returns:
            Angles of the commanded joints [rad]. Shape (count, k).

        Raises:
            ModelError: If hardly any pose shows them.
        """
        names = [marker.name for marker in self.tree.markers]
        wanted = [([names.index(name) for name in markers], fewest)]
        wanted += [([names.index(name) for name in also[0]], also[1])] if also[1] else []
        found: list[NDArray] = []
        for _ in range(_ROUNDS):
            q = rng.uniform(self.body.lower, self.body.upper, (_DRAWN, len(self.body.joints)))
            q = q if turned is None else turned(q)
            seen = self.seen(q)
            good = np.all([seen[:, :, own].sum(axis=2) >= n for own, n in wanted], axis=(0, 2))
            found.extend(pose for pose in q[good] if self.free(pose, markers))
            if len(found) >= count:
                return np.array(found[:count])
        beside = f" and {also[1]} of {listed(also[0])}" if also[1] else ""
        raise ModelError(
            f"the head hardly sees {listed(markers)}: {len(found)} of {_ROUNDS * _DRAWN} poses "
            f"show every camera {fewest} of them{beside}, {count} are wanted: put the markers "
            "before the head, or ask for fewer"
        )

    def free(self, q: NDArray, markers: Sequence[str]) -> bool:
        """Return whether a pose touches nothing and hides no card, where that counts.

        Args:
            q: Angles of the commanded joints [rad]. Shape (k,).
            markers: Names of those that shall be seen.
        """
        if not self.pictured:
            return True
        cards = self.cards(markers)
        return not self.shapes.collides(q) and not any(self._hidden(q, card) for card in cards)

    @property
    def pictured(self) -> bool:
        """Whether pictures are taken, in which the body itself hides what is behind it."""
        return self.limits is not None and not self.limits.touching

    def cards(self, markers: Sequence[str]) -> list[Attached]:
        """Return those of some markers of the body that are cards."""
        return [m for m in self.body.tree.markers if m.name in markers and m.oriented]

    def lines(self, q: NDArray, card: Attached) -> tuple[NDArray, list[NDArray]]:
        """Return between what lines of sight to a card run at a pose.

        Args:
            q: Angles of the commanded joints [rad]. Shape (k,).
            card: On the body.

        Returns:
            Its corners and middles, shape (9, 3), and the cameras, shape (3,) each, in W [m].
        """
        motion = TreeMotion.at(self.tree, self.posture(q[None]))
        R, p = (part[..., 0] for part in motion.pose_of(card))
        corners = p + _CORNERS @ R.T + _LIFT * R[:, 2]
        return corners, [motion.pose_of(sensor)[1][:, 0] for sensor in self.tree.sensors]

    def _hidden(self, q: NDArray, card: Attached) -> bool:
        """Return whether the body itself hides a corner of a card from a camera."""
        corners, cameras = self.lines(q, card)
        return any(self.shapes.hides(q, card.name, corners, p_BC, ROOM) for p_BC in cameras)

    def posture(self, q: NDArray) -> NDArray:
        """Return angles of all joints, those that nobody commands held. (N, k) -> (N, n)."""
        everything = np.array([[self.body.held.get(name, 0.0) for name in self.tree.joints]])
        everything = np.repeat(everything, len(q), axis=0)
        everything[:, self.body.columns] = q
        return everything

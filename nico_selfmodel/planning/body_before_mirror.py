"""Poses of a whole body in which its cameras see its hands in a mirror that stands in the world."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.tree.standing_mirror import StandingMirror
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.names import listed
from nico_selfmodel.planning.body_poses import ROOM, SIDE, BodyView
from nico_selfmodel.planning.mirror_view import LEAST_SIDE
from nico_selfmodel.planning.telling_mirror_poses import most_telling
from nico_selfmodel.planning.visible_workspace import FACING
from nico_selfmodel.systems.simulated.glass import Glass

_DRAWN = 4000
"""Poses that are drawn at once."""
_ROUNDS = 25
"""How often they are drawn before it is given up."""
_PLACED_BY = 40
"""Poses whose lines of sight tell where the middle of the glass shall be."""
_CLEARANCE = 0.05
"""How far joints and markers keep from the glass [m]."""
_RIM = 0.02
"""How far lines of sight keep from its edges: body and head are not as described [m]."""


@dataclass(frozen=True, eq=False)
class BodyBeforeMirror:
    """A body as described, and a glass that is meant to stand before it."""

    view: BodyView
    """The body, and what is about it."""
    glass: Glass
    """Where the glass stands, in the frame of the root link."""

    @classmethod
    def of(
        cls,
        view: BodyView,
        mirror: Mirror,
        size: tuple[float, float],
        markers: Sequence[str],
        rng: np.random.Generator,
    ) -> "BodyBeforeMirror":
        """Put the middle of a glass where most reflections of hands are seen.

        Args:
            view: The body, and what is about it.
            mirror: Where it shall stand before the left camera of a head that looks straight ahead.
            size: Width and height [m].

        Raises:
            ModelError: If hardly any pose shows a reflection.
        """
        X_WL = _left_camera(view)
        plane = mirror.plane_in(X_WL)
        endless = cls(view, Glass(_upright(plane, X_WL, np.zeros(3)), np.inf, np.inf))
        spots = []
        for marker in markers:
            q = endless.poses([marker], _PLACED_BY, rng)
            spots.append(endless.spots(q, marker))
        middle = np.median(np.concatenate(spots), axis=0)
        return replace(endless, glass=Glass(_upright(plane, X_WL, middle), *size))

    def seen(self, q: NDArray) -> NDArray:
        """Return which cameras see which of its markers in the glass, but for what hides them.

        Args:
            q: Angles of the commanded joints [rad]. Shape (N, k).

        Returns:
            Boolean, shape (N, cameras, markers).
        """
        motion, tree, plane = self._motion(q), self.view.body.tree, self.glass.plane
        places = [motion.pose_of(m) for m in tree.markers]
        p_WM = np.stack([p.T for _, p in places], axis=1)
        z_WM = np.stack([R[:, 2].T for R, _ in places], axis=1)
        virtual = reflect(plane, p_WM)
        cards = np.array([marker.oriented for marker in tree.markers])
        joints = np.moveaxis(motion.p_WL[:-1], 2, 0)
        clear = plane.distance_to(joints).min(axis=1) > _CLEARANCE
        out = np.zeros((len(q), len(tree.sensors), len(tree.markers)), dtype=bool)
        for c, sensor in enumerate(tree.sensors):
            R, p = motion.pose_of(sensor)
            out[:, c] = self.view.inside(sensor.name, R, p, virtual)
            centre = np.broadcast_to(p.T[:, None], virtual.shape)
            out[:, c] &= self.glass.between(centre, virtual, _RIM)
            way = reflect(plane, centre) - p_WM
            distance, along = np.linalg.norm(way, axis=2), np.sum(way * z_WM, axis=2)
            good = along > FACING * distance
            if self.view.pictured:
                good &= SIDE * tree.lenses[sensor.name].fx * along > LEAST_SIDE * distance**2
            out[:, c] &= good | ~cards
        return out & (plane.distance_to(p_WM) > _CLEARANCE)[:, None] & clear[:, None, None]

    def spots(self, q: NDArray, marker: str) -> NDArray:
        """Return where lines of sight to a marker's reflection meet the plane. Shape (M, 3)."""
        motion, tree, plane = self._motion(q), self.view.body.tree, self.glass.plane
        p_WM = motion.pose_of(tree.markers[tree.marker_index(marker)])[1].T
        virtual, centres = reflect(plane, p_WM), (motion.pose_of(s)[1].T for s in tree.sensors)
        return np.concatenate([plane.met_between(p_WC, virtual) for p_WC in centres])

    def poses(self, markers: Sequence[str], count: int, rng: np.random.Generator) -> NDArray:
        """Draw poses in which every camera sees some markers in the glass.

        Returns:
            Angles of the commanded joints [rad]. Shape (count, k).

        Raises:
            ModelError: If hardly any pose shows them.
        """
        body, found = self.view.body, []
        own = [body.tree.marker_index(name) for name in markers]
        for _ in range(_ROUNDS):
            q = rng.uniform(body.lower, body.upper, (_DRAWN, len(body.joints)))
            good = q[self.seen(q)[:, :, own].all(axis=(1, 2))]
            found.extend(pose for pose in good if self._free(pose, markers))
            if len(found) >= count:
                return np.array(found[:count])
        raise ModelError(
            f"the head hardly sees {listed(markers)} in the mirror: {len(found)} of "
            f"{_ROUNDS * _DRAWN} poses show every camera its reflection, {count} are wanted: put "
            "it elsewhere; 300 mm before the left camera, tilted by 0 and -20 deg, is a good place"
        )

    def by_turns(
        self, cards: Sequence[str], count: int, rng: np.random.Generator, pool: int = 0
    ) -> list[tuple[str, NDArray]]:
        """Draw poses in which every camera sees one of several cards in the glass, by turns.

        Args:
            pool: Poses of each card to choose from by what they would tell of the glass; those that
                were drawn first are taken where there are no more of them.

        Returns:
            Which card it is, and angles of the commanded joints [rad], shape (k,).

        Raises:
            ModelError: If hardly any pose shows one.
        """
        each = [(count + len(cards) - 1 - k) // len(cards) for k in range(len(cards))]
        drawn = [
            [(card, q) for q in self._telling(card, number, rng, pool)]
            for card, number in zip(cards, each, strict=True)
            if number
        ]
        order = sorted((i, k) for k, found in enumerate(drawn) for i in range(len(found)))
        return [drawn[k][i] for i, k in order]

    def _telling(self, card: str, count: int, rng: np.random.Generator, pool: int) -> NDArray:
        """Return poses that show a card, of more of them those that tell most. Shape (count, k)."""
        q = self.poses([card], max(count, pool), rng)
        if len(q) == count:
            return q
        tree, posture = self.view.tree, self.view.posture(q)
        own = len(self.view.body.tree.markers)
        # What is fixed to the body is seen from all sides, but for cards: they face the glass.
        shows = np.array([m.name == card or not m.oriented for m in tree.markers[:own]])
        reflected = np.zeros((len(q), len(tree.sensors), len(tree.markers)), dtype=bool)
        reflected[:, :, :own] = self.seen(q) & shows
        direct = self.view.seen(q) & ~self._behind(q)
        direct[:, :, :own] &= np.array([not m.oriented for m in tree.markers[:own]])
        glass = StandingMirror("glass", self.glass.plane)
        return q[most_telling(tree, glass, posture, direct, reflected, count)]

    def _behind(self, q: NDArray) -> NDArray:
        """Return which markers the glass hides from which cameras. (N, cameras, markers)."""
        tree, motion = self.view.tree, TreeMotion.at(self.view.tree, self.view.posture(q))
        p_WM = motion.places(tree.markers)
        cameras = np.split(motion.places(tree.sensors), len(tree.sensors), axis=1)
        return np.stack([self.glass.between(p_WC, p_WM) for p_WC in cameras], axis=1)

    def _free(self, q: NDArray, markers: Sequence[str]) -> bool:
        """Return whether a pose touches nothing and hides no card's reflection, where it counts.

        Light comes to a camera as straight from the card to the reflected camera, and as straight
        from the reflected card to the camera: the robot stands in neither way.
        """
        if not self.view.pictured:
            return True
        if self.view.shapes.collides(q):
            return False
        plane, view = self.glass.plane, self.view
        for card in view.cards(markers):
            corners, cameras = view.lines(q, card)
            ways = [(corners, reflect(plane, p_WC)) for p_WC in cameras]
            ways += [(reflect(plane, corners), p_WC) for p_WC in cameras]
            if any(view.shapes.hides(q, card.name, *way, ROOM) for way in ways):
                return False
        return True

    def _motion(self, q: NDArray) -> TreeMotion:
        return TreeMotion.at(self.view.body.tree, self.view.posture(q))


def _left_camera(view: BodyView) -> NDArray:
    """Return the pose of the first camera of a head that looks straight ahead. Shape (4, 4)."""
    tree = view.tree
    return TreeMotion.at(tree, np.zeros((1, len(tree.joints)))).poses(tree.sensors[0])[0]


def _upright(plane: Plane, X_WL: NDArray, middle: NDArray) -> NDArray:
    """Return the pose of a glass about the foot of a point, upright to a camera. Shape (4, 4)."""
    into = -plane.normal
    right = np.cross(X_WL[:3, 1], into)
    right = right / np.linalg.norm(right)
    foot = middle - float(plane.distance_to(middle)) * plane.normal
    return transform(np.stack([right, np.cross(into, right), into], axis=1), foot)

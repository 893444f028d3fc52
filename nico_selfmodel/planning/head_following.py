"""A head that follows the hand: poses drawn for the arm, the cameras turned to where it is."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.rotation import rotation_about
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.planning.body_poses import BodyView
from nico_selfmodel.plant.looking.gaze import GazeSolver

_ASIDE = 0.04
"""How far beside the hand the head may look, along each axis [m]: a hand that is always in the
images' middle tells nothing of lenses, nor of an axis through it."""
_MOST = 20
"""Poses that are turned at once: where nothing hides a hand, most of those drawn could be."""
_NEXT, _STIFF = 2, 10.0
"""Joints next to a camera that turn it anywhere, and how much more the others stay where they are:
a neck that bent to each hand would bring most of them too near."""


@dataclass(frozen=True, eq=False)
class HeadFollowing:
    """Turns the head of drawn poses so that a marker on a hand comes near the images' middle.

    Cameras turn first, by the joints next to them, the neck where these do not reach: it stays near
    the posture that was drawn, so that the head holds itself in many ways, and as far from the hand
    as it was.
    """

    view: BodyView
    """The body as far as it is known, and what is about it."""
    marker: str
    """What the head follows."""
    beside: tuple[Sequence[str], int]
    """Markers of the room, and how many of them each camera shall see beside it."""
    rng: np.random.Generator = field(repr=False)
    """Source of where it looks beside the hand."""

    @cached_property
    def _solver(self) -> GazeSolver:
        body, limits = self.view.body, self.view.body.limits.copy()
        for name, angle in body.held.items():
            limits[:, body.tree.joints.index(name)] = angle
        units = np.ones(len(body.tree.joints))
        return GazeSolver(BodyModel("known so far", body.tree, units, limits=limits))

    @cached_property
    def _stiff(self) -> NDArray:
        """How much more than another each of the solver's joints stays. Shape (m,)."""
        tree = self.view.tree
        ways = [np.flatnonzero(tree.beyond[sensor.on]) for sensor in tree.sensors]
        near = np.concatenate([way[-_NEXT:] for way in ways])
        return np.where(np.isin(self._solver.head, near), 1.0, _STIFF)

    def turned(self, q: NDArray) -> NDArray:
        """Return poses whose head looks at the hand, of those where that is worth while.

        Args:
            q: Drawn angles of the commanded joints [rad]. Shape (N, k).

        Returns:
            Angles, those of the head changed. Shape (M, k), M up to N.
        """
        tree, posture = self.view.tree, self.view.posture(q)
        motion, hand = TreeMotion.at(tree, posture), tree.marker_index(self.marker)
        p_WH = motion.pose_of(tree.markers[hand])[1].T
        aims = p_WH + self.rng.uniform(-_ASIDE, _ASIDE, p_WH.shape)
        near = np.flatnonzero(self.view.presented(motion)[:, :, hand].all(axis=1))
        columns, found = self.view.body.columns, []
        for i in near[self._beside(motion, near, aims)].tolist():
            # Turning the head moves its cameras little: what hides the hand now will hide it then.
            if len(found) == _MOST:
                break
            if self.view.free(q[i], [self.marker]):
                found.extend(self._looking(posture[i], aims[i]))
        return np.reshape(found, (-1, posture.shape[1]))[:, columns]

    def _beside(self, motion: TreeMotion, poses: NDArray, aims: NDArray) -> NDArray:
        """Return at which of some poses cameras that looked there would see enough of the room.

        Args:
            motion: At N poses.
            poses: Numbers of some of them. Shape (M,).
            aims: Where to look [m]. Shape (N, 3).

        Returns:
            Boolean, shape (M,).
        """
        tree, (names, fewest) = self.view.tree, self.beside
        room = [tree.marker_index(name) for name in names]
        p_WM = motion.places(tree.markers[i] for i in room)[poses]
        enough = np.ones(len(p_WM), dtype=bool)
        for sensor in tree.sensors:
            R, p = (part[..., poses] for part in motion.pose_of(sensor))
            looking = _turned_to(R, aims[poses].T - p)
            enough &= self.view.inside(sensor.name, looking, p, p_WM).sum(axis=1) >= fewest
        return enough

    def _looking(self, posture: NDArray, p_WT: NDArray) -> list[NDArray]:
        """Return the posture with the head turned; none if that is out of reach."""
        try:
            return [self._solver.at_point(posture, p_WT, posture, self._stiff).readings]
        except ModelError:
            return []


def _turned_to(R: NDArray, way: NDArray) -> NDArray:
    """Return orientations turned the shortest way until z points somewhere. Shape (3, 3, N).

    Args:
        R: Orientations. Shape (3, 3, N).
        way: Where to. Shape (3, N).
    """
    z, to = R[:, 2].T, (way / np.linalg.norm(way, axis=0)).T
    axis = np.cross(z, to)
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, np.sum(z * to, axis=1))
    turn = rotation_about(axis / np.maximum(sine, 1e-12)[:, None], angle)
    return np.einsum("nij,jkn->ikn", turn, R)

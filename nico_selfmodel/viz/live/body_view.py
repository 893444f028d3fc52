"""A whole body at work in Meshcat: its tree as it knows itself, and what its cameras see now."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import WORLD, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.viz.live.hand_view import (
    AZIMUTH,
    LEGEND,
    PREDICTED,
    TRACKED,
    HandView,
    Marks,
    hand_items,
)
from nico_selfmodel.viz.live.screens import screens_beside
from nico_selfmodel.viz.live.station_mirror import StandingGlass, StationMirror
from nico_selfmodel.viz.scene.scene import Scene, path_names
from nico_selfmodel.viz.scene.scene_items import Item
from nico_selfmodel.viz.scene.surroundings import camera_from, floor_items
from nico_selfmodel.viz.scene.tree_scene import axis_points, carried_items

_HAND = 0.012
"""Radius of what marks a hand [m]."""
_ABOUT = 0.1
"""Room about the body that the first view has, for what moves [m]; cards may hang beyond it."""


class WholeBodyView(HandView):
    """The moving tree with its cameras, their images, each hand as tracked and as predicted.

    W is the room; the first camera is the left one. Before a mirror, the glass carries what the
    left camera sees in it, each hand's reflection stands behind it, and light goes over it.
    """

    def __init__(
        self,
        model: BodyModel,
        hands: Mapping[str, Sequence[str]],
        readings: NDArray,
        *,
        glass: StandingGlass | None = None,
        recording: bool = False,
    ) -> None:
        """Draw everything once.

        Args:
            model: The body as learned, with two cameras.
            hands: Markers of each hand, by what it is called; their middle is shown.
            readings: Where it is now [encoder units]. Shape (n,).
            glass: A mirror before the robot that the model knows, if any.
            recording: Keep every `show` as a frame of an animation, for `html`.

        Raises:
            SelfModelError: If the server cannot start.
            ValueError: If the model does not know that mirror.
        """
        self.model, self.hands = model, hands
        tree, motion = model.tree, self._motion(readings)
        self._mirror = None
        if glass is not None:
            self._mirror = StationMirror(glass, tree.mirror(glass.mirror).plane)
        drawn = carried_items(tree, motion)
        self._links = dict(zip(path_names(tree.joints), range(len(tree.joints)), strict=True))
        names = {link: name for name, link in self._links.items()} | {WORLD: "world"}
        # A folder to each link: it is moved, and what is in it keeps its place there.
        items = [replace(i, path=f"links/{names[link]}/{i.path}") for link, i in drawn]
        self._X_LW = inverse(transform(motion.R_WL[..., 0], motion.p_WL[..., 0]))
        own = [motion.pose_of(m)[1].T for m in tree.markers if m.on != WORLD]
        points = np.vstack([axis_points(tree, motion), *own])
        points = np.concatenate([points - _ABOUT, points + _ABOUT])
        if self._mirror is not None:
            points = np.concatenate([points, self._mirror.corners])
        sizes = {
            side: camera.image_size
            for side, camera in zip(SIDES, rig_of(tree, motion).cameras, strict=True)
        }
        self._screens = screens_beside(points, float(AZIMUTH), sizes)
        super().__init__(self._scene(items, points), recording=recording)

    def _scene(self, items: list[Item], points: NDArray) -> Scene:
        """Return what is drawn once, screens beside the points of the body."""
        groups = ("hands",) if self._mirror is None else ("hands", "reflections")
        for group, hand in product(groups, self.hands):
            items += hand_items(f"{group}/{hand}", _HAND)
        items += [] if self._mirror is None else self._mirror.frame_items()
        items += [item for screen in self._screens.values() for item in screen.frame_items()]
        corners = [screen.corners for screen in self._screens.values()]
        view = camera_from(np.concatenate([points, *corners]), AZIMUTH, np.radians(18.0))
        return Scene(self.model.name, (*floor_items(points, 0.2), *items), view, LEGEND)

    def expected(self, readings: NDArray) -> dict[str, NDArray]:
        """Return where the cameras should see each marker [px]. Shape (4,) each.

        Args:
            readings: Encoder readings [encoder units]. Shape (n,).
        """
        rig, p_WM = self._seen_from(readings)
        return dict(zip(p_WM, rig.project(np.stack(list(p_WM.values()))), strict=True))

    def expected_in_mirror(self, readings: NDArray) -> dict[str, NDArray]:
        """Return where the cameras should see each marker in the mirror [px]. Shape (4,) each.

        Args:
            readings: Encoder readings [encoder units]. Shape (n,).

        Raises:
            ValueError: If there is no mirror.
        """
        if self._mirror is None:
            raise ValueError("the view was made without a glass, nothing is reflected")
        rig, p_WM = self._seen_from(readings)
        pixels = self._mirror.project(rig, np.stack(list(p_WM.values())))
        return dict(zip(p_WM, pixels, strict=True))

    def _seen_from(self, readings: NDArray) -> tuple[StereoRig, dict[str, NDArray]]:
        """Return the cameras, and markers' places [m], where readings have them."""
        tree, motion = self.model.tree, self._motion(readings)
        places = {m.name: motion.pose_of(m)[1][:, 0] for m in tree.markers}
        return rig_of(tree, motion), places

    def show(
        self,
        readings: NDArray,
        images: Sequence[NDArray],
        pixels: Mapping[str, NDArray],
        reflected: Mapping[str, NDArray] | None = None,
    ) -> None:
        """Move the body and show what it sees.

        Args:
            readings: Encoder readings [encoder units]. Shape (n,).
            images: Pictures of both cameras, BGR, 8 bits. Shape (h, w, 3) each.
            pixels: Where they tracked markers, nan where not [px]. Shape (4,) each.
            reflected: Where they tracked reflections, before a mirror. Shape (4,) each.

        Raises:
            ValueError: If there is no mirror to be reflected in.
        """
        time, motion = self._time, self._motion(readings)
        X_WL = transform(motion.R_WL[..., 0], motion.p_WL[..., 0])
        for name, link in self._links.items():
            self._place(f"links/{name}", X_WL[link] @ self._X_LW[link], time)
        rig, p_WM = self._seen_from(readings)
        direct = self._marks(pixels, self.expected(readings))
        rings: dict[str, Marks] = {}
        if reflected is not None:
            rings = self._marks(reflected, self.expected_in_mirror(readings))
        for hand, markers in self.hands.items():
            at = np.mean([p_WM[name] for name in markers], axis=0)
            self._show_hand(f"hands/{hand}", rig, direct[hand][TRACKED], at, time)
            if reflected is not None:
                path, seen, rays = f"reflections/{hand}", rings[hand][TRACKED], f"mirror/{hand}"
                self._show_reflection(path, rig, seen, at, rays, time)
        marks = [(direct[hand], rings.get(hand, {})) for hand in self.hands]
        self._show_images(rig, images, marks, time)
        self._frames += 1

    def _marks(
        self, tracked: Mapping[str, NDArray], expected: Mapping[str, NDArray]
    ) -> dict[str, Marks]:
        """Return by hand where both cameras see its middle, and where they should [px]. (4,)."""
        return {
            hand: {
                TRACKED: np.mean([tracked[name] for name in markers], axis=0),
                PREDICTED: np.mean([expected[name] for name in markers], axis=0),
            }
            for hand, markers in self.hands.items()
        }

    def _motion(self, readings: NDArray) -> TreeMotion:
        return TreeMotion.at(self.model.tree, self.model.readings(readings[None]))


def rig_of(tree: BodyTree, motion: TreeMotion) -> StereoRig:
    """Return both cameras of a body where a pose has them, in W."""
    looking = [sensor for sensor in tree.sensors if sensor.name in tree.lenses]
    left, right = (tree.lenses[s.name].at(motion.poses(s)[0]) for s in looking)
    return StereoRig(left, right)

"""A whole body at work in Meshcat: its tree as it knows itself, and what its cameras see now."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat

from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import WORLD, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.viz.live.image_marks import marked
from nico_selfmodel.viz.live.moving_scene import MovingScene
from nico_selfmodel.viz.live.screens import screens_beside
from nico_selfmodel.viz.live.station_view import PREDICTED, TRACKED
from nico_selfmodel.viz.scene.scene import LegendEntry, Scene, path_names
from nico_selfmodel.viz.scene.scene_items import Item, Markers
from nico_selfmodel.viz.scene.surroundings import camera_from, floor_items
from nico_selfmodel.viz.scene.tree_scene import axis_points, carried_items

_HAND = 0.012
"""Radius of what marks a hand [m]."""
_ABOUT = 0.1
"""Room about the body that the first view has, for what moves [m]; cards may hang beyond it."""
_AZIMUTH = np.radians(252.0)
"""The first view is from the robot's right and a little behind: it looks towards its screens."""


class WholeBodyView(MovingScene):
    """The moving tree with its cameras, their images, each hand as tracked and as predicted.

    W is the room; the first camera is the left one.
    """

    def __init__(
        self,
        model: BodyModel,
        hands: Mapping[str, Sequence[str]],
        readings: NDArray,
        meshcat: Meshcat | None = None,
        *,
        recording: bool = False,
    ) -> None:
        """Draw everything once.

        Args:
            model: The body as learned, with two cameras.
            hands: Markers of each hand, by what it is called; their middle is shown.
            readings: Where it is now [encoder units]. Shape (n,).
            meshcat: Where to draw; a new server that only this machine reaches if omitted.
            recording: Keep every `show` as a frame of an animation, for `html`.

        Raises:
            SelfModelError: If the server cannot start.
        """
        self.model, self.hands = model, hands
        tree, motion = model.tree, self._motion(readings)
        drawn = carried_items(tree, motion)
        self._links = dict(zip(path_names(tree.joints), range(len(tree.joints)), strict=True))
        names = {link: name for name, link in self._links.items()} | {WORLD: "world"}
        # A folder to each link: it is moved, and what is in it keeps its place there.
        items = [replace(i, path=f"links/{names[link]}/{i.path}") for link, i in drawn]
        self._X_LW = inverse(transform(motion.R_WL[..., 0], motion.p_WL[..., 0]))
        own = [motion.pose_of(m)[1].T for m in tree.markers if m.on != WORLD]
        points = np.vstack([axis_points(tree, motion), *own])
        points = np.concatenate([points - _ABOUT, points + _ABOUT])
        sizes = {
            side: camera.image_size
            for side, camera in zip(SIDES, rig_of(tree, motion).cameras, strict=True)
        }
        self._screens = screens_beside(points, float(_AZIMUTH), sizes)
        super().__init__(self._scene(items, points), meshcat, recording=recording)

    def _scene(self, items: list[Item], points: NDArray) -> Scene:
        """Return what is drawn once, screens beside the points of the body."""
        kinds = (("tracked", TRACKED, 1.0), ("predicted", PREDICTED, 0.8))
        for hand in self.hands:
            for kind, color, size in kinds:
                path, one = f"hands/{hand}/{kind}", np.zeros((1, 3))
                items.append(Markers(path=path, color=color, centers=one, radius=size * _HAND))
        items += [item for screen in self._screens.values() for item in screen.frame_items()]
        legend = tuple(LegendEntry(f"hand as {kind}", color) for kind, color, _ in kinds)
        corners = [screen.corners for screen in self._screens.values()]
        view = camera_from(np.concatenate([points, *corners]), _AZIMUTH, np.radians(18.0))
        return Scene(self.model.name, (*floor_items(points, 0.2), *items), view, legend)

    def expected(self, readings: NDArray) -> dict[str, NDArray]:
        """Return where the cameras should see each marker [px]. Shape (4,) each.

        Args:
            readings: Encoder readings [encoder units]. Shape (n,).
        """
        tree, motion = self.model.tree, self._motion(readings)
        p_WM = np.stack([motion.pose_of(m)[1][:, 0] for m in tree.markers])
        pixels = rig_of(tree, motion).project(p_WM)
        return dict(zip([m.name for m in tree.markers], pixels, strict=True))

    def show(
        self, readings: NDArray, images: Sequence[NDArray], pixels: Mapping[str, NDArray]
    ) -> None:
        """Move the body and show what it sees.

        Args:
            readings: Encoder readings [encoder units]. Shape (n,).
            images: Pictures of both cameras, BGR, 8 bits. Shape (h, w, 3) each.
            pixels: Where they tracked markers, nan where not [px]. Shape (4,) each.
        """
        time, tree, motion = self._time, self.model.tree, self._motion(readings)
        X_WL = transform(motion.R_WL[..., 0], motion.p_WL[..., 0])
        for name, link in self._links.items():
            self._place(f"links/{name}", X_WL[link] @ self._X_LW[link], time)
        rig, expected = rig_of(tree, motion), self.expected(readings)
        drawn = [image[:, :, ::-1] for image in images]
        for hand, markers in self.hands.items():
            both = {
                TRACKED: np.mean([pixels[name] for name in markers], axis=0),
                PREDICTED: np.mean([expected[name] for name in markers], axis=0),
            }
            at = [motion.pose_of(tree.markers[tree.marker_index(m)])[1][:, 0] for m in markers]
            there = rig.triangulate(both[TRACKED][None]).p_WQ[0]
            for kind, p in (("tracked", there), ("predicted", np.mean(at, axis=0))):
                known = bool(np.isfinite(p).all())
                if known:
                    self._place(f"hands/{hand}/{kind}", transform(np.eye(3), p), time)
                self._set_visible(f"hands/{hand}/{kind}", known, time)
            for k in range(len(drawn)):
                own = slice(2 * k, 2 * k + 2)
                drawn[k] = marked(drawn[k], {color: uv[own] for color, uv in both.items()})
        for (side, screen), image in zip(self._screens.items(), drawn, strict=True):
            self._show_item(f"screens/{side}/image", screen.picture(image, "image"), time)
        self._frames += 1

    def _motion(self, readings: NDArray) -> TreeMotion:
        return TreeMotion.at(self.model.tree, self.model.readings(readings[None]))


def rig_of(tree: BodyTree, motion: TreeMotion) -> StereoRig:
    """Return both cameras of a body where a pose has them, in W.

    Args:
        tree: The body.
        motion: It at one pose.
    """
    cameras = []
    for sensor in tree.sensors:
        if sensor.name in tree.lenses:
            R, p = motion.pose_of(sensor)
            cameras.append(tree.lenses[sensor.name].at(transform(R[..., 0], p[..., 0])))
    left, right = cameras
    return StereoRig(left, right)

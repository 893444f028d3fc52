"""A robot at work in Meshcat: its body as it knows itself, and what its cameras see right now."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.plant import ArmDescription, SelfModelPlant
from nico_selfmodel.plant.learned_frames import learned_frames
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.live.hand_view import (
    AZIMUTH,
    CYAN,
    LEGEND,
    ORANGE,
    PREDICTED,
    TRACKED,
    HandView,
    hand_items,
)
from nico_selfmodel.viz.live.screens import screens_beside
from nico_selfmodel.viz.live.station_mirror import StandingGlass, StationMirror
from nico_selfmodel.viz.scene.body_scene import standing
from nico_selfmodel.viz.scene.camera_items import ImagePlane, camera_items
from nico_selfmodel.viz.scene.robot.robot_items import robot_items
from nico_selfmodel.viz.scene.scene import Scene
from nico_selfmodel.viz.scene.scene_items import Item, Picture
from nico_selfmodel.viz.scene.surroundings import camera_from, floor_items

_SPREAD = 1.5
"""Width of an image in baselines: they overlap, as what the cameras see does."""
_HAND = 0.006
"""Radius of what marks the hand [m]."""
_FLESH = 0.09
"""How far the robot reaches beyond the origins of its links [m]."""
_INTO_MIRROR = np.radians(232.0)
"""Before a mirror it is more from behind, so that one can look into the glass."""


class StationView(HandView):
    """The moving robot, the frusta of its cameras, their images, the tracked and predicted hand.

    The robot stands upright on its own root link, whatever frame its self-model is expressed in.
    Before a mirror, the glass carries what the left camera sees in it, the hand's reflection stands
    behind it, and rays go from the hand over the glass into the cameras.
    """

    def __init__(
        self,
        arm: ArmDescription,
        model: SelfModel,
        *,
        glass: StandingGlass | None = None,
        recording: bool = False,
    ) -> None:
        """Draw everything once.

        Args:
            glass: A mirror before the robot that the model knows, if any.
            recording: Keep every `show` as a frame of an animation, for `html`.

        Raises:
            ModelError: If the model lacks arm, cameras or that mirror, or the robot cannot be read.
            SelfModelError: If the server cannot start.
        """
        self.model = standing(model, inverse(learned_frames(arm, model.chain).X_WR))
        self.marker = self.model.markers[0]
        self._built = SelfModelPlant.from_urdf(arm, self.model)
        self._context = self._built.plant.CreateDefaultContext()
        self._mirror = None if glass is None else _mirror_of(self.model, glass)
        q = np.zeros(len(arm.joints))
        body = robot_items(arm, self.model, q)
        self._links = sorted({item.path.split("/")[1] for item in body})
        self._X_LD = {link: inverse(X) for link, X in self._link_poses(q).items()}
        width = max(camera.image_size[0] / camera.fx for camera in self.model.rig.cameras)
        self._planes = {
            side: ImagePlane(camera, _SPREAD * self.model.rig.baseline / width)
            for side, camera in zip(SIDES, self.model.rig.cameras, strict=True)
        }
        sizes = {side: plane.camera.image_size for side, plane in self._planes.items()}
        self._azimuth = float(AZIMUTH if glass is None else _INTO_MIRROR)
        self._screens = screens_beside(self._extent(body), self._azimuth, sizes)
        super().__init__(self._scene(body), recording=recording)

    def _scene(self, body: list[Item]) -> Scene:
        items: list[Item] = [*body]
        for side, plane in self._planes.items():
            # Its screen says which it is; the name on the image would be read from behind.
            items += [i for i in camera_items(side, plane, None) if not i.path.endswith("/name")]
        items += hand_items("hand", _HAND)
        items += [item for screen in self._screens.values() for item in screen.frame_items()]
        last = self._screens[SIDES[1]]
        items.append(last.words("screens/tracked", "+  hand as tracked", CYAN, 0))
        items.append(last.words("screens/predicted", "\u00d7  hand as predicted", ORANGE, 1))
        if self._mirror is not None:
            items += [*self._mirror.frame_items(), *hand_items("reflection", _HAND)]
            words = "\u25cb  its reflection"
            items.append(last.words("screens/reflected", words, palette.INK, 2))
        points = self._extent(body)
        grid = floor_items(points, 0.2)
        corners = [screen.corners for screen in self._screens.values()]
        view = camera_from(np.concatenate([points, *corners]), self._azimuth, np.radians(18.0))
        return Scene(self.model.name, (*grid, *items), view, LEGEND)

    def _extent(self, body: list[Item]) -> NDArray:
        """Return points that the robot and what its cameras see lie between. Shape (N, 3)."""
        links = np.concatenate([apply(item.X_WI, np.zeros((1, 3))) for item in body])
        planes = [plane.corners for plane in self._planes.values()]
        if self._mirror is not None:
            planes.append(self._mirror.corners)
        return np.concatenate([links - _FLESH, links + _FLESH, *planes])

    def show(
        self,
        readings: ArrayLike,
        images: Sequence[NDArray] | None = None,
        pixels: ArrayLike | None = None,
        reflected: ArrayLike | None = None,
    ) -> None:
        """Move the robot and show what it sees.

        Args:
            readings: Encoder readings [encoder units]. Shape (n,).
            images: Pictures of the left and right camera, BGR, 8 bits. Shape (h, w, 3) each.
            pixels: Where the cameras tracked the hand, nan where not; for the marks and the tracked
                hand. Shape (4,).
            reflected: Where they tracked its reflection, before a mirror. Shape (4,).

        Raises:
            ValueError: If a shape is wrong, or there is no mirror to be reflected in.
        """
        time = self._time
        q = self.model.servos.to_joint(np.asarray(readings, dtype=float))
        seen, in_mirror = _four(pixels, "pixels"), _four(reflected, "reflected")
        if self._mirror is None and reflected is not None:
            raise ValueError("reflected pixels were given, but the view was made without a glass")
        for link, X_DL in self._link_poses(q).items():
            self._place(f"robot/{link}", X_DL @ self._X_LD[link], time)
        predicted, mirror, rig = self.model.points(q), self._mirror, self.model.rig
        self._show_hand("hand", rig, seen, predicted, time)
        self._show_reflection("reflection", rig, in_mirror, predicted, "mirror", time)
        if images is not None:
            behind = np.full(4, np.nan) if mirror is None else mirror.project(rig, predicted)
            crosses = {TRACKED: seen, PREDICTED: rig.project(predicted)}
            rings = {TRACKED: in_mirror, PREDICTED: behind}
            self._show_images(rig, images, [(crosses, rings)], time)
        self._frames += 1

    def _show_image(self, side: str, image: NDArray, time: float | None) -> None:
        """Draw an image on its screen, and on its plane before the camera."""
        super()._show_image(side, image, time)
        items = camera_items(side, self._planes[side], image)
        (picture,) = (item for item in items if isinstance(item, Picture) and "image" in item.path)
        self._show_item(f"cameras/{side}/image", picture, time)

    def _link_poses(self, q: NDArray) -> dict[str, NDArray]:
        self._built.set_joint_angles(self._context, q)
        plant = self._built.plant
        poses = {}
        for link in self._links:
            body = plant.GetBodyByName(link, self._built.instance)
            poses[link] = plant.EvalBodyPoseInWorld(self._context, body).GetAsMatrix4()
        return poses


def _mirror_of(model: SelfModel, glass: StandingGlass) -> StationMirror:
    return StationMirror(glass, model.mirror_rig(glass.mirror).plane)


def _four(pixels: ArrayLike | None, name: str) -> NDArray:
    """Return pixels of both cameras; nan for none."""
    found = np.full(4, np.nan) if pixels is None else np.asarray(pixels, dtype=float)
    if found.shape != (4,):
        raise ValueError(f"{name} must have shape (4,), got {found.shape}")
    return found

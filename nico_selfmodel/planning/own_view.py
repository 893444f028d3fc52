"""Where in its pictures a robot sees its own arm directly, by what it learned of itself."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.plant import ArmDescription, SelfModelPlant

_STEPS = 10
"""Points along each link."""
_ARM, _HAND = 0.026, 0.030
"""What belongs to the arm, and to the hand, is no farther than this from the lines through its
joints, and to its fingers and markers [m]."""
_NEAREST = 0.05
"""What is nearer to a camera covers it wholly, or is not seen at all [m]."""
_SPOTS = 0.5 * np.array([[0, 0], [-1, -1], [-1, 1], [1, -1], [1, 1]])
"""Middle and corners of a cell, as shares of its sides."""


class OwnArmInView:
    """The cells of a camera's picture that may show the own arm directly."""

    def __init__(self, arm: ArmDescription, model: SelfModel, camera: Camera, cell: int) -> None:
        """Take a learned body.

        Args:
            arm: Which robot it is.
            model: What it has learned of its arm and cameras.
            camera: Whose pictures, in the model's world.
            cell: Sides of the cells [px].

        Raises:
            ModelError: If the model has other joints.
        """
        self._built = SelfModelPlant.from_urdf(arm, model)
        self._context = self._built.plant.CreateDefaultContext()
        self._camera = camera
        self._rays, self._spread = _lines_of_sight(camera, cell)

    def cells(self, readings: ArrayLike) -> NDArray:
        """Return which cells may show the own arm, or nothing as no ray belongs to them.

        What the arm reaches into the picture with may hang on a line that the lens does not show.

        Args:
            readings: Of the encoders [encoder units]. Shape (n,).

        Returns:
            A truth value a cell. Shape (rows, columns).
        """
        p_WQ, radius = self.points(readings)
        p_CQ = apply(self._camera.X_CW, p_WQ)
        ahead = p_CQ[:, 2] > _NEAREST
        p_CQ, radius = p_CQ[ahead], radius[ahead]
        # A sphere about p of radius r is met by a ray along the unit vector d if
        #     |p|^2 - (p . d)^2 < r^2,
        # and by one at most an angle a from d if it is not farther from it than r + a (p . d).
        along = np.maximum(self._rays @ p_CQ.T, 0.0)
        reach = radius + self._spread[..., None] * along
        with np.errstate(invalid="ignore"):
            met = np.sum(p_CQ**2, axis=1) - along**2 < reach**2
        return met.any(axis=2) | np.isnan(self._rays[..., 0])

    def points(self, readings: ArrayLike) -> tuple[NDArray, NDArray]:
        """Return points on lines through the joints, and from the hand to all that it moves.

        Args:
            readings: Of the encoders [encoder units]. Shape (n,).

        Returns:
            Points, shape (k, 3), and how far from each there may be something, shape (k,) [m].
        """
        built, plant = self._built, self._built.plant
        built.set_positions(self._context, readings)
        links = dict.fromkeys((*built.arm.links.child_links, built.arm.tip_link))
        bodies = [plant.GetBodyByName(link, built.instance) for link in links]
        last = plant.GetJointByName(built.arm.joints[-1], built.instance).index()
        moved = map(plant.get_body, plant.GetBodiesKinematicallyAffectedBy([last]))
        poses = [plant.EvalBodyPoseInWorld(self._context, body) for body in (*bodies, *moved)]
        markers = [built.tracked_point_frame(marker) for marker in built.markers]
        poses += [frame.CalcPoseInWorld(self._context) for frame in markers]
        p_WE = np.array([pose.translation() for pose in poses])
        joints = len(bodies)
        arm = np.stack([p_WE[: joints - 1], p_WE[1:joints]])
        hand = np.stack([np.broadcast_to(p_WE[joints - 1], p_WE[joints:].shape), p_WE[joints:]])
        starts, ends = np.concatenate([arm, hand], axis=1)
        radius = np.repeat([_ARM, _HAND], [arm.shape[1], hand.shape[1]])
        share = np.linspace(0.0, 1.0, _STEPS)[:, None, None]
        return np.reshape(starts + share * (ends - starts), (-1, 3)), np.tile(radius, _STEPS)


def _lines_of_sight(camera: Camera, cell: int) -> tuple[NDArray, NDArray]:
    """Return a ray of each cell of a picture, and how far from it the others are.

    Args:
        camera: Whose picture.
        cell: Sides of the cells [px].

    Returns:
        Unit vectors in the camera's frame, of the middle or else of a corner that the lens shows,
        nan where it shows none, shape (rows, columns, 3); and angles, shape (rows, columns) [rad].
    """
    columns, rows = (side // cell for side in camera.image_size)
    middles = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1) + 0.5
    pixels = cell * (middles[:, :, None] + _SPOTS) - 0.5
    rays = camera.directions(pixels.reshape(-1, 2)).reshape(rows, columns, len(_SPOTS), 3)
    first = np.argmax(~np.isnan(rays[..., 0]), axis=2)
    ray = np.take_along_axis(rays, first[:, :, None, None], axis=2)[:, :, 0]
    across = np.linalg.norm(np.nan_to_num(rays - ray[:, :, None]), axis=-1).max(axis=2)
    whole = ~np.isnan(rays[..., 0]).any(axis=2)
    return ray, np.where(whole, across, 2.0 * across[whole].max())

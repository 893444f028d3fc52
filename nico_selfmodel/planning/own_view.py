"""Where in its pictures a robot sees its own arm directly, by what it learned of itself."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
        self._camera, self._cell = camera, cell
        columns, rows = (side // cell for side in camera.image_size)
        grid = np.meshgrid(np.arange(columns), np.arange(rows))
        self._middles = cell * (np.stack(grid, axis=-1) + 0.5) - 0.5

    def cells(self, readings: ArrayLike) -> NDArray:
        """Return which cells may show the own arm.

        Args:
            readings: Of the encoders [encoder units]. Shape (n,).

        Returns:
            A truth value a cell. Shape (rows, columns).
        """
        p_WQ, radius = self.points(readings)
        camera = self._camera
        depth = p_WQ @ camera.X_CW[2, :3] + camera.X_CW[2, 3]
        ahead = depth > _NEAREST
        pixels = camera.project(p_WQ[ahead])
        # A cell is in question as soon as its nearest corner is.
        reach = radius[ahead] * camera.fx / depth[ahead] + self._cell * np.sqrt(0.5)
        apart = np.linalg.norm(self._middles[:, :, None] - pixels, axis=-1)
        with np.errstate(invalid="ignore"):
            return np.asarray((apart < reach).any(axis=2))

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

"""Where in its pictures a robot sees its own arm directly, by what it learned of itself."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.plant import ArmDescription, SelfModelPlant

_STEPS = 10
"""Points along each link."""
_RADIUS = 0.055
"""What belongs to the arm is no farther than this from the lines through its joints [m]."""
_FINGERS = 0.09
"""How far the fingers reach beyond the last link's frame, along the line that leads there [m]."""
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
        p_WQ = self._points(readings)
        camera = self._camera
        depth = p_WQ @ camera.X_CW[2, :3] + camera.X_CW[2, 3]
        p_WQ, depth = p_WQ[depth > _NEAREST], depth[depth > _NEAREST]
        pixels = camera.project(p_WQ)
        # A cell is in question as soon as its nearest corner is.
        reach = _RADIUS * camera.fx / depth + self._cell * np.sqrt(0.5)
        apart = np.linalg.norm(self._middles[:, :, None] - pixels, axis=-1)
        with np.errstate(invalid="ignore"):
            return np.asarray((apart < reach).any(axis=2))

    def _points(self, readings: ArrayLike) -> NDArray:
        """Return points along the lines through the arm's joints to the hand. Shape (k, 3)."""
        built, plant = self._built, self._built.plant
        built.set_positions(self._context, readings)
        links = (*built.arm.links.child_links, built.arm.tip_link)
        bodies = [plant.GetBodyByName(link, built.instance) for link in links]
        poses = [plant.EvalBodyPoseInWorld(self._context, body) for body in bodies]
        ends = np.array([pose.translation() for pose in poses])
        frames = [built.tracked_point_frame(marker) for marker in built.markers]
        hand = np.array([frame.CalcPoseInWorld(self._context).translation() for frame in frames])
        fingers = ends[-1] + _FINGERS * _along(ends)
        joints = np.vstack([ends, fingers, hand])
        share = np.linspace(0.0, 1.0, _STEPS)[:, None, None]
        return np.reshape(joints[:-1] + share * np.diff(joints, axis=0), (-1, 3))


def _along(ends: NDArray) -> NDArray:
    """Return the direction in which the last two frames that are apart follow each other."""
    ways = np.diff(ends, axis=0)
    lengths = np.linalg.norm(ways, axis=1)
    last = int(np.flatnonzero(lengths > 1e-3)[-1])
    return np.asarray(ways[last] / lengths[last])

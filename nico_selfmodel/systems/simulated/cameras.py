"""Simulated pairs of cameras: how they were really built, and boards held before them."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS

_TRIES_PER_VIEW = 2000
_NEAR, _FAR = 0.22, 0.5
"""Distances at which boards are held before the cameras [m]."""
_TILT = 0.4
"""Standard deviation of a board's attitude about each axis [rad]."""
_EDGE = 5.0
"""Corners nearer to the image's edge are not found [px]."""


class SimulatedCameras:
    """Two cameras and the noise of finding corners in their images; the true rig is private."""

    def __init__(self, seed: int, pixel_sigma: float = 0.2) -> None:
        """Build one pair of cameras.

        Args:
            seed: Which one: its lenses and how the cameras stand.
            pixel_sigma: Noise of each measured pixel coordinate [px].
        """
        self.pixel_sigma, self._seed = pixel_sigma, seed
        self.__rig = built_rig(NICO_CAMERAS, np.random.default_rng((seed, 7)))

    def look_at_boards(self, p_GQ: NDArray, count: int, session: int = 0) -> BoardViews:
        """Hold a board before the cameras in random attitudes and find its corners.

        Args:
            p_GQ: Corners of the board [m]. Shape (P, 3).
            session: Of the attitudes and the noise.

        Returns:
            Views in which both cameras see all corners, in the frame of nobody.

        Raises:
            ValueError: If such a board never fits into both images.
        """
        rng = np.random.default_rng((self._seed, session, 8))
        return views_of_boards(self.__rig, p_GQ, count, rng, self.pixel_sigma)


def built_rig(nominal: StereoRig, rng: np.random.Generator) -> StereoRig:
    """Return a rig as it left the workshop, the left camera only nearly at the world."""
    return StereoRig(built_camera(nominal.left, rng), built_camera(nominal.right, rng))


def built_lenses(nominal: StereoRig, seed: int) -> StereoRig:
    """Return the cameras of one robot in the frames they are mounted on.

    Args:
        nominal: As designed; where they are mounted is the robot's business.
        seed: Which robot; its lenses come from this alone.
    """
    rng = np.random.default_rng((seed, 7))
    return StereoRig(*(built_camera(camera.at(np.eye(4)), rng) for camera in nominal.cameras))


def built_camera(nominal: Camera, rng: np.random.Generator) -> Camera:
    """Return a camera as it left the workshop: lens and mount are only nearly as designed."""
    spread = np.array([4.0, 4.0, 0.0, 8.0, 8.0, 0.02, 0.01, 0.002, 0.0, 0.0])
    turn = rotation_from_vector(rng.normal(0.0, np.radians(1.0), 3))
    pose = nominal.X_WC @ transform(turn, rng.normal(0.0, 1e-3, 3))
    values = nominal.values + spread * rng.normal(size=len(spread))
    return Camera.from_values(values, nominal.image_size, pose)


def inside_images(pixels: NDArray, image_size: tuple[int, int], edge: float) -> NDArray:
    """Return which pixels lie away from their image's edges. Shapes (N, 4) -> (N, 2).

    Args:
        pixels: Left u, v and right u, v; nan is outside.
        image_size: Width and height [px].
        edge: Least distance from an edge [px].
    """
    uv = pixels.reshape(-1, 2, 2)
    with np.errstate(invalid="ignore"):
        return np.asarray(((uv > edge) & (uv < np.array(image_size) - 1.0 - edge)).all(axis=2))


def views_of_boards(
    rig: StereoRig, p_GQ: NDArray, count: int, rng: np.random.Generator, pixel_sigma: float
) -> BoardViews:
    """Hold a board before cameras in random attitudes and find its corners.

    Args:
        rig: The true cameras.
        p_GQ: Corners of the board [m]. Shape (P, 3).
        pixel_sigma: Noise of each measured pixel coordinate [px].

    Returns:
        Views in which both cameras see all corners.

    Raises:
        ValueError: If such a board never fits into both images.
    """
    centered, size = p_GQ - p_GQ.mean(axis=0), rig.left.image_size
    seen: list[NDArray] = []
    for _ in range(_TRIES_PER_VIEW * count):
        pixels = rig.project(apply(_attitude(rng), centered))
        if inside_images(pixels, size, _EDGE).all():
            seen.append(pixels + rng.normal(0.0, pixel_sigma, pixels.shape))
            if len(seen) == count:
                names = tuple(f"{i + 1:02d}" for i in range(count))
                return BoardViews(p_GQ, names, SIDES, np.array(seen), (size, size))
    width = 1e3 * np.ptp(p_GQ, axis=0).max()
    raise ValueError(f"a board of {width:.0f} mm does not fit into both images")


def _attitude(rng: np.random.Generator) -> NDArray:
    """Return a pose of a board before the cameras. Shape (4, 4)."""
    depth = rng.uniform(_NEAR, _FAR)
    aside = rng.uniform(-0.5, 0.5, 2) * depth + [0.035, 0.0]
    return transform(rotation_from_vector(rng.normal(0.0, _TILT, 3)), [aside[0], aside[1], depth])

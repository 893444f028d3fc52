"""A pair of simulated eyes that looks at boards and keeps its true lenses to itself."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset import BoardViews
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model import Camera, StereoRig

_TRIES_PER_VIEW = 2000
_NEAR, _FAR = 0.22, 0.5
"""Distances at which boards are held before the eyes [m]."""
_TILT = 0.4
"""Standard deviation of a board's attitude about each axis [rad]."""

NICO_CAMERAS = StereoRig(
    Camera(381.0, 381.0, 319.5, 239.5, (640, 480), k1=-0.28, k2=0.09, k3=-0.012),
    Camera(
        381.0, 381.0, 319.5, 239.5, (640, 480), k1=-0.28, k2=0.09, k3=-0.012,
        X_WC=transform(np.eye(3), [0.07, 0.0, 0.0]),
    ),
)  # fmt: skip
"""Nico's wide eyes as designed: 80 degrees horizontally, 70 mm apart."""


class SimulatedEyes:
    """Two eyes and the noise of finding corners in their images; the true rig is private."""

    def __init__(
        self, seed: int, pixel_sigma: float = 0.2, nominal: StereoRig = NICO_CAMERAS
    ) -> None:
        """Build one individual of a pair of eyes.

        Args:
            seed: Of the individual: its lenses and how the eyes stand.
            pixel_sigma: Noise of each measured pixel coordinate [px].
            nominal: The eyes as designed.
        """
        self.pixel_sigma = pixel_sigma
        self.__rig = _individual_rig(seed, nominal)
        self._seed = seed

    def look_at_boards(self, p_GQ: NDArray, count: int, session: int = 0) -> BoardViews:
        """Hold a board before the eyes in random attitudes and return where its corners are seen.

        Args:
            p_GQ: Corners of the board [m]. Shape (P, 3).
            count: How many views.
            session: Of the attitudes and the noise.

        Returns:
            Views in which both eyes see all corners, in the frame of nobody.

        Raises:
            ValueError: If such a board never fits into both images.
        """
        rng = np.random.default_rng((self._seed, session, 8))
        centered = p_GQ - p_GQ.mean(axis=0)
        seen: list[NDArray] = []
        for _ in range(_TRIES_PER_VIEW * count):
            pixels = self.__rig.project(apply(_attitude(rng), centered))
            if self._inside(pixels):
                seen.append(pixels + rng.normal(0.0, self.pixel_sigma, pixels.shape))
                if len(seen) == count:
                    break
        else:
            size = 1e3 * np.ptp(p_GQ, axis=0).max()
            raise ValueError(f"a board of {size:.0f} mm does not fit into both images")
        names = tuple(f"{i + 1:02d}" for i in range(count))
        return BoardViews(
            p_GQ, names, ("left", "right"), np.array(seen), self.__rig.left.image_size
        )

    def _inside(self, pixels: NDArray) -> bool:
        """Return whether both eyes see all points, a few pixels from the edge."""
        width, height = self.__rig.left.image_size
        limit = np.array([width - 6.0, height - 6.0] * 2)
        return bool(((pixels > 5.0) & (pixels < limit)).all())


def _individual_rig(seed: int, nominal: StereoRig) -> StereoRig:
    """Return the eyes of one individual, the left one only nearly at the world."""
    rng = np.random.default_rng((seed, 7))
    return StereoRig(_individual(nominal.left, rng), _individual(nominal.right, rng))


def _individual(nominal: Camera, rng: np.random.Generator) -> Camera:
    """Return a camera as it left the workshop: lens and mount are only nearly as designed."""
    spread = np.array([4.0, 4.0, 0.0, 8.0, 8.0, 0.02, 0.01, 0.002, 0.0, 0.0])
    turn = rotation_from_vector(rng.normal(0.0, np.radians(1.0), 3))
    pose = nominal.X_WC @ transform(turn, rng.normal(0.0, 1e-3, 3))
    values = nominal.values + spread * rng.normal(size=len(spread))
    return Camera.from_values(values, nominal.image_size, pose)


def _attitude(rng: np.random.Generator) -> NDArray:
    """Return a pose of a board before the eyes. Shape (4, 4)."""
    depth = rng.uniform(_NEAR, _FAR)
    aside = rng.uniform(-0.5, 0.5, 2) * depth + [0.035, 0.0]
    return transform(rotation_from_vector(rng.normal(0.0, _TILT, 3)), [aside[0], aside[1], depth])

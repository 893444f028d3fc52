"""Looking again: what cameras see of a point tells how far it is from where a body expects it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.model.cameras.camera import Camera

_REMEMBERED = 10
"""Looks whose mean counts; older ones fade."""
_AWAY = 0.1
"""How far a point may be from where it is expected, along a line of sight of one camera [m]."""
_PIXEL_SIGMA = 1.0
"""Of a seen pixel coordinate, against that [px]."""


@dataclass(frozen=True, eq=False)
class SeenOff:
    """How far a point is from where a body expects it, in the mean over looks at it.

    What the body does not know of itself (a sag, a zero) is in every look; where joints rest in
    their play is another one in each, and a mean of k looks has it by 1 / sqrt(k).
    """

    offset: NDArray = field(default_factory=lambda: np.zeros(3))
    """In the body's world [m]. Shape (3,)."""
    looks: int = 0
    """How many that is the mean of."""

    def after(self, offset: ArrayLike) -> "SeenOff":
        """Return the mean with one look more, at which the point was that far off [m]. (3,)."""
        k = min(self.looks + 1, _REMEMBERED)
        return SeenOff(self.offset + (np.asarray(offset, dtype=float) - self.offset) / k, k)


def seen_place(
    cameras: Mapping[str, Camera], pixels: Mapping[str, ArrayLike], expected: ArrayLike
) -> NDArray | None:
    """Return where cameras see a point that is expected somewhere.

    It minimises `sum_i (f_i / z_i)^2 |(I - d d') (p - c_i)|^2 / s^2 + |p - p_expected|^2 / a^2`
    over the lines of sight `c_i + t d_i`: two of them tell the place, one its direction.

    Args:
        cameras: In the world where the point is.
        pixels: Camera -> where it sees the point; nan where it does not [px]. Shape (2,) each.
        expected: The place [m]. Shape (3,).

    Returns:
        The place [m], None where no camera sees it. Shape (3,).
    """
    near = np.asarray(expected, dtype=float)
    P, b, seen = np.eye(3) / _AWAY**2, near / _AWAY**2, False
    for name, camera in cameras.items():
        uv = np.asarray(pixels.get(name, (np.nan, np.nan)), dtype=float)
        d = camera.X_WC[:3, :3] @ camera.directions(uv[None])[0]
        if not np.isfinite(d).all():
            continue
        away = camera.X_WC[:3, 3] - near
        weight = camera.fx * camera.fy / (away @ away * _PIXEL_SIGMA**2)
        across = weight * (np.eye(3) - np.outer(d, d))
        P, b, seen = P + across, b + across @ camera.X_WC[:3, 3], True
    return np.linalg.solve(P, b) if seen else None

"""From points in a camera to pixels, with every derivative: the kernel of all estimators."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.model.cameras import fisheye, lens
from nico_selfmodel.names import refuse_unknown

INTRINSICS = ("fx", "fy", "skew", "cx", "cy", "k1", "k2", "k3", "p1", "p2")
"""Names of what lies inside a camera, in the order of `Camera.values`."""

POLYNOMIAL, RATIONAL, FISHEYE = "polynomial", "rational", "fisheye"
LENSES = (POLYNOMIAL, RATIONAL, FISHEYE)
"""How a lens bends light: `lens` with three or with six radial coefficients, or `fisheye`."""
_INSIDE = {
    POLYNOMIAL: INTRINSICS,
    RATIONAL: (*INTRINSICS, "k4", "k5", "k6"),
    FISHEYE: (*INTRINSICS[:8], "k4"),
}

EVERY_INTRINSIC = _INSIDE[RATIONAL]
"""Names of all that may lie inside a camera."""


@dataclass(frozen=True, eq=False)
class Projection:
    """Pixels and how they move with everything that they depend on."""

    pixels: NDArray
    """u right, v down; integers are pixel centres [px]. Shape (N, 2)."""
    by_point: NDArray
    """By the point in the world [px/m]. Shape (N, 2, 3)."""
    by_pose: NDArray
    """By (w, t) that move the camera to exp([w]) R_WC, p_WC + t [px/rad, px/m]. Shape (N, 2, 6)."""
    by_intrinsics: NDArray
    """By `intrinsics_of` the lens. Shape (N, 2, c)."""


@dataclass(frozen=True, eq=False)
class Rays:
    """Lines of sight: points p_WC + distance * direction."""

    origin: NDArray
    """The camera's centre in the world [m]. Shape (3,)."""
    direction: NDArray
    """Unit vectors in the world. Shape (N, 3)."""
    by_pixel: NDArray
    """Derivatives of the direction by the pixel [1/px]. Shape (N, 3, 2)."""
    by_pose: NDArray
    """By (w, t) as in `Projection`; the origin moves with t. Shape (N, 3, 6)."""
    by_intrinsics: NDArray
    """By `intrinsics_of` the lens. Shape (N, 3, c)."""


def intrinsics_of(kind: str) -> tuple[str, ...]:
    """Return the names of what lies inside a camera with a lens, in the order of its values.

    Raises:
        ValueError: If there is no such lens.
    """
    refuse_unknown("lens", kind, LENSES)
    return _INSIDE[kind]


def intrinsic_units(kind: str) -> tuple[str, ...]:
    """Return the units of `intrinsics_of` a lens: the intrinsic matrix's pixels, then numbers.

    Raises:
        ValueError: If there is no such lens.
    """
    return tuple("1" if name[0] in "kp" else "px" for name in intrinsics_of(kind))


def project_in_camera(
    p_CQ: NDArray, values: NDArray, kind: str = POLYNOMIAL
) -> tuple[NDArray, NDArray, NDArray]:
    """Project points given in the camera's frame; the kernel of every estimator with pixels.

    Args:
        p_CQ: Points with z other than zero, unless the lens is a fisheye [m]. Shape (3, ...).
        values: Intrinsics in the order of `intrinsics_of` the lens. Shape (c,).
        kind: The lens, one of `LENSES`.

    Returns:
        Pixels, shape (2, ...), their derivatives by the point, shape (2, 3, ...), and by the
        intrinsics, shape (2, c, ...).
    """
    fx, fy, skewness, cx, cy = values[:5]
    if kind == FISHEYE:
        (x, y), bent, bends = fisheye.bend(p_CQ, values[5:])
        by_point = np.stack([fx * bent[0] + skewness * bent[1], fy * bent[1]])
        pixels = np.stack([fx * x + skewness * y + cx, fy * y + cy])
        return pixels, by_point, _by_values(values, x, y, bends)
    k, p = values[5:8], values[8:10]
    if kind == RATIONAL:
        k = np.concatenate([k, values[10:]])
    depth = 1.0 / p_CQ[2]
    ideal = p_CQ[:2] * depth
    (x, y), slopes, bends = lens.bend(ideal, k, p)
    pixels = np.stack([fx * x + skewness * y + cx, fy * y + cy])
    by_point = np.empty((2, 3, *x.shape))
    # d(u, v)/d(x, y) = K2 distortion', d(x, y)/dX = [1, 0, -x; 0, 1, -y] / Z
    np.multiply(slopes[0], fx * depth, out=by_point[0, :2])
    np.multiply(slopes[1], fy * depth, out=by_point[1, :2])
    if skewness:
        by_point[0, :2] += skewness * depth * slopes[1]
    by_point[:, 2] = -(by_point[:, 0] * ideal[0] + by_point[:, 1] * ideal[1])
    return pixels, by_point, _by_values(values, x, y, bends)


def _by_values(values: NDArray, x: NDArray, y: NDArray, bends: NDArray) -> NDArray:
    """Return derivatives of pixels by the intrinsics from those of distorted coordinates."""
    fx, fy, skewness = values[:3]
    by_values = np.empty((2, len(values), *x.shape))
    by_values[:, :5] = 0.0
    by_values[0, 0], by_values[1, 1], by_values[0, 2] = x, y, y
    by_values[0, 3] = by_values[1, 4] = 1.0
    np.multiply(bends[0], fx, out=by_values[0, 5:])
    np.multiply(bends[1], fy, out=by_values[1, 5:])
    if skewness:
        by_values[0, 5:] += skewness * bends[1]
    return by_values

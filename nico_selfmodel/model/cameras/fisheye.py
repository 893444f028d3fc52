"""Fisheye lenses: the angle off the axis, bent by a polynomial (Kannala, Brandt 2006).

With theta the angle between a point's ray and the axis (in OpenCV's convention, `cv2.fisheye`):

    theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)
    (x', y') = theta_d (X, Y) / sqrt(X^2 + Y^2)

It acts on points themselves, not on X / Z and Y / Z, and so sees past 90 degrees.
"""

import numpy as np
from numpy.typing import NDArray

_NEWTON_STEPS = 50
_AXIS = 1e-9
"""Sine of the angle below which a point is on the axis."""
WIDEST = np.radians(89.0)
"""Angle up to which rays have coordinates X / Z and Y / Z worth computing with."""


def bent_angle(theta: NDArray, k: NDArray) -> tuple[NDArray, NDArray]:
    """Return theta_d and its derivative by theta.

    Args:
        theta: Angles off the axis [rad].
        k: k1 to k4. Shape (4,).
    """
    t2 = theta * theta
    bent = theta * (1.0 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))))
    slope = 1.0 + t2 * (3.0 * k[0] + t2 * (5.0 * k[1] + t2 * (7.0 * k[2] + t2 * 9.0 * k[3])))
    return bent, slope


def largest_angle(k: NDArray) -> float:
    """Return the angle up to which theta_d grows, at most pi [rad].

    Args:
        k: k1 to k4. Shape (4,).
    """
    powers = [1.0, 3.0 * k[0], 5.0 * k[1], 7.0 * k[2], 9.0 * k[3]]
    roots = np.polynomial.Polynomial(powers).roots() if any(powers[1:]) else np.zeros(0)
    real = roots[np.abs(roots.imag) <= 1e-9 * np.abs(roots).max(initial=1.0)].real
    positive = real[real > 0.0]
    return float(min(np.sqrt(positive.min()), np.pi)) if len(positive) else np.pi


def bend(p_CQ: NDArray, k: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Bend points in the camera's frame into distorted coordinates, with derivatives.

    Args:
        p_CQ: Points, none of them at the centre [m]. Shape (3, ...).
        k: k1 to k4. Shape (4,).

    Returns:
        x' and y', shape (2, ...), by the point, shape (2, 3, ...), and by k1 to k4, (2, 4, ...).
    """
    X, Y, Z = p_CQ
    rho = np.hypot(X, Y)
    theta = np.arctan2(rho, Z)
    bent, slope = bent_angle(theta, k)
    squared = rho * rho + Z * Z
    near = rho <= _AXIS * np.sqrt(squared)
    safe = np.where(near, 1.0, rho)
    # On the axis theta_d / rho is 1 / Z.
    ratio = np.where(near, 1.0 / np.where(near, Z, 1.0), bent / safe)
    out = ratio * np.stack([X, Y])
    # d theta = (Z d rho - rho d Z) / |p|^2, d rho = (X dX + Y dY) / rho
    by_rho = np.where(near, 0.0, (slope * Z / squared - ratio) / (safe * safe))
    by_depth = -slope / squared
    by_point = np.empty((2, 3, *np.shape(X)))
    by_point[0, 0], by_point[1, 1] = ratio + by_rho * X * X, ratio + by_rho * Y * Y
    by_point[0, 1] = by_point[1, 0] = by_rho * X * Y
    by_point[0, 2], by_point[1, 2] = by_depth * X, by_depth * Y
    unit = np.where(near, 0.0, 1.0 / safe) * np.stack([X, Y])
    powers = np.stack([theta ** (2 * i + 3) for i in range(4)])
    return out, by_point, unit[:, None] * powers[None]


def angles_of(distorted: NDArray, k: NDArray) -> NDArray:
    """Return the angle off the axis of distorted coordinates; nan where no ray belongs to them.

    Newton, kept inside a shrinking bracket.

    Args:
        distorted: x' and y'. Shape (2, ...).
        k: k1 to k4. Shape (4,).

    Returns:
        [rad]. Shape (...).
    """
    target = np.hypot(*distorted)
    limit = largest_angle(k)
    low, high = np.zeros_like(target), np.full_like(target, limit)
    theta = np.minimum(target, 0.9 * limit)
    for _ in range(_NEWTON_STEPS):
        bent, slope = bent_angle(theta, k)
        low, high = np.where(bent < target, theta, low), np.where(bent < target, high, theta)
        newton = theta - (bent - target) / np.where(slope == 0.0, 1.0, slope)
        inside = (newton >= low) & (newton <= high)
        step = np.where(inside, newton, 0.5 * (low + high)) - theta
        theta = theta + step
        if np.nanmax(np.abs(step), initial=0.0) < 1e-14:
            break
    return np.where(target < bent_angle(np.array(limit), k)[0], theta, np.nan)


def undistort(distorted: NDArray, k: NDArray) -> NDArray:
    """Return X / Z and Y / Z of distorted coordinates; nan beyond `WIDEST`.

    Args:
        distorted: x' and y'. Shape (2, ...).
        k: k1 to k4. Shape (4,).

    Returns:
        Shape (2, ...).
    """
    theta = angles_of(distorted, k)
    theta = np.where(theta < WIDEST, theta, np.nan)
    size = np.hypot(*distorted)
    ratio = np.where(size > 0.0, np.tan(theta) / np.where(size > 0.0, size, 1.0), 1.0)
    return np.asarray(distorted * ratio)

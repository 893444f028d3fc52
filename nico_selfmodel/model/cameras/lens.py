"""Radial and tangential distortion of ideal image coordinates, with its derivatives and inverse.

With r^2 = x^2 + y^2 and s = 1 + k1 r^2 + k2 r^4 + k3 r^6 (Brown 1966, in OpenCV's convention):

    x' = x s + 2 p1 x y + p2 (r^2 + 2 x^2),    y' = y s + p1 (r^2 + 2 y^2) + 2 p2 x y

Wide lenses need the rational s = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6):
radial coefficients are three, or these six.

It acts on (x, y) = (X/Z, Y/Z), before the intrinsic matrix.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import ImpossibleModelError

_NEWTON_STEPS = 50


def radial(r2: NDArray, k: NDArray) -> tuple[NDArray, NDArray]:
    """Return the factor s of ideal coordinates and its derivative by r^2.

    Args:
        r2: Squared radii.
        k: Radial coefficients, k1 to k3 or k1 to k6.
    """
    s = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[2]))
    slope = k[0] + r2 * (2.0 * k[1] + r2 * 3.0 * k[2])
    if len(k) == 3:
        return s, slope
    with np.errstate(divide="ignore", invalid="ignore"):
        return _fraction(r2, s, slope, k)


def _fraction(r2: NDArray, s: NDArray, slope: NDArray, k: NDArray) -> tuple[NDArray, NDArray]:
    """Return the factor of a rational lens from its numerator, with its derivative by r^2."""
    below = 1.0 + r2 * (k[3] + r2 * (k[4] + r2 * k[5]))
    below_slope = k[3] + r2 * (2.0 * k[4] + r2 * 3.0 * k[5])
    return s / below, (slope - s / below * below_slope) / below


def distort(ideal: NDArray, k: NDArray, p: NDArray) -> NDArray:
    """Bend ideal image coordinates as the lens does.

    Args:
        ideal: x and y. Shape (2, ...).
        k: Radial coefficients, k1 to k3 or k1 to k6. Shape (3,) or (6,).
        p: Tangential coefficients p1, p2. Shape (2,).

    Returns:
        Distorted coordinates. Shape (2, ...).
    """
    x, y = ideal
    r2 = x * x + y * y
    s, _ = radial(r2, k)
    if not p.any():
        return ideal * s
    xy = 2.0 * x * y
    return ideal * s + np.stack(
        [p[0] * xy + p[1] * (r2 + 2.0 * x * x), p[0] * (r2 + 2.0 * y * y) + p[1] * xy]
    )


def distortion_slopes(ideal: NDArray, k: NDArray, p: NDArray) -> NDArray:
    """Return the derivatives of the distorted by the ideal coordinates.

    Args:
        ideal: x and y. Shape (2, ...).
        k: Radial coefficients. Shape (3,) or (6,).
        p: Tangential coefficients. Shape (2,).

    Returns:
        d(x', y') / d(x, y). Shape (2, 2, ...).
    """
    x, y = ideal
    r2 = x * x + y * y
    s, by_square = radial(r2, k)
    slope = 2.0 * by_square
    cross = slope * x * y + 2.0 * (p[0] * x + p[1] * y)
    return np.stack(
        [
            np.stack([s + slope * x * x + 2.0 * p[0] * y + 6.0 * p[1] * x, cross]),
            np.stack([cross, s + slope * y * y + 6.0 * p[0] * y + 2.0 * p[1] * x]),
        ]
    )


def bend(ideal: NDArray, k: NDArray, p: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Bend ideal image coordinates, with all derivatives: `distort` in the innermost loops.

    Args:
        ideal: x and y. Shape (2, ...).
        k: Radial coefficients. Shape (3,) or (6,).
        p: Tangential coefficients. Shape (2,).

    Returns:
        Distorted coordinates, shape (2, ...), by the ideal ones, shape (2, 2, ...), and by k1, k2,
        k3, p1, p2 and, of a rational lens, k4, k5, k6, shape (2, 5, ...) or (2, 8, ...).
    """
    x, y = ideal
    xx, yy, xy = x * x, y * y, x * y
    r2 = xx + yy
    s, by_square = radial(r2, k)
    slope = 2.0 * by_square
    out, cross = ideal * s, slope * xy
    by_ideal = np.empty((2, 2, *r2.shape))
    by_ideal[0, 0], by_ideal[1, 1] = s + slope * xx, s + slope * yy
    if p.any():
        out += np.stack([2.0 * p[0] * xy + p[1] * (3.0 * xx + yy), 2.0 * p[1] * xy])
        out[1] += p[0] * (xx + 3.0 * yy)
        cross += 2.0 * (p[0] * x + p[1] * y)
        by_ideal[0, 0] += 2.0 * p[0] * y + 6.0 * p[1] * x
        by_ideal[1, 1] += 6.0 * p[0] * y + 2.0 * p[1] * x
    by_ideal[0, 1] = by_ideal[1, 0] = cross
    by = np.empty((2, 5 if len(k) == 3 else 8, *r2.shape))
    first = ideal * r2
    if len(k) == 6:
        first /= 1.0 + r2 * (k[3] + r2 * (k[4] + r2 * k[5]))
    by[:, 0] = first
    np.multiply(by[:, 0], r2, out=by[:, 1])
    np.multiply(by[:, 1], r2, out=by[:, 2])
    by[0, 3] = by[1, 4] = 2.0 * xy
    by[1, 3], by[0, 4] = r2 + 2.0 * yy, r2 + 2.0 * xx
    if len(k) == 6:
        np.multiply(by[:, :3], -s, out=by[:, 5:])
    return out, by_ideal, by


def largest_radius(k: NDArray) -> float:
    """Return the ideal radius up to which radial distortion is monotone.

    The smallest positive root of 1 + 3 k1 r^2 + 5 k2 r^4 + 7 k3 r^6, or of a rational lens N / D of
    N D + 2 r^2 (N' D - N D') or D; inf where there is none. Beyond it the lens would fold the image
    over itself.

    Args:
        k: Radial coefficients. Shape (3,) or (6,).
    """
    if len(k) == 3:
        return _first_root([7.0 * k[2], 5.0 * k[1], 3.0 * k[0], 1.0])
    N, D = (np.polynomial.Polynomial([1.0, *part]) for part in (k[:3], k[3:]))
    x = np.polynomial.Polynomial([0.0, 1.0])
    slope = N * D + 2.0 * x * (N.deriv() * D - N * D.deriv())
    return min(_first_root(slope.coef[::-1]), _first_root(D.coef[::-1]))


def _first_root(falling: Sequence[float] | NDArray) -> float:
    """Return the radius at the smallest positive root in r^2 of a polynomial; inf without one.

    Args:
        falling: Coefficients, the constant last.
    """
    # In s = 1 / r^2 the polynomial is monic, however small the last coefficients are.
    roots = np.polynomial.Polynomial(falling).roots()
    size = np.abs(roots).max(initial=0.0)
    real = roots[np.abs(roots.imag) <= 1e-9 * size].real
    positive = real[real > 1e-12 * max(size, 1e-12)]
    return float(positive.max() ** -0.5) if len(positive) else np.inf


def within_fold(distorted: NDArray, k: NDArray) -> NDArray:
    """Return which distorted coordinates have an ideal origin inside `largest_radius`.

    Tangential distortion, a thousandth of the radial one, is left out of the question.

    Args:
        distorted: x' and y'. Shape (2, ...).
        k: Radial coefficients. Shape (3,) or (6,).

    Returns:
        Boolean. Shape (...).
    """
    limit = largest_radius(k)
    if np.isinf(limit):
        return np.asarray(np.isfinite(distorted).all(axis=0))
    # Where a rational lens ends at its pole it rises to infinity, whose sign rounding decides.
    reach = abs(limit * radial(np.array(limit**2), k)[0])
    return np.hypot(*distorted) < reach


def undistort(distorted: NDArray, k: NDArray, p: NDArray) -> NDArray:
    """Find the ideal coordinates of distorted ones: a radial root, then Newton in two dimensions.

    Fixed-point iteration, the usual way, fails at wide angles.

    Args:
        distorted: x' and y'. Shape (2, N); nan stays nan.
        k: Radial coefficients. Shape (3,) or (6,).
        p: Tangential coefficients. Shape (2,).

    Returns:
        Ideal coordinates. Shape (2, N).

    Raises:
        ImpossibleModelError: If a point lies where the distortion is not monotone, or Newton does
            not end.
    """
    if not k.any() and not p.any():
        return np.array(distorted, dtype=float)
    outside = ~within_fold(distorted, k) & np.isfinite(distorted).all(axis=0)
    if outside.any():
        raise ImpossibleModelError(
            f"{int(outside.sum())} of {outside.size} points lie outside the radius where the "
            "lens distortion is monotone: no ray belongs to them; use points nearer to the "
            "image centre, or calibrate the lens with boards that reach the image's edge"
        )
    ideal = _undistort_radially(distorted, k)
    for _ in range(_NEWTON_STEPS):
        miss = distort(ideal, k, p) - distorted
        (a, b), (c, d) = distortion_slopes(ideal, k, p)
        step = np.stack([d * miss[0] - b * miss[1], a * miss[1] - c * miss[0]]) / (a * d - b * c)
        ideal = ideal - step
        # Quadratic convergence: the step after one this small is below rounding.
        if np.nanmax(np.abs(step), initial=0.0) < 1e-9:
            return ideal
    raise ImpossibleModelError(
        "lens distortion could not be inverted: its coefficients are not plausible"
    )


def _undistort_radially(distorted: NDArray, k: NDArray) -> NDArray:
    """Undo radial distortion alone, by Newton kept inside a shrinking bracket of the radius."""
    target = np.hypot(*distorted)
    limit = largest_radius(k)
    low = np.zeros_like(target)
    high = np.full_like(
        target, limit if np.isfinite(limit) else 1e3 * (1.0 + np.nanmax(target, initial=0.0))
    )
    r = np.minimum(target, 0.9 * high)
    for _ in range(_NEWTON_STEPS):
        r2 = r * r
        s, by_square = radial(r2, k)
        value, slope = r * s - target, s + 2.0 * r2 * by_square
        low, high = np.where(value < 0.0, r, low), np.where(value < 0.0, high, r)
        newton = r - value / np.where(slope == 0.0, 1.0, slope)
        inside = (newton >= low) & (newton <= high)
        step = np.where(inside, newton, 0.5 * (low + high)) - r
        r = r + step
        if np.nanmax(np.abs(step), initial=0.0) < 1e-12:
            break
    return distorted * np.where(target > 0.0, r / np.where(target > 0.0, target, 1.0), 1.0)

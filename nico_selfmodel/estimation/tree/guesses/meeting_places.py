"""Where markers are that nothing sees, by the distances at which they met others.

Of two ends at p + R x each row tells |p_1 + R_1 x_1 - p_2 - R_2 x_2| = s l, with s of each sensor:
an unknown distance, or how much larger the body is than lengths that are told. A loss that
trusts millimetres from the start explains a few rows to the last digit and none of the rest: by 15
touches, from 10 to 17 cm off, it found the places in one of eight tries, Cauchy's with a scale that
sinks from the errors' own (graduated non-convexity, Blake, Zisserman 1987) in six of seven, and the
best of several starts in all but one of 140.
"""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.least_squares import levenberg_marquardt_each

_STARTS = 64
"""Places that are tried, the first one as it is."""
_FARTHEST = 0.5
"""How far others are from it, in errors of the first."""
_FINEST = 1e-3
"""Scale at which the loss ends [m]."""
_SINKS = 0.7
"""Part of its scale that the loss keeps each time."""
_STEPS = 3
"""Steps at each scale."""


def meeting_places(
    R: NDArray, p: NDArray, at: NDArray, own: NDArray, sensor: NDArray, lengths: NDArray
) -> NDArray:
    """Return where markers are on their links.

    Args:
        R: Turns of the links of both ends. Shape (N, 2, 3, 3).
        p: Their places [m]. Shape (N, 2, 3).
        at: Places of both ends on their links, as far as they are known [m]. Shape (N, 2, 3).
        own: Which of the K markers an end is, if any. Boolean, shape (N, 2, K).
        sensor: Of each row, from 0 on. Shape (N,).
        lengths: What was measured, 1 where it is unknown. Shape (N,).

    Returns:
        Shape (K, 3).
    """
    markers, sensors = own.shape[2], int(sensor.max()) + 1
    told = np.where(sensor[:, None] == np.arange(sensors), lengths[:, None], 0.0)
    first = np.array([at[own[:, :, k]][0] for k in range(markers)])
    rows = partial(_rows, R, p, at, own, told)
    scales = np.ones((1, sensors))
    apart = rows(np.hstack([first.reshape(1, -1), 0.0 * scales]))[0][0]
    by_sensor = [np.flatnonzero(sensor == s) for s in range(sensors)]
    usual = [float(np.median(apart[of] / lengths[of])) for of in by_sensor]
    off = float(np.sqrt(np.mean((apart - told @ usual) ** 2)))
    drawn = np.random.default_rng(markers).normal(size=(_STARTS, markers, 3))
    drawn[0] = 0.0
    places = first + _FARTHEST * off * drawn
    x = np.hstack([places.reshape(_STARTS, -1), np.tile(usual, (_STARTS, 1))])
    scale = max(off, _FINEST)
    while True:
        x, cost = levenberg_marquardt_each(partial(_cauchy, rows, scale), x, max_iterations=_STEPS)
        if scale <= _FINEST:
            break
        scale = max(_SINKS * scale, _FINEST)
    return np.asarray(x[np.argmin(cost), : 3 * markers].reshape(markers, 3))


def _rows(
    R: NDArray, p: NDArray, at: NDArray, own: NDArray, told: NDArray, x: NDArray
) -> tuple[NDArray, NDArray]:
    """Return residuals (S, N) and their derivatives (S, N, 3 K + sensors) at points (S, ...)."""
    markers = own.shape[2]
    places = x[:, : 3 * markers].reshape(len(x), 1, 1, markers, 3)
    ends = np.where(np.any(own, axis=2, keepdims=True), np.sum(own[..., None] * places, axis=3), at)
    apart = np.einsum("neij,snej->snei", R, ends) + p
    between = apart[:, :, 0] - apart[:, :, 1]
    length = np.maximum(np.linalg.norm(between, axis=2), 1e-9)
    along = np.einsum("sni,neij->snej", between / length[:, :, None], R) * [[1.0], [-1.0]]
    by_place = np.einsum("snej,nek->snkj", along, own.astype(float)).reshape(*length.shape, -1)
    by_length = np.broadcast_to(-told, (len(x), *told.shape))
    return length - x[:, 3 * markers :] @ told.T, np.concatenate([by_place, by_length], axis=2)


def _cauchy(
    rows: partial[tuple[NDArray, NDArray]], scale: float, _: NDArray, x: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    """Return costs, gradients and Gauss-Newton matrices of Cauchy's loss at points (S, P)."""
    r, J = rows(x)
    weighed = J / (1.0 + (r / scale) ** 2)[:, :, None]
    cost = 0.5 * scale**2 * np.log1p((r / scale) ** 2).sum(axis=1)
    return cost, np.einsum("snp,sn->sp", weighed, r), np.swapaxes(weighed, 1, 2) @ J

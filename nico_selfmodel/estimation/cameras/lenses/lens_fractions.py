"""Whether boards tell the coefficients of a rational lens one by one.

A fraction N / D of polynomials in r^2 stays what it is where both are multiplied by 1 - a r^2. So
where one of a degree less explains the corners nearly as well, a pole and a zero that nearly cancel
may stand anywhere (a Froissart doublet; Gonnet, Guettel, Trefethen 2013), and k1 to k6 are what
chance makes of them. A linearised sigma knows of the nearest place alone. All of them together, and
so pixels, are told as well as ever.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import EstimationError, ModelError
from nico_selfmodel.estimation.cameras.camera_adjustment import Adjustment, CameraCalibration
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import RATIONAL

_DOUBT = 25.0
"""Logarithm of the likelihoods' ratio up to which a fraction of a degree less may be meant. Of 250
lenses drawn, coefficients lie up to 170 sigma off below it, at most 3.1 above."""
_ROUNDS, _LEAST = 6, 1e-3
"""Of linear solutions for a fraction, and the smallest denominator that they are divided by."""
_ABOVE, _BELOW = ("k3", "k2", "k1"), ("k6", "k5", "k4")
"""Of the numerator and the denominator, the highest degree first."""


def with_told_sigmas(calibration: CameraCalibration, options: CameraOptions) -> CameraCalibration:
    """Return cameras without sigmas of coefficients of which only all together are told."""
    found: list[str] = []
    for name, camera in zip(calibration.views.cameras, calibration.cameras, strict=True):
        highest = _highest(calibration, name, camera)
        if highest and _surplus(calibration, options, name, highest) < _DOUBT:
            found += [n for n in calibration.names if n.startswith(f"{name}.k")]
    if not found:
        return calibration
    return replace(calibration, uncertainty=calibration.uncertainty.told_together(found))


def told_together(calibration: CameraCalibration) -> CameraCalibration:
    """Return cameras without sigmas of the coefficients of rational lenses.

    As where some were left out because corners do not need them: they may be anything.
    """
    told = calibration.uncertainty.told_together(
        f"{name}.k{i + 1}"
        for name, camera in zip(calibration.views.cameras, calibration.cameras, strict=True)
        for i in range(6 * (camera.lens == RATIONAL))
    )
    return replace(calibration, uncertainty=told)


def _highest(calibration: CameraCalibration, name: str, camera: Camera) -> tuple[str, ...]:
    """Return the last coefficients above and below the line; none where a pair has no room.

    What was left out is as good as free: a pair that cancels may stand there.
    """
    if camera.lens != RATIONAL:
        return ()
    ends = []
    for part in (_ABOVE, _BELOW):
        there = [k for k in part if getattr(camera, k) or f"{name}.{k}" in calibration.names]
        if not there or f"{name}.{there[0]}" not in calibration.names:
            return ()
        ends.append(there[0])
    return tuple(ends)


def _surplus(
    calibration: CameraCalibration, options: CameraOptions, name: str, highest: tuple[str, ...]
) -> float:
    """Return by how much corners are less likely where a lens has none of the highest terms."""
    inliers = ~calibration.outliers
    without = {f"{name}.{k}": 0.0 for k in highest}
    less = replace(options, pinned={**options.pinned, **without})
    number = calibration.views.cameras.index(name)
    cameras = list(calibration.cameras)
    cameras[number] = _reduced(calibration, number, highest)
    views = calibration.views.select(inliers)
    try:
        adjustment = Adjustment(views, tuple(cameras), calibration.X_LG[inliers], less)
        adjustment.solve("none")
        cost = adjustment.result(0.0).cost
    except (EstimationError, ModelError):
        return np.inf
    return float((cost - calibration.cost) / calibration.pixel_sigma**2)


def _reduced(calibration: CameraCalibration, number: int, highest: tuple[str, ...]) -> Camera:
    """Return the camera with the fraction of a degree less that is nearest where corners are.

    N - s D = 0 is linear in the coefficients that are left; over D of the solution before, it is
    what a pixel moves by (Sanathanan, Koerner 1963).
    """
    camera, name = calibration.cameras[number], calibration.views.cameras[number]
    x = _squared_radii(calibration, number)
    powers = np.stack([x, x**2, x**3], axis=1)
    s = (1.0 + powers @ camera.k[:3]) / (1.0 + powers @ camera.k[3:])
    every = [f"k{i + 1}" for i in range(6)]
    free = np.isin([f"{name}.{k}" for k in every], calibration.names) & ~np.isin(every, highest)
    k = np.where(free | np.isin(every, highest), 0.0, camera.k)
    columns = np.hstack([powers, -s[:, None] * powers])
    size = np.abs(columns).max(axis=0)
    rest, below = s - 1.0 - columns @ k, np.ones_like(x)
    for _ in range(_ROUNDS):
        weight = np.sqrt(x) / below
        scaled = (columns / size)[:, free] * weight[:, None]
        k[free] = np.linalg.lstsq(scaled, rest * weight, rcond=None)[0] / size[free]
        below = np.maximum(np.abs(1.0 + powers @ k[3:]), _LEAST)
    return replace(camera, **dict(zip(every, k.tolist(), strict=True)))


def _squared_radii(calibration: CameraCalibration, number: int) -> NDArray:
    """Return (X / Z)^2 + (Y / Z)^2 of all corners that a camera saw."""
    camera, seen = calibration.cameras[number], calibration.views.seen[:, number]
    p_CQ = apply(inverse(camera.X_WC) @ calibration.X_LG[:, None], calibration.views.p_GQ[None])
    p = p_CQ[seen & ~calibration.outliers[:, None]]
    return np.sum((p[:, :2] / p[:, 2:]) ** 2, axis=1)

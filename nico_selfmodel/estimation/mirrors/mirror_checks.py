"""Reflections that are none, and views that are reflections: told before anything is learned."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import DataError, EstimationError
from nico_selfmodel.estimation.mirrors.mirror_initialization import virtual_points
from nico_selfmodel.estimation.mirrors.mirror_solution import solve_mirrors, start_mirrors
from nico_selfmodel.estimation.mirrors.reflection_residuals import independent_covariance
from nico_selfmodel.estimation.mirrors.reflections import ReflectionNoise, Reflections, seen_by_any
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import GATE_99, projected, reflected_projection
from nico_selfmodel.model.self_model import SelfModel

_LOOKS_DIRECT = 3.0 * GATE_99
"""Chi-square of four coordinates below which a view is taken for the hand itself."""
_SAME_PLACE = 0.1
"""A reflection nearer to its point than this share of the distance to the camera is none."""


def require_reflections(reflections: Reflections, noise: ReflectionNoise) -> None:
    """Refuse mirrors most of whose pixels show the points themselves.

    Raises:
        DataError: Naming the mirror.
    """
    virtual, direct = virtual_points(reflections), _direct_chi_square(reflections, noise)
    for m, name in enumerate(reflections.mirrors):
        rows = reflections.mirror == m
        gap = np.linalg.norm(virtual - reflections.p_LQ, axis=1)[rows]
        reach = np.linalg.norm(reflections.p_LQ[rows], axis=1)
        rebuilt = np.isfinite(gap)
        near = rebuilt.any() and np.median((gap / reach)[rebuilt]) < _SAME_PLACE
        if near or np.median(direct[rows]) < _LOOKS_DIRECT:
            miss = _direct_miss(reflections.select(rows))
            raise DataError(
                f"the pixels of mirror {name!r} show the hand itself, {np.median(miss):.1f} px "
                "from where it is expected without a mirror: leave the column `mirror` empty in "
                "rows of direct views (a hand on the glass looks the same and tells nothing)"
            )


def unnamed_reflections(dataset: Dataset, model: SelfModel, noise: ReflectionNoise) -> str:
    """Say what rows without a mirror's name look like, where none has one.

    Args:
        dataset: Data without a named reflection.

    Returns:
        An explanation to add to a message; empty where there is none.
    """
    rows = np.flatnonzero(seen_by_any(dataset.pixels))
    if not rows.size:
        return "; it has no pixels at all"
    views = Reflections.of_rows(dataset, model, rows, ["?"] * len(rows))
    if np.median(_direct_chi_square(views, noise)) < _LOOKS_DIRECT:
        return "; its pixels show the hand directly"
    try:
        (mirror,) = solve_mirrors(views, start_mirrors(views), noise).mirrors
    except (DataError, EstimationError):
        return "; its pixels show neither the hand nor its reflection in one mirror"
    reflected = chi_square(views, mirror, noise)
    if np.median(reflected) > _LOOKS_DIRECT:
        return "; its pixels show neither the hand nor its reflection in one mirror"
    return (
        f"; its pixels are not the hand seen directly, but fit reflections in a mirror "
        f"{1e3 * mirror.distance:.0f} mm from the left camera: write a name into column `mirror`"
    )


def misplaced_rows(
    dataset: Dataset, model: SelfModel, mirrors: dict[str, Mirror], noise: ReflectionNoise
) -> NDArray:
    """Return rows that are called direct views but are reflections in a known mirror.

    Args:
        dataset: All data.

    Returns:
        Rows of the data set. Shape (k,).
    """
    rows = np.flatnonzero(seen_by_any(dataset.pixels) & (dataset.mirror == ""))
    if not rows.size or set(dataset.marker[rows].tolist()) - set(model.markers):
        return rows[:0]
    views = Reflections.of_rows(dataset, model, rows, ["?"] * len(rows))
    direct = _direct_chi_square(views, noise)
    reflected = np.min([chi_square(views, mirror, noise) for mirror in mirrors.values()], axis=0)
    return rows[(reflected < _LOOKS_DIRECT) & (direct > reflected)]


def _direct_chi_square(reflections: Reflections, noise: ReflectionNoise) -> NDArray:
    """Return how badly each row fits its point seen directly; inf where it cannot be. (N,)."""
    shown = [camera.project(reflections.p_WQ) for camera in reflections.cameras]
    visible = np.isfinite(np.concatenate(shown, axis=1)) | ~reflections.seen
    visible = np.asarray(visible.all(axis=1))
    found = np.full(len(reflections), np.inf)
    if visible.any():
        rows = reflections.select(visible)
        pixels, by_point = projected(rows.cameras, rows.p_WQ)
        found[visible] = _chi_square(rows, pixels, by_point, noise)
    return found


def chi_square(reflections: Reflections, mirror: Mirror, noise: ReflectionNoise) -> NDArray:
    """Return how badly each row fits its point seen in a mirror. Shape (N,)."""
    shown = reflected_projection(reflections.cameras, mirror.values, reflections.p_WQ)
    return _chi_square(reflections, shown.pixels, shown.by_point, noise)


def _chi_square(
    reflections: Reflections, pixels: NDArray, by_point: NDArray, noise: ReflectionNoise
) -> NDArray:
    covariance = independent_covariance(reflections, by_point, noise)
    shared = reflections.shared
    if shared is not None:
        factor = by_point @ shared.by_parameter @ shared.root
        covariance = covariance + factor @ np.swapaxes(factor, 1, 2)
    seen = reflections.seen[:, :, None] & reflections.seen[:, None, :]
    covariance = np.where(seen, covariance, np.eye(pixels.shape[1]))
    miss = np.nan_to_num(reflections.pixels - pixels)
    return np.sum(miss * np.linalg.solve(covariance, miss[:, :, None])[:, :, 0], axis=1)


def _direct_miss(reflections: Reflections) -> NDArray:
    """Return the distance of each pixel from the point seen without a mirror [px]."""
    shown = [camera.project(reflections.p_WQ) for camera in reflections.cameras]
    miss = reflections.pixels - np.concatenate(shown, axis=1)
    distances = np.linalg.norm(miss.reshape(len(miss), -1, 2), axis=2)
    return distances[np.isfinite(distances)]

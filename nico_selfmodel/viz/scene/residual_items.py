"""Measured points with their residuals, held-out points, outliers."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.arm.kinematics import KinematicCalibration
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.inlier_errors import inlier_lengths, inlier_rows, largest_shown
from nico_selfmodel.viz.figures.numbers_shown import nice_factor, short
from nico_selfmodel.viz.scene.circle_items import samples_by_owner
from nico_selfmodel.viz.scene.scene import LegendEntry
from nico_selfmodel.viz.scene.scene_items import Item, Markers, Needles

_POINT_RADIUS, _OUTLIER_RADIUS, _NEEDLE_RADIUS = 0.008, 0.02, 0.0045
_DRAWN_LENGTH, _LONGEST = 0.15, 0.6
"""How long a large residual is drawn, and from which drawn length on it is not magnified."""


def point_items(calibration: KinematicCalibration, unit: float) -> list[Item]:
    """Return measured points that lie on no circle, held-out points and outliers.

    Args:
        unit: Length that sizes are fractions of [m].

    Returns:
        Items under `training`, `held_out` and `outliers`.
    """
    items: list[Item] = []
    measured = calibration.train.observations.p_WH
    free = _free_rows(calibration)
    if free.size:
        items.append(_points("training/free_poses", measured[free], palette.TRAINING, unit))
    if calibration.test is not None:
        held_out = calibration.test.observations.p_WH
        items.append(_points("held_out/points", held_out, palette.HELD_OUT, unit))
    outliers = np.flatnonzero(calibration.outliers)
    if outliers.size:
        color = palette.rgba(palette.OUTLIER)
        marks = Markers(
            path="outliers/points",
            color=color,
            centers=measured[outliers],
            radius=_OUTLIER_RADIUS * unit,
            shape="diamond",
        )
        misses = Needles(
            path="outliers/residuals_x1",
            color=color,
            starts=calibration.train.p_WH_predicted[outliers],
            ends=measured[outliers],
            radius=_NEEDLE_RADIUS * unit,
        )
        items += [marks, misses]
    return items


def point_legend(calibration: KinematicCalibration) -> list[LegendEntry]:
    """Return what the colours of points mean."""
    entries = []
    free = _free_rows(calibration)
    if free.size:
        color = palette.rgba(palette.TRAINING)
        entries.append(LegendEntry(f"training, free poses ({free.size})", color))
    if calibration.test is not None:
        count = len(calibration.test.observations)
        entries.append(LegendEntry(f"held-out points ({count})", palette.rgba(palette.HELD_OUT)))
    if calibration.outliers.any():
        label = f"outliers, with their true residual ({int(calibration.outliers.sum())})"
        entries.append(LegendEntry(label, palette.rgba(palette.OUTLIER)))
    return entries


def residual_items(calibration: KinematicCalibration, unit: float) -> list[Item]:
    """Return residuals as needles from predicted towards measured, longer than they are.

    Args:
        unit: Length that sizes are fractions of [m].

    Returns:
        Items whose path ends in the factor, under `training` and `held_out`; those of outliers are
        not among them.
    """
    factor, largest = _residual_factor(calibration, unit), largest_shown(calibration)
    items: list[Item] = []
    for name, evaluation, rows in inlier_rows(calibration):
        far = factor * evaluation.distances[rows] > _LONGEST * unit
        for chosen, scale, word in ((rows[~far], factor, ""), (rows[far], 1.0, "large_")):
            if chosen.size:
                residuals = evaluation.residuals[chosen]
                starts = evaluation.p_WH_predicted[chosen]
                needles = Needles(
                    path=f"{name}/{word}residuals_x{scale:g}",
                    color=palette.rgba(palette.MUTED),
                    starts=starts,
                    ends=starts + scale * residuals,
                    radius=_NEEDLE_RADIUS * unit,
                    colors=palette.error_colors(evaluation.distances[chosen], largest),
                )
                items.append(needles)
    return items


def residual_legend(calibration: KinematicCalibration, unit: float) -> list[LegendEntry]:
    """Return the factor and the colour scale of the residuals."""
    factor, largest = _residual_factor(calibration, unit), largest_shown(calibration)
    scale = palette.scale(palette.ERRORS)
    label = f"residuals, drawn ×{factor:g} (0 to {short(1e3 * largest)} mm)"
    entries = [LegendEntry(label, scale[-1], scale)]
    far = int(np.sum(factor * inlier_lengths(calibration) > _LONGEST * unit))
    if far and factor > 1.0:
        limit = short(1e3 * _LONGEST * unit / factor)
        label = f"residuals over {limit} mm, drawn ×1 ({far})"
        entries.append(LegendEntry(label, scale[-1]))
    return entries


def _residual_factor(calibration: KinematicCalibration, unit: float) -> float:
    """Return the factor by which residuals are drawn longer than they are."""
    return nice_factor(_DRAWN_LENGTH * unit, largest_shown(calibration))


def _free_rows(calibration: KinematicCalibration) -> NDArray:
    """Return training rows, without outliers, that lie on no circle."""
    on_circle = list(samples_by_owner(calibration).values())
    inliers = np.flatnonzero(~calibration.outliers)
    return np.setdiff1d(inliers, np.concatenate(on_circle)) if on_circle else inliers


def _points(path: str, centers: NDArray, color: str, unit: float) -> Markers:
    radius = _POINT_RADIUS * unit
    return Markers(path=path, color=palette.rgba(color), centers=centers, radius=radius)

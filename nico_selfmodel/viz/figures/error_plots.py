"""Figures of the errors: how large, where in the workspace, at which joint angles."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from nico_selfmodel.estimation.arm.kinematics import KinematicCalibration
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.distribution_plot import distribution, error_sets
from nico_selfmodel.viz.figures.inlier_errors import inlier_rows, largest_shown
from nico_selfmodel.viz.figures.layout.plain_figure import PlainFigure
from nico_selfmodel.viz.figures.plot_style import FULL_WIDTH, MANY, dots, headline, style

_MOST_BINS, _LEAST_IN_BIN = 9, 5
_BAND = 1.12
"""Half the height of the band of a coordinate, in limits of its residuals."""
_STANDS_OUT = 3.7
"""Standard scores from which a bin's mean is a trend: noise in 100 bins gets there once in 50."""


def error_distribution(calibration: KinematicCalibration) -> Figure:
    """Draw the share of points whose error is below each value, means and rms marked."""
    found = (
        None if calibration.test is None else calibration.test.distances,
        calibration.cross_validation,
        calibration.train.distances[~calibration.outliers],
    )
    told = (None if errors is None else errors[np.isfinite(errors)] for errors in found)
    sets = error_sets(*(None if errors is None else 1e3 * errors for errors in told))
    return distribution(sets, unit="mm", what="error of a point", thing="point")


def error_over_workspace(calibration: KinematicCalibration) -> Figure:
    """Draw where the errors are, in three projections of the measuring frame."""
    scale = Normalize(0.0, 1e3 * largest_shown(calibration) or 1.0)
    with style():
        figure = PlainFigure(figsize=(FULL_WIDTH, 4.0))
        panels = figure.subplots(1, 3)
        for axes, (a, b) in zip(panels, ((0, 1), (0, 2), (1, 2)), strict=True):
            for name, evaluation, rows in inlier_rows(calibration):
                ringed = name == "held_out"
                # The large errors are drawn last, on top.
                order = rows[np.argsort(evaluation.distances[rows])]
                points = 1e3 * evaluation.observations.p_WH[order]
                axes.scatter(
                    points[:, a],
                    points[:, b],
                    c=1e3 * evaluation.distances[order],
                    cmap=palette.ERRORS,
                    norm=scale,
                    s=34.0 if ringed else 16.0,
                    edgecolors=palette.HELD_OUT if ringed else "none",
                    linewidths=0.9,
                    rasterized=len(order) > MANY,
                )
            axes.set_xlabel(f"{'xyz'[a]} [mm]")
            axes.set_ylabel(f"{'xyz'[b]} [mm]")
            axes.set_aspect("equal", adjustable="datalim")
        bar = figure.colorbar(
            ScalarMappable(scale, palette.ERRORS), ax=panels, extend="max", pad=0.01, aspect=28
        )
        bar.set_label("error [mm]")
        bar.outline.set_visible(False)
        note = " (ringed: held-out)" if calibration.test is not None else ""
        headline(figure, f"{_worst(calibration)}{note}")
    return figure


def residuals_over_angles(calibration: KinematicCalibration) -> Figure:
    """Draw residual components against every joint angle, with the means of bins.

    What a model cannot express (backlash, sag, a wrong gear) shows as a curve. Residuals far beyond
    the others are drawn as triangles at the edge, and count as lying there.
    """
    inliers = ~calibration.outliers
    residuals = 1e3 * calibration.train.residuals[inliers]
    servos = calibration.model.servos
    angles = calibration.train.observations.angles[inliers]
    q = np.degrees((angles - servos.offset) / servos.gear)
    joints, limit = calibration.model.joints, _axis_limit(residuals)
    with style():
        figure = PlainFigure(figsize=(FULL_WIDTH, 4.6))
        panels = figure.subplots(1, len(joints), sharey=True, squeeze=False)[0]
        trends = []
        for i, (axes, joint) in enumerate(zip(panels, joints, strict=True)):
            color = palette.joint_color(i)
            _scattered(axes, q[:, i], residuals, limit, color)
            for k in range(3):
                score, size = _trend(axes, q[:, i], residuals[:, k], limit, _middle(k, limit))
                trends.append((score, f"{size:.2f} mm in {'xyz'[k]} over {joint}"))
            axes.set_title(joint, fontsize=8.5, loc="center", wrap=True)
            axes.set_xlabel("angle [deg]")
        _bands(panels[0], limit)
        headline(figure, _strongest_trend(trends, float(np.sqrt(np.mean(residuals**2)))))
    return figure


def _middle(k: int, limit: float) -> float:
    """Return where the zero of x, y and z is: three bands, one above the other [mm]."""
    return -2.0 * _BAND * k * limit


def _bands(axes: Axes, limit: float) -> None:
    """Label the bands of x, y and z as three axes of residuals, which other panels share."""
    ticks = MaxNLocator(2, symmetric=True).tick_values(-limit, limit)
    ticks = ticks[np.abs(ticks) <= limit].tolist()
    at = [_middle(k, limit) + tick for k in range(3) for tick in ticks]
    words = [
        f"{tick:g}".replace("-", "−") if tick else f"{axis}  0" for axis in "xyz" for tick in ticks
    ]
    axes.set_yticks(at, words)
    axes.set_ylim(_middle(2, limit) - _BAND * limit, _BAND * limit)
    axes.set_ylabel("residual [mm]")


def _scattered(axes: Axes, angle: NDArray, residuals: NDArray, limit: float, color: str) -> None:
    """Draw residuals of x, y and z over an angle, each in its band. Shapes (N,) and (N, 3)."""
    middles = np.array([_middle(k, limit) for k in range(3)])
    over, inside = np.repeat(angle[:, None], 3, axis=1), np.abs(residuals) <= limit
    size = 2.0 if len(angle) > 300 else 3.2
    dots(axes, over[inside], (residuals + middles)[inside], color=color, size=size)
    for mark, rows in (("^", residuals > limit), ("v", residuals < -limit)):
        if rows.any():
            places = (np.sign(residuals) * limit + middles)[rows]
            axes.plot(over[rows], places, mark, color=color, markersize=4.0, alpha=0.45)
    for edge in middles[:-1] - _BAND * limit:
        axes.axhline(edge, color=palette.MUTED, linewidth=0.8)
    axes.hlines(middles, angle.min(), angle.max(), color=palette.MUTED, linewidth=0.8)


def _trend(
    axes: Axes, angle: NDArray, residual: NDArray, limit: float, middle: float
) -> tuple[float, float]:
    """Draw the means of bins; return the largest standard score and its mean [mm]."""
    residual, members = np.clip(residual, -limit, limit), _bins_of(angle)
    if len(members) < 3:
        return 0.0, 0.0
    at = [float(angle[rows].mean()) for rows in members]
    mean = np.array([residual[rows].mean() for rows in members])
    error = residual.std(ddof=1) / np.sqrt([len(rows) for rows in members])
    ink = {"color": palette.INK, "linewidth": 1.5}
    axes.vlines(at, middle + mean - error, middle + mean + error, **ink)
    axes.plot(at, middle + mean, "o-", markersize=3, **ink)
    score = np.abs(mean) / np.maximum(error, 1e-12)
    return float(score.max()), float(np.abs(mean[np.argmax(score)]))


def _bins_of(angle: NDArray) -> list[NDArray]:
    """Return the rows in bins of equal width, without bins that hold too few."""
    count = int(np.clip(len(angle) // (2 * _LEAST_IN_BIN), 1, _MOST_BINS))
    share = (angle - angle.min()) / (np.ptp(angle) or 1.0)
    bin_of = np.minimum((count * share).astype(int), count - 1)
    members = [np.flatnonzero(bin_of == k) for k in range(count)]
    return [rows for rows in members if len(rows) >= _LEAST_IN_BIN]


def _axis_limit(residuals: NDArray) -> float:
    """Return where the axis of residuals ends: at the largest, unless few lie far out [mm]."""
    size = np.abs(residuals)
    return float(min(size.max(), 7.0 * np.median(size))) or 1.0


def _strongest_trend(trends: list[tuple[float, str]], rms: float) -> str:
    """Say whether a trend stands out of the noise of its bins, and which is the clearest."""
    score, where = max(trends)
    if score == 0.0:
        return f"Training residuals ({rms:.2f} mm rms): too few points to show trends"
    if score < _STANDS_OUT:
        return f"Training residuals ({rms:.2f} mm rms): no trend over a joint angle stands out"
    return f"Training residuals ({rms:.2f} mm rms): a trend of {where} is left"


def _worst(calibration: KinematicCalibration) -> str:
    """Say which inlier is predicted worst, of the held-out ones where there are some."""
    name, evaluation, rows = inlier_rows(calibration)[-1]
    worst = rows[np.argmax(evaluation.distances[rows])]
    x, y, z = 1e3 * evaluation.observations.p_WH[worst]
    error = 1e3 * evaluation.distances[worst]
    place = f"({x:.0f}, {y:.0f}, {z:.0f}) mm".replace("-", "−")
    return f"Largest {name.replace('_', '-')} error: {error:.2f} mm, at {place}"

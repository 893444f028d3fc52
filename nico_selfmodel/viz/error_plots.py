"""Figures of the errors: how large, where in the workspace, at which joint angles."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from nico_selfmodel.estimation import Evaluation, KinematicCalibration
from nico_selfmodel.viz import palette
from nico_selfmodel.viz.plot_style import FULL_WIDTH, HALF_WIDTH, headline, style

_LOG_FROM = 8.0
"""Ratio of the medians from which errors are shown on a logarithmic axis."""
_BINS, _LEAST_IN_BIN = 8, 5


def error_sets(calibration: KinematicCalibration) -> list[tuple[str, str, NDArray]]:
    """Return label, colour and errors [mm] of every set there is, the most telling first."""
    sets = []
    if calibration.test is not None:
        sets.append(("held out", palette.HELD_OUT, calibration.test.distances))
    if len(calibration.cross_validation):
        sets.append(("cross-validation", palette.CROSS_VALIDATION, calibration.cross_validation))
    believed = calibration.train.distances[~calibration.outliers]
    sets.append(("training", palette.TRAINING, believed))
    return [(label, color, 1e3 * np.sort(errors)) for label, color, errors in sets]


def error_distribution(calibration: KinematicCalibration) -> Figure:
    """Draw the share of points whose error is below each value, means and rms marked."""
    sets = error_sets(calibration)
    with style():
        figure = Figure(figsize=(HALF_WIDTH, 3.9))
        axes = figure.add_subplot()
        for label, color, errors in sets:
            share = np.arange(1, len(errors) + 1) / len(errors)
            mean, rms = errors.mean(), np.sqrt(np.mean(errors**2))
            text = f"{label} ({len(errors)}): mean {mean:.2f}, rms {rms:.2f} mm"
            axes.step(errors, 100.0 * share, where="post", color=color, label=text)
            for value, mark in ((mean, "o"), (rms, "D")):
                height = 100.0 * np.mean(errors <= value)
                axes.plot(value, height, mark, color=color, markeredgecolor="white", markersize=7)
        medians = [float(np.median(errors)) for _, _, errors in sets]
        if max(medians) > _LOG_FROM * min(medians) > 0.0:
            axes.set_xscale("log")
        else:
            axes.set_xlim(0.0, 1.03 * max(errors[-1] for _, _, errors in sets))
        axes.set_ylim(0.0, 101.0)
        axes.set_xlabel("error of a point [mm]      ● mean   ◆ rms")
        axes.set_ylabel("share of the points [%]")
        axes.legend(loc="lower right", handlelength=1.2)
        label, _, errors = sets[0]
        half, most = np.percentile(errors, [50, 95])
        headline(figure, f"Half of the {label} points: within {half:.2f} mm; 95 %: {most:.2f} mm")
    return figure


def error_over_workspace(calibration: KinematicCalibration) -> Figure:
    """Draw where the errors are, in three projections of the measuring frame."""
    parts = [("training", calibration.train, ~calibration.outliers, 16.0)]
    if calibration.test is not None:
        everything = np.ones(len(calibration.test.observations), dtype=bool)
        parts.append(("held out", calibration.test, everything, 34.0))
    lengths = np.concatenate([part.distances[rows] for _, part, rows, _ in parts])
    scale = Normalize(0.0, 1e3 * float(np.percentile(lengths, 98.0)) or 1.0)
    with style():
        figure = Figure(figsize=(FULL_WIDTH, 4.0))
        panels = figure.subplots(1, 3)
        for axes, (a, b) in zip(panels, ((0, 1), (0, 2), (1, 2)), strict=True):
            for label, evaluation, rows, size in parts:
                points = 1e3 * evaluation.observations.p_WH[rows]
                axes.scatter(
                    points[:, a],
                    points[:, b],
                    c=1e3 * evaluation.distances[rows],
                    cmap=palette.ERRORS,
                    norm=scale,
                    s=size,
                    edgecolors=palette.HELD_OUT if label == "held out" else "none",
                    linewidths=0.9,
                    label=label,
                )
            axes.set_xlabel(f"{'xyz'[a]} [mm]")
            axes.set_ylabel(f"{'xyz'[b]} [mm]")
            axes.set_aspect("equal", adjustable="datalim")
        bar = figure.colorbar(
            ScalarMappable(scale, palette.ERRORS), ax=panels, extend="max", pad=0.01, aspect=28
        )
        bar.set_label("error [mm]")
        bar.outline.set_visible(False)
        ringed = " (ringed: held out)" if calibration.test is not None else ""
        headline(figure, f"{_worst(calibration)}{ringed}")
    return figure


def residuals_over_angles(calibration: KinematicCalibration) -> Figure:
    """Draw residual components against every joint angle, with the medians of eight bins.

    What a model cannot express (play, sag, a wrong gear) shows as a curve.
    """
    believed = ~calibration.outliers
    residuals = 1e3 * calibration.train.residuals[believed]
    servos = calibration.model.servos
    angles = calibration.train.observations.angles[believed]
    q = np.degrees((angles - servos.offset) / servos.gear)
    joints = calibration.model.joints
    with style():
        figure = Figure(figsize=(FULL_WIDTH, 4.6))
        panels = figure.subplots(3, len(joints), sharex="col", sharey=True, squeeze=False)
        strongest = (0.0, "")
        for i, joint in enumerate(joints):
            for k in range(3):
                axes = panels[k, i]
                size = _trend_panel(axes, q[:, i], residuals[:, k], palette.joint_color(i))
                strongest = max(strongest, (size, f"{'xyz'[k]} over {joint}"))
            panels[0, i].set_title(joint, fontsize=8.5, loc="center", wrap=True)
            panels[2, i].set_xlabel("angle [deg]")
        for k in range(3):
            panels[k, 0].set_ylabel(f"residual {'xyz'[k]} [mm]")
        limit = 1.15 * float(np.percentile(np.abs(residuals), 99.5)) or 1.0
        panels[0, 0].set_ylim(-limit, limit)
        spread = float(np.sqrt(np.mean(residuals**2)))
        headline(
            figure,
            f"Strongest trend left in the training residuals: {strongest[0]:.2f} mm "
            f"({strongest[1]}); their rms is {spread:.2f} mm"
            if strongest[1]
            else f"Training residuals, {spread:.2f} mm rms: too few points for trends",
        )
    return figure


def _trend_panel(axes: Axes, angle: NDArray, residual: NDArray, color: str) -> float:
    """Draw points and the medians of bins of equal count; return the largest median [mm]."""
    dense = len(angle) > 300
    axes.plot(angle, residual, ".", color=color, markersize=3 if dense else 4.5, alpha=0.45)
    axes.axhline(0.0, color=palette.MUTED, linewidth=0.8)
    bins = min(_BINS, len(angle) // _LEAST_IN_BIN)
    if bins < 3:
        return 0.0
    groups = np.array_split(np.argsort(angle, kind="stable"), bins)
    middle = np.array([np.median(angle[group]) for group in groups])
    median = np.array([np.median(residual[group]) for group in groups])
    axes.plot(middle, median, color=palette.INK, linewidth=1.6, marker="o", markersize=2.5)
    return float(np.abs(median).max())


def _worst(calibration: KinematicCalibration) -> str:
    """Say which believed point is predicted worst."""
    evaluation: Evaluation = calibration.train
    rows, label = np.flatnonzero(~calibration.outliers), "training"
    if calibration.test is not None:
        evaluation, label = calibration.test, "held-out"
        rows = np.arange(len(evaluation.observations))
    worst = rows[np.argmax(evaluation.distances[rows])]
    x, y, z = 1e3 * evaluation.observations.p_WH[worst]
    error = 1e3 * evaluation.distances[worst]
    return f"Largest {label} error: {error:.2f} mm, at ({x:.0f}, {y:.0f}, {z:.0f}) mm"

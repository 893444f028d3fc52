"""Figures of the estimate: how well each parameter is known, correlations, convergence."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from nico_selfmodel.optimization.uncertainty import Uncertainty
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.layout.plain_axis import PlainAxes
from nico_selfmodel.viz.figures.layout.plain_figure import PlainFigure
from nico_selfmodel.viz.figures.numbers_shown import decimals
from nico_selfmodel.viz.figures.plot_style import (
    FULL_WIDTH,
    HALF_WIDTH,
    grid_along,
    headline,
    log_ticks,
    style,
)

if TYPE_CHECKING:
    from nico_selfmodel.estimation.arm.kinematics import KinematicCalibration
    from nico_selfmodel.estimation.initialization.start_search import StartSearch

_SHOWN = {"m": ("mm", 1e3), "rad": ("deg", 180.0 / np.pi), "1": ("%", 100.0)}
"""Unit of a parameter -> unit and factor that people read."""
_MOST_SHOWN = 40
"""Parameters whose correlations are shown: those that are most so."""
_DIVERGING = "RdBu_r"
_HEADING = {"m": "lengths", "rad": "angles", "1": "gears"}


def parameter_sigmas(calibration: "KinematicCalibration") -> Figure | None:
    """Draw the standard deviation of every free parameter of the geometry; None without any.

    What bends has numbers by the dozen that are next to nothing, and a section of its own.
    """
    uncertainty, bending = calibration.uncertainty, calibration.model.bending
    if uncertainty is None:
        return None
    bends = () if bending is None else bending.names
    unit_of = {name: unit for name, unit in _units(calibration).items() if name not in bends}
    groups = {
        unit: [name for name in uncertainty.names if unit_of.get(name) == unit] for unit in _SHOWN
    }
    groups = {unit: names for unit, names in groups.items() if names}
    with style():
        tallest = max(len(names) for names in groups.values())
        figure = PlainFigure(figsize=(FULL_WIDTH, 1.1 + 0.19 * tallest))
        panels = figure.subplots(1, len(groups), squeeze=False)[0]
        for axes, (unit, names) in zip(panels, groups.items(), strict=True):
            _sigma_panel(axes, calibration, uncertainty, unit, names)
            axes.set_ylim(tallest - 0.4, -0.6)
        headline(figure, _least_known(uncertainty, unit_of))
    return figure


def _sigma_panel(
    axes: Axes,
    calibration: "KinematicCalibration",
    uncertainty: Uncertainty,
    unit: str,
    names: list[str],
) -> None:
    shown, factor = _SHOWN[unit]
    sigma = factor * np.array([uncertainty.sigma[uncertainty.names.index(name)] for name in names])
    if unit == "1":
        parameters = calibration.model.parameters
        value = dict(zip(parameters.names, parameters.values.tolist(), strict=True))
        sigma = sigma / np.array([value[name] for name in names])
    unobservable = unobservable_parameters(uncertainty)
    known = np.array([name not in unobservable for name in names])
    reach = 1.3 * float(sigma[known].max()) if known.any() else 1.0
    rows = np.flatnonzero(known)
    colors = [_color_of(names[row], calibration) for row in rows]
    axes.barh(rows, sigma[rows], height=0.68, color=colors)
    for row, size in zip(rows.tolist(), sigma[rows].tolist(), strict=True):
        axes.text(size + 0.01 * reach, row, decimals(size, size), va="center", fontsize=7.5)
    for row in np.flatnonzero(~known):
        stripes = {"color": "white", "hatch": "////", "edgecolor": palette.OUTLIER}
        axes.barh(row, reach, height=0.68, **stripes)
        word = {"va": "center", "ha": "center", "fontsize": 7.5}
        text = axes.text(0.5 * reach, row, "unobservable", **word)
        text.set_color(palette.OUTLIER)
        text.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 1.0})
    axes.set_yticks(range(len(names)), names, fontsize=7.5)
    axes.tick_params(axis="y", length=0)
    axes.set_xlim(0.0, reach)
    axes.set_xlabel(f"standard deviation [{shown}]")
    axes.set_title(_HEADING[unit])
    axes.spines["left"].set_visible(False)
    grid_along(axes, "x")


def unobservable_parameters(uncertainty: Uncertainty | None) -> frozenset[str]:
    """Return the parameters that take part in a direction which the data do not determine.

    Their standard deviations may be finite, where something does determine them a little; what is
    known of an unobservable direction is still less than its parameter scale.

    Args:
        uncertainty: What is known of the parameters; None where nothing is.

    Returns:
        Names of parameters; none where no uncertainty is known.
    """
    if uncertainty is None:
        return frozenset()
    pairs = zip(uncertainty.names, uncertainty.sigma.tolist(), strict=True)
    unknown = {name for name, sigma in pairs if not np.isfinite(sigma)}
    return frozenset(unknown.union(*(direction.names for direction in uncertainty.unobservable)))


def correlations(uncertainty: Uncertainty) -> Figure | None:
    """Draw the strongest correlations of free parameters; None where there are not two."""
    if len(uncertainty.names) < 2:
        return None
    shown = _most_correlated(uncertainty.correlation)
    names = tuple(uncertainty.names[i] for i in shown)
    correlation, count = uncertainty.correlation[np.ix_(shown, shown)], len(shown)
    with style():
        side = float(np.clip(0.2 * count + 2.4, 5.0, 9.6))
        figure = PlainFigure(figsize=(side + 0.8, side))
        axes = figure.add_subplot()
        axes.grid(False)
        corners = (-0.5, count - 0.5, count - 0.5, -0.5)
        axes.imshow(_shades(correlation), interpolation="none", extent=corners)
        fields = np.arange(count + 1) - 0.5
        white = {"color": "white", "linewidth": 0.4}
        axes.hlines(fields, -0.5, np.append(fields[1:], fields[-1]), **white)
        axes.vlines(fields, np.append(fields[0], fields[:-1]), count - 0.5, **white)
        axes.set_xticks(range(count), names, rotation=90, fontsize=7.5)
        axes.set_yticks(range(count), names, fontsize=7.5)
        axes.tick_params(length=0)
        for spine in axes.spines.values():
            spine.set_visible(False)
        borders = np.array(_borders(names)) - 0.5
        muted = {"color": palette.MUTED, "linewidth": 0.7}
        axes.hlines(borders, -0.5, borders, **muted)
        axes.vlines(borders, borders, count - 0.5, **muted)
        inset = axes.inset_axes((0.56, 0.93, 0.4, 0.025), axes_class=PlainAxes)
        bar = ScalarMappable(Normalize(-1.0, 1.0), _DIVERGING)
        ticks = [-1.0, -0.5, 0.0, 0.5, 1.0]
        figure.colorbar(bar, cax=inset, orientation="horizontal", ticks=ticks)
        inset.set_title("correlation", fontsize=8.5, fontweight="normal")
        headline(figure, _strongest_pair(names, correlation, len(uncertainty.names)))
    return figure


def _most_correlated(correlation: NDArray) -> NDArray:
    """Return which parameters to show, in their order: more names than a page has are no help."""
    strongest = np.abs(correlation - np.diag(np.diag(correlation))).max(axis=1)
    return np.sort(np.argsort(-strongest, kind="stable")[:_MOST_SHOWN])


def _shades(correlation: NDArray) -> NDArray:
    """Return the colours of the lower half, grey on the diagonal. Shape (p, p, 4)."""
    shades = colormaps[_DIVERGING](0.5 + 0.5 * correlation)
    shades[np.triu_indices(len(correlation))] = 0.0
    shades[np.diag_indices(len(correlation))] = (0.88, 0.88, 0.88, 1.0)
    return np.asarray(shades)


def convergence(calibration: "KinematicCalibration") -> Figure | None:
    """Draw how the last solution converged and how the starts fared; None without refinement."""
    search, history = calibration.search, np.array(calibration.history)
    if search is None or not len(history):
        return None
    with style():
        figure = PlainFigure(figsize=(HALF_WIDTH, 4.2))
        top, bottom = figure.subplots(2, 1)
        excess = (history - history.min()) / (history.min() or history.max() or 1.0)
        # What is left at the end is rounding.
        excess = np.maximum(excess, 1e-16)
        top.semilogy(np.arange(len(history)), excess, "o-", color=palette.HELD_OUT, markersize=5)
        log_ticks(top.yaxis)
        top.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
        top.set_xlim(-0.3, len(history) - 0.7)
        top.set_xlabel("step of the final solution")
        top.set_ylabel("cost above its\nminimum, relative")
        _starts_panel(bottom, search)
        same = f"{search.agreeing} of {len(search.labels)} starts reached the best minimum"
        headline(figure, same if calibration.converged else f"Not converged; {same}")
    return figure


def _starts_panel(axes: Axes, search: "StartSearch") -> None:
    """Draw the cost of every start's minimum over that of the best."""
    scores = np.asarray(search.scores, dtype=float)
    ratio = scores / (float(scores.min()) or 1.0)
    agreeing = np.zeros(len(ratio), dtype=bool)
    agreeing[np.argsort(ratio, kind="stable")[: search.agreeing]] = True
    numbers = np.arange(1, len(ratio) + 1)
    for rows, color, label in (
        (agreeing, palette.HELD_OUT, "best minimum"),
        (~agreeing, palette.CROSS_VALIDATION, "another"),
    ):
        if rows.any():
            axes.plot(numbers[rows], ratio[rows], "o", color=color, markersize=6, label=label)
    if ratio.max() > 3.0:
        axes.set_yscale("log")
        log_ticks(axes.yaxis)
    else:
        axes.set_ylim(0.9, max(1.5, 1.1 * float(ratio.max())))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    axes.set_xlim(0.5, len(ratio) + 0.5)
    names = list(dict.fromkeys(search.labels))
    axes.set_xlabel(f"start (in this order: {', '.join(names)})")
    axes.set_ylabel("cost over\nthe best")
    above = {"loc": "lower left", "bbox_to_anchor": (-0.02, 0.97), "borderaxespad": 0.0}
    axes.legend(ncols=2, handletextpad=0.1, **above)


def _units(calibration: "KinematicCalibration") -> dict[str, str]:
    parameters = calibration.model.parameters
    return dict(zip(parameters.names, parameters.units, strict=True))


def _color_of(name: str, calibration: "KinematicCalibration") -> str:
    joint = name.rpartition(".")[0]
    joints = calibration.model.joints
    return palette.joint_color(joints.index(joint)) if joint in joints else palette.TRAINING


def _least_known(uncertainty: Uncertainty, unit_of: dict[str, str]) -> str:
    """Say which length and which angle are known worst, or how many are unobservable."""
    sigma, unobservable = uncertainty.sigma, unobservable_parameters(uncertainty)
    if unobservable:
        return f"{len(unobservable)} of {len(sigma)} parameters are not determined by these data"
    parts = []
    for unit in ("m", "rad"):
        rows = [i for i, name in enumerate(uncertainty.names) if unit_of.get(name) == unit]
        if rows:
            worst = max(rows, key=lambda i: sigma[i])
            shown, factor = _SHOWN[unit]
            size = float(factor * sigma[worst])
            parts.append(f"{uncertainty.names[worst]} (± {decimals(size, size)} {shown})")
    return "Least known: " + ", ".join(parts)


def _strongest_pair(names: tuple[str, ...], correlation: NDArray, count: int) -> str:
    off = np.abs(np.tril(correlation, -1))
    i, j = np.unravel_index(int(np.argmax(off)), off.shape)
    size = f"{correlation[i, j]:+.3f}".replace("-", "−")
    part = "" if count == len(names) else f" ({len(names)} of {count} parameters shown)"
    return f"Strongest correlation: {names[j]} with {names[i]}, {size}{part}"


def _borders(names: tuple[str, ...]) -> list[int]:
    """Return where the parameters of another joint begin."""
    owner = [name.rpartition(".")[0] for name in names]
    return [i for i in range(1, len(owner)) if owner[i] != owner[i - 1]]

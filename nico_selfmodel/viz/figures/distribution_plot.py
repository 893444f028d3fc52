"""How errors are distributed: the share of them below each value."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.layout.plain_figure import PlainFigure
from nico_selfmodel.viz.figures.plot_style import HALF_WIDTH, headline, log_ticks, style

_LOG_FROM, _LOG_TAIL = 8.0, 20.0
"""Ratios, of the medians and of largest to median, from which the axis is logarithmic."""


@dataclass(frozen=True, eq=False)
class ErrorSet:
    """Errors that belong together."""

    label: str
    """For the legend."""
    color: str
    """Of the curve."""
    errors: NDArray
    """At least one. Shape (n,)."""

    def __post_init__(self) -> None:
        """Sort the errors."""
        object.__setattr__(self, "errors", np.sort(self.errors))


def error_sets(
    test: NDArray | None, cross_validation: NDArray | None, train: NDArray | None
) -> list[ErrorSet]:
    """Return the sets of errors that there are, the most telling first.

    Args:
        test: Held out. Shape (n,).
        cross_validation: Each by a model learned without it. Shape (n,).
        train: Learned from, without outliers. Shape (n,).
    """
    found = (
        ("held-out", palette.HELD_OUT, test),
        ("cross-validation", palette.CROSS_VALIDATION, cross_validation),
        ("training", palette.TRAINING, train),
    )
    return [
        ErrorSet(label, color, errors)
        for label, color, errors in found
        if errors is not None and len(errors)
    ]


def distribution(sets: Sequence[ErrorSet], *, unit: str, what: str, thing: str) -> Figure:
    """Draw the share of errors below each value, means and rms marked.

    Args:
        sets: One curve each, the most telling first: the headline is about it.
        what: What an error is.
    """
    with style():
        figure = PlainFigure(figsize=(HALF_WIDTH, 4.2))
        axes = figure.add_subplot()
        for one in sets:
            errors, color = one.errors, one.color
            share = np.arange(1, len(errors) + 1) / len(errors)
            mean, rms = float(errors.mean()), float(np.sqrt(np.mean(errors**2)))
            text = f"{one.label} ({len(errors)}): mean {mean:.2f}, rms {rms:.2f}"
            axes.step(errors, 100.0 * share, where="post", color=color, label=f"{text} {unit}")
            for value, mark in ((mean, "o"), (rms, "D")):
                height = 100.0 * np.mean(errors <= value)
                axes.plot(value, height, mark, color=color, markeredgecolor="white", markersize=7)
        if _spread_wide(sets):
            axes.set_xscale("log")
            axes.set_xlim(left=min(float(np.percentile(one.errors, 1.0)) for one in sets))
            log_ticks(axes.xaxis)
        else:
            axes.set_xlim(0.0, 1.03 * max(float(one.errors[-1]) for one in sets))
        axes.set_ylim(0.0, 101.0)
        axes.set_xlabel(f"{what} [{unit}]      ● mean   ◆ rms")
        axes.set_ylabel(f"share of the {thing}s [%]")
        figure.legend(loc="outside lower left", handlelength=1.2)
        half, most = np.percentile(sets[0].errors, [50, 95])
        headline(
            figure,
            f"Half within {half:.2f} {unit}, 95 % within {most:.2f} {unit} ({sets[0].label})",
        )
    return figure


def _spread_wide(sets: Sequence[ErrorSet]) -> bool:
    """Return whether the errors need a logarithmic axis, and none of them forbids it."""
    medians = [float(np.median(one.errors)) for one in sets]
    largest = max(float(one.errors[-1]) for one in sets)
    wide = max(medians) > _LOG_FROM * min(medians) or largest > _LOG_TAIL * max(medians)
    return wide and min(float(one.errors[0]) for one in sets) > 0.0

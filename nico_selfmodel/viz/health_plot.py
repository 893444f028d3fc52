"""How a body's health went, sighting by sighting."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from nico_selfmodel.estimation.health import HealthReport
from nico_selfmodel.viz import palette
from nico_selfmodel.viz.plot_style import FULL_WIDTH, headline, log_ticks, style


def health_plot(report: HealthReport) -> Figure:
    """Draw what each sighting was off by, and the sums that raise the alarm.

    Args:
        report: Sightings held against a body.

    Returns:
        Two panels over the sightings: innovations squared over what is to be expected of them, and
        every sum as a share of its threshold.
    """
    rows = np.arange(len(report.nis))
    with style():
        figure = Figure(figsize=(FULL_WIDTH, 4.2))
        above, below = figure.subplots(2, 1, sharex=True)
        above.plot(rows, report.nis / report.dof, "o", color=palette.MUTED, markersize=3.5)
        above.axhline(1.0, color=palette.INK, linewidth=0.8)
        above.set_yscale("log")
        log_ticks(above.yaxis)
        above.set_ylabel("innovation² over\nits expectation")
        last = len(rows) if report.alarm_at is None else report.alarm_at + 1
        for color, (name, sums, threshold) in zip(
            (palette.HELD_OUT, palette.CROSS_VALIDATION, palette.UNCERTAINTY),
            report.sums,
            strict=True,
        ):
            share = 100.0 * sums[:last] / threshold
            below.plot(rows[:last], share, color=color, label=name, drawstyle="steps-mid")
        below.axhline(100.0, color=palette.OUTLIER, linewidth=1.0)
        below.set_ylabel("share of its\nthreshold [%]")
        below.set_xlabel("sighting")
        below.xaxis.set_major_locator(MaxNLocator(integer=True))
        for axes in (above, below):
            if report.changed_at is not None:
                axes.axvline(report.changed_at - 0.5, color=palette.OUTLIER, linestyle=":")
        figure.legend(loc="outside lower left", ncols=3)
        headline(figure, _words(report))
    return figure


def _words(report: HealthReport) -> str:
    if report.alarm_at is None or report.changed_at is None:
        return f"{len(report.nis)} sightings fit what is known of the body"
    count = report.alarm_at - report.changed_at + 1
    needed = "one sighting" if count == 1 else f"{count} sightings"
    return f"{report.diagnoses[0].hypothesis.cause}: {needed} after the change the alarm was raised"

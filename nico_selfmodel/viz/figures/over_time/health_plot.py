"""How a body's health went, pose by pose."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from nico_selfmodel.estimation.monitoring.health import HealthReport
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.layout.plain_figure import PlainFigure
from nico_selfmodel.viz.figures.plot_style import HALF_WIDTH, headline, log_ticks, style


def health_plot(report: HealthReport) -> Figure:
    """Draw what each pose was off by, and the statistic that raises the alarm.

    Returns:
        Two panels over the poses: innovations squared over what is to be expected of them, and the
        statistic of Shiryaev and Roberts with its threshold.
    """
    rows = np.arange(len(report.nis))
    with style():
        figure = PlainFigure(figsize=(HALF_WIDTH, 4.2))
        above, below = figure.subplots(2, 1, sharex=True)
        above.plot(rows, report.nis / report.dof, "o", color=palette.MUTED, markersize=3.5)
        above.axhline(1.0, color=palette.INK, linewidth=0.8)
        above.set_yscale("log")
        log_ticks(above.yaxis)
        above.set_ylabel("innovation² over\nits expectation")
        last = len(rows) if report.alarm_at is None else report.alarm_at + 1
        below.plot(
            rows[:last], report.log_ratio[:last], color=palette.HELD_OUT, drawstyle="steps-mid"
        )
        below.axhline(report.threshold, color=palette.OUTLIER, linewidth=1.0)
        below.set_ylabel("ln R, and where\nit raises the alarm")
        below.set_xlabel("pose")
        below.xaxis.set_major_locator(MaxNLocator(integer=True))
        for axes in (above, below):
            if report.changed_at is not None:
                axes.axvline(report.changed_at - 0.5, color=palette.OUTLIER, linestyle=":")
        headline(figure, _words(report))
    return figure


def _words(report: HealthReport) -> str:
    if report.alarm_at is None or report.changed_at is None:
        if not report.healthy:
            count = report.contradictions.count
            return f"{count} of {len(report.nis)} poses contradict what is known of the body"
        return f"{len(report.nis)} poses fit what is known of the body"
    count = report.alarm_at - report.changed_at + 1
    needed = "one pose" if count == 1 else f"{count} poses"
    return f"{report.diagnoses[0].hypothesis.cause}: {needed} after the change the alarm was raised"

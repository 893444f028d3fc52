"""How joints answer steps of their commands: what was read, and what is expected."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from nico_selfmodel.dataset.motion.motion_recording import MotionRecording
from nico_selfmodel.estimation.response.servo_calibration import JointResponse
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.layout.plain_figure import PlainFigure
from nico_selfmodel.viz.figures.plot_style import dots, headline, style

_COLUMNS = 2
_WIDTH = 6.4
"""Of the picture of the first page [inch]."""
_MOST_STEPS = 8
"""Steps of a joint that are drawn: the shortest, the longest, and others between."""
_FINE = 300
"""Points of a drawn curve."""


def response_plot(joints: Sequence[JointResponse]) -> Figure:
    """Draw each joint's steps: dots are readings, lines what the response expects.

    Args:
        joints: At least one.
    """
    columns = min(_COLUMNS, len(joints))
    rows = -(-len(joints) // columns)
    with style():
        figure = PlainFigure(figsize=(_WIDTH, 0.4 + 2.4 * rows))
        for k, joint in enumerate(joints):
            _steps(figure.add_subplot(rows, columns, k + 1), joint, palette.joint_color(k))
        headline(figure, "Readings (dots), and what is expected (lines)")
    return figure


def _steps(axes: Axes, joint: JointResponse, color: str) -> None:
    steps = joint.steps
    order = np.argsort(np.abs(steps.way))
    picked = np.linspace(0, len(order) - 1, min(_MOST_STEPS, len(order)))
    chosen = order[np.unique(np.rint(picked).astype(int))]
    shown = np.isin(steps.step, chosen)
    kept = shown & ~joint.outliers[steps.step]
    last = float(steps.time[shown].max())
    time = np.linspace(0.0, last, _FINE)
    ways = np.append(np.abs(steps.way[chosen[~joint.outliers[chosen]]]), np.nan)[:, None]
    expected = np.degrees(joint.response.after(ways[:-1], time))
    for line in expected:
        axes.plot(time, line, color=color, linewidth=1.6)
    for rows, paint in ((kept, palette.INK), (shown & ~kept, palette.OUTLIER)):
        if rows.any():
            dots(axes, steps.time[rows], np.degrees(steps.gone[rows]), color=paint, size=2.6)
    axes.axvline(joint.response.delay, color=palette.MUTED, linewidth=0.8, linestyle=":")
    axes.set_title(steps.joint)
    axes.set_xlabel("time since the command [s]")
    axes.set_ylabel("gone [deg]")
    axes.set_xlim(0.0, last)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(5))


def commands_plot(recording: MotionRecording) -> Figure:
    """Draw where joints were told to go and what their encoders read, over the whole recording."""
    told = np.flatnonzero(np.ptp(recording.commanded, axis=0) > 0.0)
    with style():
        figure = PlainFigure(figsize=(_WIDTH, 0.6 + 1.5 * len(told)))
        panels = figure.subplots(len(told), 1, squeeze=False, sharex=True)[:, 0]
        for k, axes in zip(told.tolist(), panels, strict=True):
            joint = recording.joints[k]
            size = np.degrees(joint.radians_per_unit) * joint.sign
            read = np.isfinite(recording.encoders[:, k])
            axes.plot(
                recording.time,
                size * recording.commanded[:, k],
                color=palette.MUTED,
                linewidth=1.0,
                drawstyle="steps-post",
            )
            axes.plot(
                recording.time[read],
                size * recording.encoders[read, k],
                color=palette.joint_color(k),
                linewidth=1.4,
            )
            axes.set_title(joint.name)
            axes.set_ylabel("[deg]")
        panels[-1].set_xlabel("time [s]")
        headline(figure, "Where joints were told to go (grey), and what their encoders read")
    return figure

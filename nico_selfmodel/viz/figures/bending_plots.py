"""Figures of what bends: how far the hand is moved, and which way."""

from collections.abc import Collection

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from nico_selfmodel.estimation.bending.what_bends import At
from nico_selfmodel.model.arm.bending import Bending
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.layout.plain_figure import PlainFigure
from nico_selfmodel.viz.figures.plot_style import FULL_WIDTH, MANY, headline, style

_ARROW = 0.12
"""Length of the longest arrow, as a share of the workspace."""
_RIPPLES = 6
"""Joints whose ripple is drawn."""
_TURNS = 181
"""Angles at which a joint's ripple is drawn."""


def bent_hands(bending: Bending | None, at: At, kept: Collection[str]) -> Figure | None:
    """Draw how far bending moves the hand at every pose, seen from two sides, and joint by joint.

    Args:
        bending: What bends; nothing is drawn of a rigid body.
        at: Where tracked points are.
        kept: Effects that stayed; of the others only how far they move the hand is drawn.
    """
    if bending is None:
        return None
    still, (bent, _) = at(None)[0], at(bending)
    moved = bent - still
    with style():
        figure = PlainFigure(figsize=(FULL_WIDTH, 3.6))
        panels = figure.subplots(1, 3)
        stretch = (
            _ARROW
            * float(np.ptp(still, axis=0).max())
            / max(float(np.linalg.norm(moved, axis=1).max()), 1e-12)
        )
        for axes, (a, b) in zip(panels[:2], _sides(bending), strict=True):
            _arrows(axes, still, moved * stretch, a, b)
        _turns_of_joints(panels[2], bending, kept)
        worst = 1e3 * float(np.linalg.norm(moved, axis=1).max())
        headline(
            figure, f"Bending moves the hand by up to {worst:.2g} mm; arrows {stretch:.0f} times"
        )
    return figure


def _sides(bending: Bending) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return two pairs of axes of W to look along, the vertical upright in both."""
    height = int(np.argmax(np.abs(bending.up)))
    first, second = (axis for axis in range(3) if axis != height)
    return (first, height), (second, height)


def _arrows(axes: Axes, at: NDArray, moved: NDArray, a: int, b: int) -> None:
    axes.quiver(
        1e3 * at[:, a],
        1e3 * at[:, b],
        1e3 * moved[:, a],
        1e3 * moved[:, b],
        np.linalg.norm(moved, axis=1),
        cmap=palette.ERRORS,
        angles="xy",
        scale_units="xy",
        scale=1.0,
        width=0.006,
        rasterized=len(at) > MANY,
    )
    axes.set_xlabel(f"{'xyz'[a]} [mm]")
    axes.set_ylabel(f"{'xyz'[b]} [mm]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.12)


def _turns_of_joints(axes: Axes, bending: Bending, kept: Collection[str]) -> None:
    """Draw the ripple of the joints that ripple most; else how much each joint gives way."""
    joints = bending.joints
    if "ripple" in kept:
        angle = np.linspace(-180.0, 180.0, _TURNS)
        q = np.radians(angle)[:, None] * np.ones(len(joints))
        still = np.zeros((len(joints), len(angle), 3))
        turns = bending.with_effects("ripple").turns(q, still)
        most = np.sort(np.argsort(-np.ptp(turns, axis=0), kind="stable")[:_RIPPLES])
        for k in most:
            axes.plot(angle, 1e3 * turns[:, k], label=joints[k], color=palette.joint_color(k))
        axes.set_xlabel("angle of the joint [deg]")
        axes.set_ylabel("ripple [mrad]")
        axes.legend(fontsize="x-small", ncols=2)
        return
    given, label = bending.bearing_sag, "bearing gives way [mrad/m of the weight]"
    if "sag" in kept:
        given, label = bending.sag, "joint gives way [mrad/m of the weight]"
    elif "backlash" in kept:
        given, label = bending.backlash, "half width of the backlash [mrad]"
    elif "coupling" in kept:
        turned = np.abs(bending.coupling).sum(axis=1)
        given, label = turned, "turned by other drives [mrad/rad]"
    axes.barh(np.arange(len(joints)), 1e3 * given, color=palette.HELD_OUT)
    axes.set_yticks(np.arange(len(joints)), joints)
    axes.invert_yaxis()
    axes.axvline(0.0, color="0.5", linewidth=0.8)
    axes.set_xlabel(label)

"""What is said of boards and cameras that did what no calibration has, and what cures it."""

import numpy as np

from nico_selfmodel.estimation.cameras.lacks.rig_lacks import (
    ASIDE,
    BEND,
    MOVED,
    SKEW,
    STRETCH,
    ZOOMED,
    Lack,
)


def words_of_lack(lack: Lack) -> str:
    """Say what happened, by how much, what to do, and what it does to the cameras."""
    return (
        f"{_WORDS[lack.kind](lack)} (`{lack.worst}` and others are up to {lack.off:.0f} of their "
        "standard deviations off)"
    )


def _stretch(lack: Lack) -> str:
    longer, other = ("x", "y") if lack.amount > 0.0 else ("y", "x")
    share, sigma = (100.0 * abs(v) for v in (lack.amount, lack.sigma))
    return (
        f"the board is longer in {longer} than in {other} by {share:.1f} +- {sigma:.1f} %, against "
        "its description: measure it both ways (a size of squares is one for both), and print it "
        "without scaling"
    )


def _skew(lack: Lack) -> str:
    angle, sigma = (np.degrees(abs(v)) for v in (lack.amount, lack.sigma))
    return (
        f"rows and columns of the board are {angle:.2f} +- {sigma:.2f} deg from a right angle: use "
        "one that is printed true"
    )


def _bend(lack: Lack) -> str:
    return (
        f"the board is bent: its corners lie {1e3 * lack.amount:.2g} +- {1e3 * lack.sigma:.1g} mm "
        "out of a plane; use a flat one, of glass or glued to a plate"
    )


def _moved(lack: Lack) -> str:
    return (
        f"the {lack.camera} camera moved against the others before view {lack.view}, by "
        f"{np.degrees(lack.turn):.2g} deg and {1e3 * lack.amount:.2g} mm: learn the views before "
        "and after it by themselves, or fix the cameras and record anew"
    )


def _zoomed(lack: Lack) -> str:
    share, sigma = (100.0 * abs(v) for v in (lack.amount, lack.sigma))
    kind = "longer" if lack.amount > 0.0 else "shorter"
    return (
        f"the focal length of the {lack.camera} camera is {share:.1f} +- {sigma:.1f} % {kind} from "
        f"view {lack.view} on: did zoom or focus change? Learn the views before and after it by "
        "themselves"
    )


def _aside(lack: Lack) -> str:
    return (
        f"in view {lack.view} the {lack.camera} camera saw the board {1e3 * lack.amount:.2g} mm "
        f"and {np.degrees(lack.turn):.2g} deg from where the others saw it: its pictures were not "
        "taken at one moment; leave them out"
    )


_WORDS = {
    STRETCH: _stretch,
    SKEW: _skew,
    BEND: _bend,
    MOVED: _moved,
    ZOOMED: _zoomed,
    ASIDE: _aside,
}

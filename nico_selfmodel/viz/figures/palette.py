"""Colours of scenes and figures: told apart by colour-blind readers, and readable on white."""

from collections.abc import Sequence
from itertools import cycle

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import Colormap, LinearSegmentedColormap, to_hex, to_rgb
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.viz.figures.rgba import Rgba

# Paul Tol's "bright" and "vibrant" schemes, without their reds: red means an outlier or a failure.
_JOINTS = ("#4477aa", "#ee7733", "#228833", "#aa3377", "#33bbee", "#ccaa22", "#775599", "#667788")

_SHADES = (("#000000", 0.0), ("#000000", 0.45), ("#ffffff", 0.45))
"""What the joints' colours are mixed with, and by how much, each time that they run out."""

INK = "#1c2733"
MUTED = "#66727f"
FAINT = "#d5dbe1"
TRAINING = "#7b8794"
CROSS_VALIDATION = "#ee7733"
HELD_OUT = "#0b5fa5"
OUTLIER = "#cc3311"
UNCERTAINTY = "#009988"
CAMERAS = {"left": "#009988", "right": "#aa3377"}
_MORE_CAMERAS = ("#4477aa", "#ee7733", "#228833", "#33bbee", "#ccaa22", "#775599")
LINK = "#c3cad2"
HAND = "#1c2733"
GRID = "#b9c2cb"

ERRORS = LinearSegmentedColormap.from_list("errors", colormaps["magma_r"](np.linspace(0.12, 0.88)))
"""Perceptually uniform, from pale (small) to dark (large)."""
BOARDS = LinearSegmentedColormap.from_list("boards", ("#a9c6e3", "#3f7fb8", "#0a2342"))
"""As `ERRORS`, without its reds, for large areas in which red must mean an outlier."""


def camera_colors(names: Sequence[str]) -> dict[str, str]:
    """Return a colour for each camera of a rig; the ninth shares that of the first."""
    known = [*CAMERAS.values(), *_MORE_CAMERAS]
    spare = cycle([color for color in known if color not in map(CAMERAS.get, names)])
    return {name: CAMERAS.get(name) or next(spare) for name in names}


def joint_color(i: int) -> str:
    """Return the colour of joint i; after eight they come darker, then paler, then again."""
    again, k = divmod(i, len(_JOINTS))
    beside, share = _SHADES[again % len(_SHADES)]
    mixed = (1.0 - share) * np.array(to_rgb(_JOINTS[k])) + share * np.array(to_rgb(beside))
    return to_hex(mixed.tolist())


def rgba(color: str, opacity: float = 1.0) -> Rgba:
    """Return a colour as numbers."""
    red, green, blue = to_rgb(color)
    return float(red), float(green), float(blue), opacity


def scale(colors: Colormap) -> tuple[Rgba, ...]:
    """Return a few colours of a scale for a legend, from the least to the largest."""
    return tuple(colors(share) for share in np.linspace(0.0, 1.0, 9))


def error_colors(values: ArrayLike, largest: float) -> NDArray:
    """Return red, green and blue of errors, (n,) -> (n, 3); those over `largest` look like it."""
    share = np.asarray(values, dtype=float) / largest if largest > 0.0 else np.zeros(len(values))
    return ERRORS(np.clip(share, 0.0, 1.0))[:, :3]

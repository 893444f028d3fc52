"""How viewers paint a scene, whichever draws it."""

from typing import Any

from nico_selfmodel.viz.figures.rgba import Rgba

AMBIENT, BACKGROUND = 1.1, {"top_color": (1.0, 1.0, 1.0), "bottom_color": (0.90, 0.92, 0.95)}


def paint(color: Rgba) -> dict[str, Any]:
    """Return a colour as three.js has it."""
    red, green, blue = (round(255 * c) for c in color[:3])
    return {"color": (red << 16) + (green << 8) + blue, "opacity": color[3]}

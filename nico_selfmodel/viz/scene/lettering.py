"""Words in a scene: viewers have no text of their own, so they are small pictures."""

import io
import struct

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.viz.figures.plot_style import style
from nico_selfmodel.viz.scene.scene_items import Picture


def label(
    path: str, text: str, color: str, height: float, X_WI: ArrayLike, anchor: tuple[float, float]
) -> Picture:
    """Return words as an item.

    Args:
        path: Of the item.
        text: One line.
        color: Of the letters.
        height: Of the line [m].
        X_WI: Frame whose x the words run along and whose y is down. Shape (4, 4).
        anchor: The words' point that lies at the frame's origin, right and down from their top
            left corner in shares of their width and height.
    """
    image, ratio = _words_png(text, color)
    size = height * np.array([ratio, 1.0])
    shift = [*(size * (0.5 - np.array(anchor))), 0.0]
    pose = np.asarray(X_WI) @ transform(np.eye(3), shift)
    return Picture(
        path=path, color=(1.0,) * 4, X_WI=pose, width=size[0], height=size[1], image=image
    )


def _words_png(text: str, color: str) -> tuple[bytes, float]:
    """Write words on nothing; return a PNG file and its width over its height."""
    buffer = io.BytesIO()
    with style():
        figure = Figure(layout="none")
        figure.text(0.5, 0.5, text, fontsize=24.0, fontweight="bold", color=color)
        figure.savefig(
            buffer,
            format="png",
            dpi=100.0,
            transparent=True,
            bbox_inches="tight",
            pad_inches=0.04,
            metadata={"Software": None},
        )
    width, height = struct.unpack(">II", buffer.getvalue()[16:24])
    return buffer.getvalue(), width / height

"""Words in a scene: viewers have no text of their own, so they are small pictures."""

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.font_manager import FontProperties, findfont, get_font
from numpy.typing import ArrayLike

from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.viz.figures.photographs import png
from nico_selfmodel.viz.figures.plot_style import FONT
from nico_selfmodel.viz.scene.scene_items import Picture

_SIZE, _PAD = 33.0, 4
"""Of the letters, and room around them [px]."""


def label(
    path: str, text: str, color: str, height: float, X_WI: ArrayLike, anchor: tuple[float, float]
) -> Picture:
    """Return words as an item.

    Args:
        text: One line.
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
    font = get_font(findfont(FontProperties(family=FONT, weight="bold")))
    font.set_size(_SIZE, 72.0)
    font.set_text(text, 0.0)
    font.draw_glyphs_to_bitmap()
    letters = np.pad(np.asarray(font.get_image()), _PAD)
    image = np.empty((*letters.shape, 4), dtype=np.uint8)
    image[..., :3] = np.round(255.0 * np.array(to_rgb(color)))
    image[..., 3] = letters
    return png(image), letters.shape[1] / letters.shape[0]

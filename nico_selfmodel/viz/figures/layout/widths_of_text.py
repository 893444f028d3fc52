"""How wide text is in the font of the figures, from the advance of each letter."""

from functools import cache

from matplotlib import rcParams
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.ft2font import FT2Font, LoadFlags

_SIZE = 64.0


def width_of(text: str, weight: str | int = "normal") -> float:
    """Return the width of a line of text, in sizes of its font."""
    return sum(_advance(letter, weight) for letter in text)


@cache
def ascent_and_descent() -> tuple[float, float]:
    """Return how far letters reach above their line and below it, in sizes of the font."""
    font = _font("normal")
    font.set_text("lp", 0.0)
    tall = font.get_width_height()[1] / 64.0
    below = font.get_descent() / 64.0
    return (tall - below) / _SIZE, below / _SIZE


@cache
def _advance(letter: str, weight: str | int) -> float:
    font = _font(weight)
    # Index 0 is what is drawn in place of letters that the font does not have.
    glyph = font.load_glyph(font.get_char_index(ord(letter)), flags=LoadFlags.NO_HINTING)
    return glyph.linearHoriAdvance / 65536.0 / _SIZE


def _font(weight: str | int) -> FT2Font:
    font = get_font(findfont(FontProperties(family=rcParams["font.family"], weight=weight)))
    font.set_size(_SIZE, 72.0)
    return font

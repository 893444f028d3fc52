"""The window in which a colour is clicked, without a window."""

import numpy as np
import pytest
from matplotlib.backend_bases import KeyEvent, MouseEvent
from matplotlib.figure import Figure

from nico_selfmodel.errors import SelfModelError
from nico_selfmodel.viz.live.color_picker import ColorPicker, pick_color

RED, GREY = (40, 40, 190), (150, 150, 150)


@pytest.fixture
def image():
    """Return a red square, centre (30, 20), on grey."""
    image = np.full((60, 80, 3), GREY, np.uint8)
    image[14:27, 24:37] = RED
    return image


@pytest.fixture
def picker(image):
    picker = ColorPicker(image, Figure(figsize=(8, 4)), radius=2.0)
    picker.connect()
    return picker


def press(picker, u, v, axes=0):
    """Press the mouse over a pixel of the photograph (0) or of what matches (1)."""
    figure = picker._figure
    figure.canvas.draw()
    x, y = figure.axes[axes].transData.transform((u, v))
    MouseEvent("button_press_event", figure.canvas, x, y, 1)._process()


def test_a_click_on_either_picture_teaches_the_colour(picker):
    assert picker.words == "no pixel clicked yet"
    press(picker, 30, 20)
    assert picker.model.dominant == "red"
    assert picker.words.startswith("seen at (30.0, 20.0)")
    press(picker, 27, 18, axes=1)
    assert np.array(picker.clicks) == pytest.approx(np.array([[30, 20], [27, 18]]), abs=0.01)


def test_backspace_takes_a_click_back(picker):
    press(picker, 30, 20)
    for _ in range(2):
        KeyEvent("key_press_event", picker._figure.canvas, "backspace")._process()
    assert (picker.clicks, picker.model) == ([], None)


def test_a_click_on_grey_says_what_is_wrong(picker):
    press(picker, 60, 40)
    assert "nearly grey" in picker.words
    assert picker.model is None


def test_a_click_beside_the_pictures_is_none(picker):
    figure = picker._figure
    MouseEvent("button_press_event", figure.canvas, 1, 1, 1)._process()
    assert picker.clicks == []


def test_without_a_display_the_way_out_is_named(image):
    with pytest.raises(SelfModelError, match=r"no window can be opened here: .* --at u,v"):
        pick_color(image, "a photograph")

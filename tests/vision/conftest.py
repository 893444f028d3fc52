"""Scenes in which the tests of vision look for things."""

import cv2
import numpy as np
import pytest

RED, BLUE, GREY, BROWN = (45, 40, 190), (190, 80, 40), (150, 160, 155), (70, 90, 110)


@pytest.fixture(scope="session")
def april_tags():
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)


@pytest.fixture
def draw_scene():
    """Return a function that draws ellipses (center, axes, angle, BGR) on a table."""

    def draw(*ellipses, seed=0, size=(320, 240), noise=6.0, gain=1.0):
        rng = np.random.default_rng(seed)
        image = np.full((size[1], size[0], 3), GREY, np.uint8)
        cv2.rectangle(image, (0, int(0.6 * size[1])), size, BROWN, -1)
        for center, axes, angle, color in ellipses:
            fixed = [tuple(round(16 * x) for x in pair) for pair in (center, axes)]
            cv2.ellipse(image, *fixed, angle, 0, 360, color, -1, cv2.LINE_AA, 4)
        blurred = cv2.GaussianBlur(image, (0, 0), 1.0) * gain
        return np.clip(blurred + rng.normal(0, noise, image.shape), 0, 255).astype(np.uint8)

    return draw

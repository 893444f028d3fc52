import io

import numpy as np
import pytest
from matplotlib.image import imread

from nico_selfmodel.viz.figures.photographs import in_colour, jpeg, photograph_of, resampled, shrunk
from nico_selfmodel.viz.scene.lettering import label


@pytest.fixture
def image():
    return np.random.default_rng(0).integers(0, 255, (9, 14, 3), dtype=np.uint8)


def test_a_small_image_is_the_mean_of_blocks(image):
    small = shrunk(image, 6)
    assert small.shape == (4, 7, 3)
    blocks = image[:8, :14].reshape(4, 2, 7, 2, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(small, blocks, atol=0.51)


def test_an_image_that_is_small_enough_stays(image):
    assert shrunk(image, 8) is image


def test_grey_becomes_colour(image):
    np.testing.assert_array_equal(in_colour(image[:, :, 0])[:, :, 2], image[:, :, 0])


@pytest.mark.parametrize("wrong", [np.zeros((4, 5, 3)), np.zeros((4, 5, 4), dtype=np.uint8)])
def test_what_is_no_image_is_refused(wrong):
    with pytest.raises(ValueError, match="8 bits of shape"):
        in_colour(wrong)


def test_a_photograph_of_another_size_is_refused_by_name(image):
    with pytest.raises(ValueError, match=r"left image of view 03 is 14 x 9.* for 20 x 9"):
        photograph_of({"left": {"03": image}}, "left", "03", (20, 9))
    assert photograph_of({"left": {}}, "left", "03", (20, 9)) is None
    assert photograph_of(None, "left", "03", (20, 9)) is None


def test_colours_between_pixels_are_mixed_and_those_outside_are_grey(image):
    v, u = np.mgrid[:9, :14]
    np.testing.assert_array_equal(resampled(image, np.stack([u, v], axis=-1)), image)
    places = np.array([[3.5, 4.0], [2.0, 6.25], [-2.0, 1.0], [3.0, 8.9], [np.nan, 1.0]])
    between = resampled(image, places).astype(float)
    np.testing.assert_allclose(between[0], image[4, 3:5].mean(axis=0), atol=0.51)
    mixed = 0.75 * image[6, 2].astype(float) + 0.25 * image[7, 2]
    np.testing.assert_allclose(between[1], mixed, atol=0.51)
    assert np.all(between[2:] == between[2, 0])


def test_a_jpeg_shows_the_same_image():
    smooth = np.broadcast_to(np.linspace(0, 250, 32)[:, None, None], (32, 24, 3)).astype(np.uint8)
    again = imread(io.BytesIO(jpeg(smooth)), format="jpeg")
    np.testing.assert_allclose(again.astype(float), smooth, atol=6.0)


def test_words_are_as_wide_as_they_are_long_and_hang_where_they_should():
    pose = np.eye(4)
    pose[:3, 3] = [1.0, 2.0, 3.0]
    short, long = (label("a", text, "#112233", 0.1, pose, (0.0, 1.0)) for text in ("a", "abcdefgh"))
    assert short.height == long.height == 0.1
    assert long.width > 3.0 * short.width
    low_left = long.X_WI @ np.append(long.corners[3], 1.0)
    np.testing.assert_allclose(low_left[:3], [1.0, 2.0, 3.0], atol=1e-12)

"""Patches of colour: learned from clicks, found by the thesis' way, or not seen."""

import numpy as np
import pytest

from nico_selfmodel.errors import DataError
from nico_selfmodel.vision.color.color_blob import color_blobs, color_mask, find_color_blob
from nico_selfmodel.vision.color.color_model import ColorModel
from nico_selfmodel.vision.images.not_seen import NotSeen

from .conftest import BLUE, BROWN, GREY, RED

YELLOW, GREEN, MAGENTA = (30, 190, 210), (60, 170, 60), (170, 40, 190)
PATCH = ((160.3, 100.6), (34.0, 16.0), 25.0)


@pytest.fixture
def red(draw_scene):
    return ColorModel.from_clicks([draw_scene((*PATCH, RED))], [[(155, 98), (166, 104)]], 4)


@pytest.mark.parametrize("color", [RED, BLUE, YELLOW, GREEN, MAGENTA])
def test_any_strong_colour_is_learned_from_clicks_and_found(color, draw_scene):
    others = [c for c in (RED, BLUE, GREEN) if c != color]
    distractors = [((60.0 + 90 * i, 180.0), (20.0, 20.0), 0.0, c) for i, c in enumerate(others)]
    image = draw_scene((*PATCH, color), *distractors)
    model = ColorModel.from_clicks([image], [[(155, 98), (166, 104)]])
    # Another picture, darker and noisier.
    seen = find_color_blob(draw_scene((*PATCH, color), *distractors, seed=1, gain=0.8), model)
    assert seen.center == pytest.approx(PATCH[0], abs=0.6)
    assert seen.centroid == pytest.approx(PATCH[0], abs=0.3)
    assert seen.area_px == pytest.approx(np.pi * 34 * 16, rel=0.1)


def test_centres_of_patches_are_unbiased(red, draw_scene):
    rng = np.random.default_rng(0)
    errors = []
    for seed in range(40):
        center = rng.uniform((60, 50), (260, 100))
        image = draw_scene((center, rng.uniform(9, 25, 2), rng.uniform(0, 180), RED), seed=seed)
        seen = find_color_blob(image, red)
        errors.append([seen.center - center, seen.centroid - center])
    box, mean = np.moveaxis(errors, 1, 0)
    assert np.abs(np.mean(box, axis=0)).max() < 0.15
    assert np.abs(np.mean(mean, axis=0)).max() < 0.05
    assert np.std(mean) < 0.1 < np.std(box) < 0.5


def test_the_labelling_fills_gaps_and_drops_specks(red, draw_scene):
    whole = red.matches(draw_scene((*PATCH, RED), noise=0.0))
    speck = ((40.0, 40.0), (1.0, 1.0), 0.0, RED)
    image = draw_scene((*PATCH, RED), speck)
    gaps = np.random.default_rng(1).random(whole.shape) < 0.3
    image[gaps] = (255, 255, 255)
    assert red.matches(image)[whole].mean() < 0.75
    mask = color_mask(image, red)
    assert mask[whole].mean() > 0.95
    assert red.matches(image)[36:45, 36:45].any()
    assert not mask[30:50, 30:50].any()
    assert find_color_blob(image, red).center == pytest.approx(PATCH[0], abs=1.0)


def test_the_centre_is_the_bounding_box_or_the_mean_as_the_model_says(red, draw_scene):
    drop = ((150.0, 90.0), (10.0, 10.0), 0.0, RED), ((175.0, 90.0), (25.0, 4.0), 0.0, RED)
    image = draw_scene(*drop)
    seen = find_color_blob(image, red)
    left, top, width, height = seen.box
    assert seen.center.tolist() == [left + 0.5 * (width - 1), top + 0.5 * (height - 1)]
    mean = ColorModel(**{**vars(red), "center": "centroid"})
    assert find_color_blob(image, mean).center == pytest.approx(seen.centroid)
    assert seen.centroid[0] < seen.center[0] - 5


def test_a_patch_at_the_border_is_not_seen(red, draw_scene):
    image = draw_scene(((5.0, 100.0), (30.0, 16.0), 0.0, RED))
    seen = find_color_blob(image, red)
    assert isinstance(seen, NotSeen)
    assert "cut by the border" in seen.reason
    (cut,) = color_blobs(image, red)
    assert cut.touches_border
    assert cut.box[0] == 0


def test_what_is_absent_over_exposed_small_or_double_is_not_seen(red, draw_scene):
    twin = ((80.0, 60.0), (33.0, 16.0), 0.0, RED)
    cases = {
        "no pixels of the colour": draw_scene(),
        "no pixels": draw_scene((*PATCH, RED), gain=8.0),
        "fewer than 30": draw_scene(((160.0, 100.0), (2.6, 2.6), 0.0, RED)),
        "two patches of nearly the same size": draw_scene((*PATCH, RED), twin),
    }
    for reason, image in cases.items():
        seen = find_color_blob(image, red)
        assert isinstance(seen, NotSeen)
        assert reason in seen.reason


def test_a_colour_survives_the_round_trip(red, tmp_path):
    path = tmp_path / "red.yaml"
    red.save(path)
    assert ColorModel.load(path) == red
    assert "# " in path.read_text()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("nico-color/1", "nico-color/9", "'format' must be nico-color/1, got 'nico-color/9'"),
        ("saturation:", "saturatoin:", "unknown key 'saturatoin', did you mean 'saturation'"),
        ("dominant: red", "dominant: pink", "'dominant' must be red, green or blue"),
        ("dominant: red", "dominant: green", "unknown key 'over_green'"),
        ("center: box", "center: middle", "center must be box or centroid"),
        ("saturation: ", "saturation: 7", "saturation must be between 0 and 1"),
        ("hue_deg: ", "hue_deg: x", "'hue_deg' must be a finite number"),
    ],
)
def test_a_spoilt_colour_file_is_refused_in_words(red, tmp_path, old, new, message):
    path = tmp_path / "red.yaml"
    red.save(path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(DataError, match=message):
        ColorModel.load(path)


def test_a_colour_file_without_a_threshold_is_refused(red, tmp_path):
    path = tmp_path / "red.yaml"
    red.save(path)
    lines = path.read_text().splitlines()
    path.write_text("\n".join(line for line in lines if not line.startswith("hue_deg")))
    with pytest.raises(DataError, match="key 'hue_deg' is missing"):
        ColorModel.load(path)


def test_clicks_that_show_no_colour_are_refused(draw_scene):
    image = draw_scene((*PATCH, RED), ((60.0, 60.0), (20.0, 20.0), 0.0, GREEN))
    with pytest.raises(DataError, match="nearly grey"):
        ColorModel.from_clicks([image], [[(250, 40)]])
    with pytest.raises(DataError, match="nearly grey"):
        ColorModel.from_clicks([draw_scene((*PATCH, RED), gain=9.0)], [[(160, 100)]])
    with pytest.raises(DataError, match="different colours"):
        ColorModel.from_clicks([image], [[(160, 100), (60, 60)]])
    with pytest.raises(ValueError, match="400,10 lies outside the image of 320x240"):
        ColorModel.from_clicks([image], [[(400, 10)]])
    with pytest.raises(ValueError, match="at least one is needed"):
        ColorModel.from_clicks([image], [[]])
    with pytest.raises(ValueError, match="each of 1 images, got 2"):
        ColorModel.from_clicks([image], [[], []])


def test_the_colours_of_the_scene_are_what_the_tests_take_them_for(draw_scene):
    image = draw_scene((*PATCH, RED), noise=0.0)
    assert image[100, 160].tolist() == list(RED)
    assert image[40, 250].tolist() == list(GREY)
    assert image[220, 20].tolist() == list(BROWN)

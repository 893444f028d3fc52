"""Fiducial markers: read, located without bias, told from their reflections."""

import cv2
import numpy as np
import pytest

from nico_selfmodel.vision.images.not_seen import NotSeen
from nico_selfmodel.vision.markers.fiducial import FiducialSearch, of_one_id
from nico_selfmodel.vision.markers.fiducial_family import FiducialFamily

from .printed_boards import CODES_36H11, cells_of_code
from .rendering import random_view, render_marker

FAMILIES = ["apriltag_36h11", "aruco_4x4_50", "aruco_5x5_100", "aruco_6x6_250", "aruco_original"]


@pytest.fixture(scope="module")
def located(april_tags):
    """Return errors of centres and corners [px] of 100 markers, 25 to 120 px large."""
    rng = np.random.default_rng(0)
    centers, corners = [], []
    for k in range(100):
        H = random_view(rng, rng.uniform(25, 120), (224, 220))
        truth = render_marker(april_tags, k, H, rng, image_size=(224, 220))
        (seen,) = FiducialSearch.of(truth.image, mirrors=False).seen
        assert (seen.id, seen.mirrored) == (k, False)
        centers.append(seen.center - truth.center)
        corners.append(seen.corners - truth.points)
    return np.array(centers), np.array(corners)


@pytest.mark.slow
def test_the_centre_of_a_marker_is_found_without_bias(located):
    centers, _ = located
    assert np.abs(centers.mean(axis=0)).max() <= 0.02
    assert np.sqrt(np.sum(centers**2, axis=1).mean()) <= 0.1


@pytest.mark.slow
def test_the_corners_of_a_marker_are_found_to_a_tenth_of_a_pixel(located):
    _, corners = located
    assert np.abs(corners.mean(axis=(0, 1))).max() <= 0.02
    assert np.sqrt(np.sum(corners**2, axis=2).mean()) <= 0.1


@pytest.mark.parametrize("name", FAMILIES)
def test_markers_of_every_family_are_read(name):
    family = FiducialFamily(name)
    rng = np.random.default_rng(1)
    marker = 21
    truth = render_marker(family.dictionary, marker, random_view(rng, 80, (320, 240)), rng)
    seen = FiducialSearch.of(truth.image, name).one(marker)
    assert seen.family == name
    assert seen.corners == pytest.approx(truth.points, abs=0.2)
    assert seen.center == pytest.approx(truth.center, abs=0.1)


def test_a_marker_in_a_mirror_is_known_and_located_where_it_is_seen(april_tags):
    rng = np.random.default_rng(2)
    for marker in range(8):
        truth = render_marker(april_tags, marker, random_view(rng, 60, (320, 240)), rng)
        (seen,) = FiducialSearch.of(np.ascontiguousarray(truth.image[:, ::-1])).seen
        assert (seen.id, seen.mirrored) == (marker, True)
        # The printed corners keep their names; an integer pixel is its centre.
        flipped = truth.points * (-1, 1) + (319, 0)
        assert seen.corners == pytest.approx(flipped, abs=0.25)
        assert seen.center == pytest.approx(truth.center * (-1, 1) + (319, 0), abs=0.1)


def test_a_marker_and_its_reflection_are_both_reported(april_tags):
    rng = np.random.default_rng(3)
    image = render_marker(april_tags, 4, random_view(rng, 50, (320, 240)), rng).image
    both = np.hstack([image, image[:, ::-1]])
    direct, reflected = FiducialSearch.of(both).seen
    assert (direct.id, direct.mirrored) == (4, False)
    assert (reflected.id, reflected.mirrored) == (4, True)
    assert direct.center + reflected.center * (1, 0) == pytest.approx(
        (both.shape[1] - 1, direct.center[1]), abs=0.1
    )
    assert FiducialSearch.of(both).one(mirrored=True).center == pytest.approx(reflected.center)
    ambiguous = FiducialSearch.of(both).one(marker=4)
    assert isinstance(ambiguous, NotSeen)
    assert "4, 4 (mirrored) were seen" in ambiguous.reason


def test_two_tags_of_one_id_are_not_told_apart_and_named(april_tags):
    rng = np.random.default_rng(3)
    image = render_marker(april_tags, 4, random_view(rng, 50, (320, 240)), rng).image
    both = FiducialSearch.of(np.hstack([image, image]))
    assert of_one_id(both.seen) == (4,)
    words = "marker 4 is at two places at once: tags of one id cannot be told apart, give each its"
    for mirrored in (None, False):
        assert both.one(4, mirrored=mirrored).reason.startswith(words)
    mirrors = FiducialSearch.of(np.ascontiguousarray(np.hstack([image, image])[:, ::-1]))
    assert len(mirrors.seen) == 2
    assert of_one_id(mirrors.seen) == ()  # one tag may be in two mirrors


def test_small_markers_are_read_from_the_enlarged_image(april_tags):
    rng = np.random.default_rng(4)
    H = random_view(rng, 18, (160, 120), tilt=0.3)
    truth = render_marker(april_tags, 9, H, rng, image_size=(160, 120))
    seen = FiducialSearch.of(truth.image).one()
    assert seen.id == 9
    assert seen.center == pytest.approx(truth.center, abs=0.3)


def test_a_finger_over_an_edge_does_not_pull_the_centre(april_tags):
    rng = np.random.default_rng(5)
    H = random_view(rng, 100, (320, 240), tilt=0.2, roll=0.0)
    truth = render_marker(april_tags, 6, H, rng)
    image = truth.image.copy()
    side = 0.5 * (truth.points[0] + truth.points[1])
    cv2.circle(image, tuple(int(x) for x in np.rint(side)), 7, (120, 150, 190), -1)
    seen = FiducialSearch.of(image).one()
    assert seen.id == 6
    assert seen.center == pytest.approx(truth.center, abs=0.3)


def test_a_marker_half_out_of_view_or_absent_is_not_seen(april_tags, draw_scene):
    rng = np.random.default_rng(6)
    truth = render_marker(april_tags, 2, random_view(rng, 80, (320, 240), tilt=0.1), rng)
    cut = truth.image[:, round(truth.center[0]) :]
    for image in (cut, draw_scene(), np.full((240, 320), 255, np.uint8)):
        seen = FiducialSearch.of(image).one()
        assert isinstance(seen, NotSeen)
        assert "no apriltag_36h11 marker" in seen.reason
        assert FiducialSearch.of(image).seen == ()


def test_an_over_exposed_marker_is_not_seen(april_tags):
    rng = np.random.default_rng(7)
    truth = render_marker(april_tags, 2, random_view(rng, 80, (320, 240)), rng)
    burnt = np.clip(truth.image.astype(int) * 8, 0, 255).astype(np.uint8)
    assert isinstance(FiducialSearch.of(burnt).one(), NotSeen)


def test_the_wrong_id_is_not_seen_and_the_right_one_is_named(april_tags):
    rng = np.random.default_rng(8)
    image = render_marker(april_tags, 5, random_view(rng, 80, (320, 240)), rng).image
    assert FiducialSearch.of(image).one(marker=3).reason == "no apriltag_36h11 marker 3; 5 seen"
    assert "in a mirror" in FiducialSearch.of(image).one(marker=5, mirrored=True).reason
    assert FiducialSearch.of(image, "aruco_6x6_250").one().reason == "no aruco_6x6_250 marker"


def test_markers_that_are_their_own_mirror_images_are_known():
    assert not FiducialFamily("apriltag_36h11").mirror_twins
    assert not FiducialFamily("aruco_6x6_250").mirror_twins
    assert FiducialFamily("aruco_4x4_50").mirror_twins == {8, 9, 17, 47}


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda image: FiducialSearch.of(image, "apriltag").seen, "There are apriltag_25h9"),
        (lambda image: FiducialSearch.of(image).one(marker=587), "ids 0 to 586, got 587"),
        (lambda image: FiducialSearch.of(image.astype(float)).seen, "8 bits"),
        (lambda image: FiducialSearch.of(image[..., :2]).seen, "shape"),
    ],
)
def test_wrong_arguments_are_refused(call, message, draw_scene):
    with pytest.raises(ValueError, match=message):
        call(draw_scene())


@pytest.mark.parametrize("border", [1, 2])
def test_april_tags_stand_upright_as_their_own_library_prints_them(border):
    family = FiducialFamily("apriltag_36h11")
    for tag, code in enumerate(CODES_36H11):
        inner = family.upright(tag, border)[border:-border, border:-border]
        np.testing.assert_array_equal(inner, cells_of_code(code))


def test_tags_of_other_makers_stand_upright_as_opencv_has_them():
    family = FiducialFamily("aruco_5x5_100")
    np.testing.assert_array_equal(family.upright(7, 1), family.pattern(7, 1))

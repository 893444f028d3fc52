"""Crossings of two edges: places of symmetry, against drawn ones of known place and curvature."""

import cv2
import numpy as np
import pytest

from nico_selfmodel.vision.boards.crossings import Crossings, straightened
from nico_selfmodel.vision.boards.exact_corners import located, straight

from ..slow_rest import slow_rest

FINE, SIDE, MIDDLE = 8, 61, 30.0
PHASES = [(0.0, 0.0), (0.13, 0.4), (-0.3, 0.21), (0.45, -0.37)]


def drawn(at=(0.0, 0.0), turn=0.3, curved=0.0, angle=np.pi / 2, blur=0.7):
    """Return a picture of two edges that cross `at` from its middle; one of them is curved."""
    steps = (np.arange(SIDE * FINE) + 0.5) / FINE - 0.5 - MIDDLE
    x, y = np.meshgrid(steps - at[0], steps - at[1])
    across = np.cos(turn) * y - np.sin(turn) * x
    along = np.cos(turn) * x + np.sin(turn) * y
    first = across - 0.5 * curved * along**2
    second = np.sin(angle) * along - np.cos(angle) * across
    light = 110.0 + 80.0 * np.prod([np.clip(2.0 * FINE * d, -1.0, 1.0) for d in (first, second)], 0)
    image = cv2.GaussianBlur(light, (0, 0), blur * FINE)
    return cv2.resize(image, (SIDE, SIDE), interpolation=cv2.INTER_AREA)


def bytes_of(image):
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def places(images, radius, start=(0.0, 0.0)):
    """Return places from the middle. Shape (n, 2)."""
    guess = np.full((1, 2), MIDDLE) + start
    found = [Crossings.near(bytes_of(i), guess, np.array([radius])).places[0] for i in images]
    return np.array(found) - MIDDLE


@pytest.mark.parametrize("radius", slow_rest([5.0, 3.0, 9.0]))
@pytest.mark.parametrize("turn", [0.0, 0.3, 0.7])
def test_a_crossing_is_located_alike_wherever_in_its_pixel_it_lies(radius, turn):
    found = places([drawn(at, turn) for at in PHASES], radius, start=(0.8, -0.7))
    assert np.abs(found - PHASES).max() < 0.008


def test_opencvs_search_is_drawn_by_the_pixels():
    """Why there is another one."""
    end = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    off = []
    for at in PHASES:
        start = np.full((1, 1, 2), MIDDLE, np.float32)
        corner = cv2.cornerSubPix(bytes_of(drawn(at, 0.0)), start, (5, 5), (-1, -1), end)
        off.append(corner.ravel() - MIDDLE - at)
    assert np.abs(off).max() > 0.025


@pytest.mark.parametrize("radius", [4.0, 7.0, 11.0])
def test_curved_edges_move_it_by_what_is_taken_off_again(radius):
    curvature, steps = 4e-3, np.arange(-3.0, 4.0)
    # Seven corners on the curved edge and two rows beside it, 20 px apart.
    points = np.stack(np.meshgrid(steps, [-1.0, 0.0, 1.0]), axis=-1).reshape(-1, 2)
    x, y = 20.0 * points.T
    corners = np.stack([x, y + 0.5 * curvature * x**2], axis=1)
    one, other = places([drawn((0.1, 0.2), 0.0, k) for k in (curvature, -curvature)], radius)
    moved = 0.5 * (one - other)
    assert moved[1] > 0.6 * curvature * radius**2 / 14.0
    middle = int(np.flatnonzero((points == 0.0).all(axis=1))[0])
    mended = straightened(points, corners + moved, np.full(len(points), radius))
    assert np.linalg.norm(mended[middle] - corners[middle]) < 0.3 * np.linalg.norm(moved)


def test_what_curved_edges_move_a_corner_by_is_what_its_window_shows_at_the_picture_s_edge():
    """5 px from the edge a window of 11 px is one of 4."""
    x, row = (one.ravel() for one in np.meshgrid(np.arange(-3.0, 4.0), [0.0, 1.0, 2.0]))
    points = np.stack([x, row], axis=1)
    corners = np.stack([100.0 + 20.0 * x, 5.0 + 20.0 * row + 0.5 * 8e-4 * (20.0 * x) ** 2], axis=1)
    found = straight(points, np.zeros((100, 200), np.uint8), corners, np.full(len(points), 11.0))
    top = int(np.flatnonzero((points == 0.0).all(axis=1))[0])
    for at, radius in ((top, 4.0), (top + 7, 11.0)):
        wanted = straightened(points, corners, np.full(len(points), radius))
        np.testing.assert_allclose(found[at], wanted[at], atol=1e-9)
    assert found[top, 1] - corners[top, 1] != pytest.approx(found[top + 7, 1] - corners[top + 7, 1])


def test_straight_edges_and_lone_corners_stay():
    points = np.stack(np.meshgrid(np.arange(4.0), np.arange(3.0)), axis=-1).reshape(-1, 2)
    corners = 20.0 * points @ np.array([[1.0, 0.2], [-0.1, 0.9]])
    radius = np.full(len(points), 6.0)
    np.testing.assert_allclose(straightened(points, corners, radius), corners, atol=1e-9)
    corners[np.isin(points[:, 0], (1.0, 2.0))] = np.nan
    np.testing.assert_array_equal(straightened(points, corners, radius), corners)


def test_corners_found_in_one_place_stay_there():
    points = np.stack(np.meshgrid(np.arange(4.0), np.arange(3.0)), axis=-1).reshape(-1, 2)
    corners = 20.0 * points
    corners[:4] = corners[0]
    corners[5] = corners[4]
    assert np.isfinite(straightened(points, corners, np.full(len(points), 6.0))).all()


def seen(image, start=(0.0, 0.0), radius=6.0):
    rough = np.full((1, 2), MIDDLE) + start
    return bool(np.isfinite(located(bytes_of(image), rough, np.array([radius]))).all())


@pytest.mark.parametrize(("faint", "plain"), [(0.0, False), (0.08, False), (0.2, True)])
def test_the_middle_of_a_stripe_is_no_crossing_though_it_looks_alike_after_half_a_turn(
    faint, plain
):
    stripe = np.full((SIDE, SIDE), 70.0)
    stripe[28:33] = 180.0
    stripe = cv2.GaussianBlur(stripe, (0, 0), 0.7) + faint * (drawn() - 110.0)
    found = Crossings.near(bytes_of(stripe), np.full((1, 2), MIDDLE), np.array([6.0]))
    assert found.sameness[0] > 0.99
    assert seen(stripe) == plain


@pytest.mark.parametrize(("wide", "plain"), [(1.0, True), (3.0, False)])
def test_a_card_that_cuts_in_hides_a_crossing(wide, plain):
    image = drawn(turn=0.3)
    image[:, : int(MIDDLE - 6.0 + wide)] = 150.0
    assert seen(cv2.GaussianBlur(image, (0, 0), 0.7)) == plain


@pytest.mark.parametrize(("levels", "plain"), [(7.0, False), (10.0, True)])
def test_a_faint_crossing_is_not_plain(levels, plain):
    assert seen(110.0 + (drawn() - 110.0) * levels / 80.0) == plain


@pytest.mark.parametrize(("radius", "plain"), [(1.9, False), (2.1, True)])
def test_a_crossing_needs_room(radius, plain):
    assert seen(drawn(), radius=radius) == plain

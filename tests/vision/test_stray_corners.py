"""A corner whose search failed is outliers; lenses, tilts and noise are."""

import cv2
import numpy as np
import pytest

from nico_selfmodel.least_squares import levenberg_marquardt
from nico_selfmodel.vision.boards import chessboard as chessboard_module
from nico_selfmodel.vision.boards import stray_corners as stray_corners_module
from nico_selfmodel.vision.boards.chessboard import (
    Board,
    BoardDetection,
    find_chessboard,
    size_of_board,
)
from nico_selfmodel.vision.boards.stray_corners import stray_corners
from nico_selfmodel.vision.images.not_seen import NotSeen

from ..slow_rest import slow_rest
from .rendering import _photograph, project, random_view, render_board

BOARD = Board(9, 6, 0.025)
SIZE = (640, 480)


def grid_of(rows, columns, seed, noise=0.1, bend=-0.25):
    """Return corners as a tilted board's behind a bending lens. Shape (rows, columns, 2)."""
    rng = np.random.default_rng(seed)
    H = random_view(rng, 380, (640, 480), tilt=0.8, center=(320, 240))
    across, down = np.meshgrid(np.linspace(-1, 1, columns), np.linspace(-0.7, 0.7, rows))
    ideal = (project(H, np.stack([across.ravel(), down.ravel()], axis=1)) - (320, 240)) / 400.0
    bent = ideal * (1.0 + bend * np.sum(ideal**2, axis=1, keepdims=True))
    pixels = bent * 400.0 + (320, 240) + rng.normal(0.0, noise, ideal.shape)
    return pixels.reshape(rows, columns, 2)


@pytest.mark.parametrize(("rows", "columns"), [(6, 9), (5, 7), (4, 5), (3, 4), (3, 3), (8, 11)])
@pytest.mark.parametrize("seed", slow_rest(range(8), plain=3))
def test_tilt_lens_and_noise_lead_no_corner_astray(rows, columns, seed):
    for window in (3, 11, None):
        assert not stray_corners(grid_of(rows, columns, seed), SIZE, window).any()


@pytest.mark.parametrize(("rows", "columns"), slow_rest([(5, 7), (6, 9), (4, 6)]))
@pytest.mark.parametrize("off", slow_rest([5.0, 8.0, 12.0]))
def test_a_corner_that_is_off_is_found_wherever_it_stands(rows, columns, off):
    rng = np.random.default_rng(1)
    for place in np.ndindex(rows, columns):
        grid = grid_of(rows, columns, seed=sum(place))
        angle = rng.uniform(-np.pi, np.pi)
        grid[place] += off * np.array([np.cos(angle), np.sin(angle)])
        assert stray_corners(grid, SIZE, 5).any(), place


@pytest.mark.parametrize("seed", slow_rest(range(30), plain=10))
def test_a_fisheye_leads_no_corner_astray(seed):
    """OpenCV's equidistant lens of 130 degrees, boards up to 60 degrees off its axis."""
    rng = np.random.default_rng(seed)
    K = np.array([[280.0, 0, 320], [0, 280, 240], [0, 0, 1]])
    across, down = np.meshgrid(np.arange(9) - 4.0, np.arange(6) - 2.5)
    board = 0.025 * np.stack([across.ravel(), down.ravel(), 0.0 * down.ravel()], axis=1)
    turn, angle, away = rng.normal(0.0, 0.4, 3), rng.uniform(-np.pi, np.pi), rng.uniform(0.0, 0.6)
    towards = [np.sin(away) * np.cos(angle), np.sin(away) * np.sin(angle), np.cos(away)]
    pose = turn.reshape(3, 1), rng.uniform(0.1, 0.3) * np.array(towards).reshape(3, 1)
    lens = np.array([0.02, -0.01, 0.003, -0.001])
    pixels, _ = cv2.fisheye.projectPoints(board[:, None], *pose, K, lens)
    grid = pixels.reshape(6, 9, 2) + rng.normal(0.0, 0.1, (6, 9, 2))
    assert not stray_corners(grid, SIZE).any()


def test_a_window_that_reaches_the_neighbours_is_forgiven_what_it_must_do():
    grid = 20.0 * np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0)), axis=-1) + 100.0
    grid += np.random.default_rng(0).normal(0.0, 0.1, grid.shape)
    grid[2, 3] += (3.0, 0.0)
    assert stray_corners(grid, SIZE, 5)[2, 3]
    assert not stray_corners(grid, SIZE, 11).any()
    grid[2, 3] += (4.0, 0.0)
    assert stray_corners(grid, SIZE, 11)[2, 3]


def seen_board(size, span):
    """Return a picture of the board. The square in `random_view` is `span` pixels wide."""
    rng = np.random.default_rng(5)
    H = random_view(rng, span, size, tilt=0.4, center=(size[0] / 2, size[1] / 2))
    return render_board(9, 6, H, rng, image_size=size)


@pytest.mark.parametrize(
    ("size", "span"),
    [((640, 480), 330), pytest.param((2200, 1650), 1100, marks=pytest.mark.slow)],
)
def test_a_search_that_comes_back_to_where_it_began_is_no_corner(monkeypatch, size, span):
    """In a faint picture no corner is plain; a large one is searched in a copy first."""
    picture = seen_board(size, span)
    image = np.rint(120 + 0.04 * picture.image).astype(np.uint8)
    real = cv2.cornerSubPix
    asked = []

    def one_fails(gray, corners, window, *others):
        rough = corners.reshape(-1, 2)[17].copy()
        refined = real(gray, corners, window, *others)
        asked.append(window)
        if window == (5, 5):
            refined.reshape(-1, 2)[17] = rough
        return refined

    monkeypatch.setattr(chessboard_module.cv2, "cornerSubPix", one_fails)
    found = find_chessboard(image, BOARD, 5)
    assert (asked[-1], len(asked)) == ((5, 5), 1 if size == SIZE else 2)
    assert (found.window, np.flatnonzero(~found.seen).tolist()) == (5, [17])
    off = np.linalg.norm(found.corners - picture.points, axis=1)
    assert np.nanmax(off) < 1.0


def test_a_corner_that_is_plain_nowhere_is_not_seen_and_costs_no_board(monkeypatch):
    image = seen_board(SIZE, 330).image
    whole = find_chessboard(image, BOARD, 5)
    real = chessboard_module.located
    asked = []

    def not_plain(gray, corners, radius):
        found = real(gray, corners, radius)
        near = np.linalg.norm(corners - whole.corners[17], axis=1) < 3.0
        asked.append((len(corners), int(near.sum())))
        found[near] = np.nan
        return found

    monkeypatch.setattr(chessboard_module, "located", not_plain)
    found = find_chessboard(image, BOARD, 5)
    assert asked == [(54, 1), (1, 1)]
    assert (found.method, found.window, found.loose) == (whole.method, None, False)
    assert np.flatnonzero(~found.seen).tolist() == [17]
    assert np.nanmax(np.abs(found.corners - whole.corners)) < 0.01


@pytest.mark.parametrize("seed", slow_rest(range(40), plain=4))
def test_what_is_seen_beside_glare_is_where_it_is(seed):
    """Glare on a corner either leaves it where it is, or it is not seen."""
    rng = np.random.default_rng(seed)
    H = random_view(rng, 360, (640, 480), tilt=0.5, center=(320, 240))
    truth = render_board(9, 6, H, rng, image_size=(640, 480))
    u, v = truth.points[rng.integers(54)] + rng.normal(0.0, 4.0, 2)
    down, across = np.mgrid[:480, :640]
    spread = 2.0 * rng.uniform(4.0, 12.0) ** 2
    glare = rng.uniform(80, 220) * np.exp(-((across - u) ** 2 + (down - v) ** 2) / spread)
    image = np.clip(truth.image + glare[..., None], 0, 255).astype(np.uint8)
    seen = find_chessboard(image, BOARD, 5)
    assert isinstance(seen, BoardDetection)
    assert np.count_nonzero(seen.seen) >= 50
    assert np.nanmax(np.linalg.norm(seen.corners - truth.points, axis=1)) < 3.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("columns", "rows", "share", "seeds"),
    slow_rest(
        [(7, 5, 0.4, (0,)), (7, 5, 0.4, (1, 2, 3, 4)), *((9, 6, s, range(5)) for s in (0.5, 0.75))]
    ),
)
def test_a_charuco_board_is_no_chessboard(columns, rows, share, seeds):
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_6X6_250)
    board = cv2.aruco.CharucoBoard((columns + 1, rows + 1), 1.0, share, dictionary)
    texture = board.generateImage(((columns + 1) * 40, (rows + 1) * 40)) > 128
    for seed in seeds:
        rng = np.random.default_rng(seed)
        H = random_view(rng, 380, (640, 480), tilt=0.5, center=(320, 240))
        half = 20.0 * (max(columns, rows) + 1)
        image = _photograph(texture, half, H, rng, image_size=(640, 480), background=200.0)
        assert isinstance(find_chessboard(image, Board(columns, rows, 0.03), 5), NotSeen)
        assert size_of_board(image) is None


def without_a_board():
    """Yield pictures that OpenCV's detector of any size answers with a few corners."""
    noise = np.random.default_rng(0)
    for blur in (1, 2, 3, 4, 6):
        yield cv2.GaussianBlur(noise.integers(0, 255, (480, 640), dtype=np.uint8), (0, 0), blur)
    for gap in (5, 15, 20, 30):
        squares = np.full((480, 640), 255, np.uint8)
        for i, j in np.ndindex(8, 8):
            top, left = 20 + (25 + gap) * i, 60 + (25 + gap) * j
            squares[top : top + 25, left : left + 25] = 0
        yield squares
    for step in (30, 40, 45):
        dots = np.full((480, 640), 255, np.uint8)
        for i, j in np.ndindex(10, 10):
            cv2.circle(dots, (60 + step * j, 30 + step * i), 12, 0, -1)
        yield dots


@pytest.mark.slow
@pytest.mark.parametrize("image", slow_rest(without_a_board(), plain=4))
def test_no_size_is_guessed_where_there_is_no_board(image):
    assert size_of_board(image) is None


@pytest.mark.slow
def test_the_size_of_a_board_is_still_guessed():
    rng = np.random.default_rng(3)
    H = random_view(rng, 360, (640, 480), tilt=0.3, roll=0.3, center=(320, 240))
    assert size_of_board(render_board(9, 6, H, rng, image_size=(640, 480)).image) == (9, 6)


@pytest.mark.slow
def test_a_large_picture_gives_corners_as_exact_as_a_small_one():
    rng = np.random.default_rng(2)
    H = random_view(rng, 1500, (2600, 1950), tilt=0.5, center=(1300, 975))
    truth = render_board(9, 6, H, rng, image_size=(2600, 1950))
    seen = find_chessboard(truth.image, BOARD)
    assert isinstance(seen, BoardDetection)
    assert np.linalg.norm(seen.corners - truth.points, axis=1).max() < 0.3


@pytest.mark.parametrize("bend", [0.3, 0.1, -0.25])
def test_lenses_that_bend_either_way_are_fitted_in_few_steps(monkeypatch, bend):
    """A lens that bends outwards has the least field there is: steps below it led nowhere."""
    fits = []

    def counted(*arguments, **options):
        fits.append(levenberg_marquardt(*arguments, **options))
        return fits[-1]

    monkeypatch.setattr(stray_corners_module, "levenberg_marquardt", counted)
    for seed in range(12):
        assert not stray_corners(grid_of(6, 9, seed, bend=bend), SIZE).any()
    assert np.mean([fit.iterations for fit in fits]) < 8.0
    assert all(fit.converged for fit in fits)

"""Corners of a board in one or two cameras: what was seen, choices of it, and refusals."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.errors import DataError

BOARD = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]])
NAMES = ("01", "02", "03", "04")


@pytest.fixture
def views():
    pixels = np.arange(4 * 3 * 4, dtype=float).reshape(4, 3, 4)
    pixels[1, :, 2:] = np.nan
    pixels[2, 1, 0] = np.nan
    return BoardViews(BOARD, NAMES, ("left", "right"), pixels, ((640, 480),) * 2)


def test_a_corner_is_seen_where_both_its_coordinates_are_known(views):
    assert len(views) == 4
    expected = np.ones((4, 2, 3), dtype=bool)
    expected[1, 1] = expected[2, 0, 1] = False
    assert np.array_equal(views.seen, expected)


def test_each_camera_has_its_own_columns(views):
    assert np.array_equal(views.of_camera("left"), views.pixels[:, :, :2], equal_nan=True)
    right = views.only("right")
    assert right.names == ("01", "03", "04")
    assert right.cameras == ("right",)
    assert np.array_equal(right.pixels, views.pixels[[0, 2, 3], :, 2:])
    assert np.array_equal(right.of_camera("right"), right.pixels)
    assert len(views.only("left")) == 4  # seen in part is seen


@pytest.mark.parametrize("rows", [[3, 1], (3, 1), np.array([3, 1])])
def test_views_are_chosen_by_number_in_that_order(views, rows):
    chosen = views.select(rows)
    assert chosen.names == ("04", "02")
    assert np.array_equal(chosen.pixels, views.pixels[[3, 1]], equal_nan=True)


@pytest.mark.parametrize(
    ("corners", "places"),
    [
        ([(0, 0), (0, 1), (1, 0)], False),
        ([(0, 0), (0, 1), (0, 2), (0, 3)], False),
        ([(0, 0), (0, 1), (0, 2), (1, 0)], False),
        ([(0, 0), (1, 1), (2, 2), (3, 3), (0, 1)], False),
        ([(0, 0), (0, 1), (1, 0), (1, 1)], True),
        ([(0, 0), (0, 1), (0, 2), (1, 0), (1, 1)], True),
    ],
)
def test_a_board_is_placed_by_four_corners_no_three_of_them_on_one_line(corners, places):
    """A line of corners and one beside it tell no homography, and had ended in an error."""
    p_GQ = np.array([(0.025 * i, 0.025 * j, 0.0) for i in range(4) for j in range(4)])
    pixels = np.full((1, 16, 2), np.nan)
    for i, j in corners:
        pixels[0, 4 * i + j] = 100.0 + 20.0 * i, 50.0 + 20.0 * j
    one = BoardViews(p_GQ, ("00",), ("left",), pixels, ((640, 480),))
    assert one.placing.tolist() == [[places]]
    assert len(one.placeable()) == places


def test_views_are_chosen_by_a_mask(views):
    assert views.select(np.array([True, False, True, False])).names == ("01", "03")
    assert len(views.select(np.zeros(4, dtype=bool))) == 0


def test_parts_whose_place_is_not_told_become_views_of_their_own(views):
    loose = np.zeros((4, 2), dtype=bool)
    loose[0, 1] = loose[1, 0] = loose[3, 0] = True  # the second view is of one camera anyway
    views = replace(views, loose=loose)
    assert np.array_equal(views.select([3, 0]).loose, loose[[3, 0]])
    assert np.array_equal(views.pair("right", "left").loose, loose[:, ::-1])
    assert views.only("right").loose.ravel().tolist() == [True, False, False]
    apart = views.apart()
    assert apart.names == (*NAMES, "01 right", "04 left")
    assert not apart.loose.any()
    assert apart.seen.any(axis=2).tolist() == [
        [True, False], [True, False], [True, True], [False, True], [False, True], [True, False],
    ]  # fmt: skip
    for row, own, before in ((4, slice(2, 4), 0), (5, slice(0, 2), 3)):
        assert np.array_equal(apart.pixels[row, :, own], views.pixels[before, :, own])
    assert len(replace(views, loose=np.zeros((4, 2), dtype=bool)).apart()) == 4


@pytest.mark.parametrize(("fraction", "held"), [(0.25, 1), (0.5, 2), (0.01, 1)])
def test_a_split_holds_out_a_share_and_loses_nothing(views, fraction, held):
    train, test = views.split(fraction, 3)
    assert len(test) == held
    assert sorted(train.names + test.names) == list(NAMES)
    assert list(train.names) == sorted(train.names)
    assert views.split(fraction, 3)[1].names == test.names
    assert len({views.split(fraction, seed)[1].names for seed in range(20)}) > 1


@pytest.mark.parametrize("fraction", [0.0, 1.0, -0.2, 1.5])
def test_a_share_that_is_none_is_refused(views, fraction):
    with pytest.raises(ValueError, match="must lie between 0 and 1, got"):
        views.split(fraction, 0)


def test_a_split_that_leaves_nothing_to_learn_from_is_refused(views):
    with pytest.raises(DataError, match=r"0\.99 of 4 views leaves none .*: hold less out"):
        views.split(0.99, 0)
    with pytest.raises(DataError, match=r"0\.5 of 1 views leaves none .*: record more"):
        views.select([0]).split(0.5, 0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"loose": np.ones((4, 1))}, r"loose must have shape \(V, C\), got \(4, 1\)"),
        ({"names": NAMES[:3]}, r"pixels must have shape \(3, 3, 4\) .* got \(4, 3, 4\)"),
        ({"cameras": ("left",)}, r"pixels must have shape \(4, 3, 2\)"),
        ({"p_GQ": BOARD[:, :2]}, r"p_GQ \(P, 3\), got .* \(3, 2\)"),
        ({"names": ("01", "01", "02", "03")}, "views must have names of their own"),
        ({"cameras": ("left", "left")}, "cameras must have names of their own"),
        ({"cameras": ("left", "a.b")}, "names of cameras have no dot in them, got 'a.b'"),
        ({"cameras": ("left", " ")}, "names of cameras must be printable text"),
        ({"cameras": (), "pixels": np.zeros((4, 3, 0))}, "cameras must have names of their own"),
    ],
)
def test_views_that_make_no_sense_are_refused(views, change, message):
    with pytest.raises(ValueError, match=message):
        replace(views, **change)


def test_views_do_not_change_under_ones_hands():
    pixels = np.zeros((1, 3, 2))
    views = BoardViews(BOARD, ("01",), ("left",), pixels, ((640, 480),))
    pixels[0, 0, 0] = 7.0
    assert views.pixels[0, 0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        views.p_GQ[0, 0] = 1.0

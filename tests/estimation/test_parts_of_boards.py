"""Parts of chessboards lie where all cameras see one board, or are used by themselves."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.lattice_places import lattice_of, places_of
from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_initialization import pose_of_seen_boards
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.estimation.cameras.lenses.lens_choice import lens_of
from nico_selfmodel.estimation.cameras.parts_of_boards import joined, told_places
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from tests.estimation.simulated_boards import P_GQ, RIG, boards, changed, pictures
from tests.slow_rest import slow_rest

NODES, COLUMNS, ROWS = lattice_of(P_GQ)


def in_part(views, rng, rows, cameras=(0, 1)):
    """Hide all but a rectangle in some pictures, and list what is left in any place on the board.

    Returns:
        The views, and the corners where they truly are.
    """
    pixels, loose = np.array(views.pixels), np.array(views.loose)
    true = pixels.copy()
    for v in rows:
        for c in cameras:
            own = slice(2 * c, 2 * c + 2)
            width, height = rng.integers(4, COLUMNS), rng.integers(4, ROWS + 1)
            low = rng.integers(0, (COLUMNS - width + 1, ROWS - height + 1))
            inside = NODES - low
            kept = ((inside >= 0) & (inside < (width, height))).all(axis=1)
            places = places_of(NODES[kept], COLUMNS, ROWS)
            place = places[rng.integers(len(places))]
            true[v, ~kept, own] = pixels[v, :, own] = np.nan
            pixels[v, place[:, 1] * COLUMNS + place[:, 0], own] = true[v, kept, own]
            loose[v, c] = True
    return replace(views, pixels=pixels, loose=loose), true


def moves(found, true):
    """Return how each camera's corners of one view were moved over the board. Shape (2, 3, 2)."""
    maps = []
    for own in (slice(0, 2), slice(2, 4)):
        seen = np.flatnonzero(np.isfinite(found[:, own][:, 0]))
        apart = np.linalg.norm(found[seen][:, None, own] - true[:, own], axis=2)
        was = np.nanargmin(apart, axis=1)
        assert np.nanmax(apart[np.arange(len(seen)), was]) == 0.0
        places = np.column_stack([NODES[was], np.ones(len(was))])
        maps.append(np.linalg.lstsq(places, NODES[seen].astype(float))[0])
    return np.array(maps)


@pytest.mark.parametrize("seed", slow_rest(range(12)))
@pytest.mark.parametrize("cameras", [(1,), (0, 1)], ids=["one", "both"])
@pytest.mark.parametrize("share", [0.5, 1.0], ids=["some", "all"])
def test_parts_lie_where_both_cameras_see_one_board(seed, cameras, share):
    rng = np.random.default_rng((seed, 1))
    rows = range(int(share * 10))
    views, true = in_part(pictures(boards(10, seed), 0.2, seed), rng, rows, cameras)
    found = calibrate_cameras(views)
    assert found.views.names == views.names  # none had to be used by itself
    assert not found.views.loose.any()
    for one, other in zip(found.views.pixels, true, strict=True):
        left, right = moves(one, other)
        np.testing.assert_allclose(left, right, atol=1e-9)
    truth = dict(zip(RIG.names, RIG.values, strict=True))
    values = dict(zip(found.rig.names, found.rig.values, strict=True))
    off = np.array([values[name] - truth[name] for name in found.names]) / found.uncertainty.sigma
    assert np.sqrt(np.mean(off**2)) < 2.0


@pytest.mark.slow
def test_automatic_lenses_see_parts_where_they_lie():
    rng = np.random.default_rng(5)
    views, true = in_part(pictures(boards(12, 5), 0.2, 5), rng, range(12))
    found = lens_of(views, CameraOptions()).calibration
    assert found.views.names == views.names
    for one, other in zip(found.views.pixels, true, strict=True):
        left, right = moves(one, other)
        np.testing.assert_allclose(left, right, atol=1e-9)


def test_what_no_other_camera_tells_is_used_by_itself():
    rng = np.random.default_rng(3)
    views, _ = in_part(pictures(boards(10, 3), 0.2, 3), rng, [2, 4], cameras=(1,))
    # As if the board had been moved between the two exposures.
    moved = changed(views, 4, np.array([0.0, 0.0, 20.0, -14.0]))
    assert joined(views, RIG.cameras).names == views.names
    found = joined(moved, RIG.cameras)
    assert found.names == (*views.names, "04 right")
    assert np.isnan(found.of_camera("right")[4]).all()
    assert np.array_equal(found.of_camera("right")[10], moved.of_camera("right")[4], equal_nan=True)
    assert np.isnan(found.of_camera("left")[10]).all()
    assert calibrate_cameras(moved).views.names == found.names


@pytest.mark.parametrize(("share", "told"), [(0.2, True), (0.3, False)])
def test_corners_that_lie_off_by_a_quarter_of_a_square_are_no_others(share, told):
    rng = np.random.default_rng(4)
    exact = pictures(boards(4, 4))
    square = np.median(np.linalg.norm(np.diff(exact.pixels[1, :9, 2:], axis=0), axis=1))
    views, _ = in_part(exact, rng, [1], cameras=(1,))
    off = changed(views, 1, np.array([0.0, 0.0, share * square, 0.0]))
    assert (joined(off, RIG.cameras).names == views.names) is told


def test_boards_held_alike_do_not_tell_their_places():
    held = np.array(
        [transform(rotation_from_vector([0.2, 0.1, 0.0]), [x, -0.07, 0.35]) for x in (-0.1, -0.12)]
    )
    views, _ = in_part(pictures(held), np.random.default_rng(1), [0, 1])
    placed = [
        (camera, pose_of_seen_boards((camera.at(np.eye(4)),), views.only(name)))
        for name, camera in zip(views.cameras, RIG.cameras, strict=True)
    ]
    with pytest.raises(EstimationError, match="parts of it may lie in several ways"):
        told_places(views, placed)

"""Held-out boards, epipolar lines and rebuilt squares: what calibrated cameras are worth."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.cameras.board_accuracy import (
    Reconstruction,
    corner_distances,
    cross_validate_cameras,
    epipolar_errors,
    have_rays,
    held_out_residuals,
)
from nico_selfmodel.estimation.cameras.board_check import BoardCheck
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_initialization import within_reach
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.cameras.stereo_rig import StereoRig

from .simulated_boards import LEFT, P_GQ, RIG, RIGHT, SQUARE, boards, changed, pictures, unseen

SIGMA = 0.2
PINHOLES = StereoRig(*(replace(camera, k1=0.0, k2=0.0, k3=0.0) for camera in RIG.cameras))


def rms(residuals):
    return np.sqrt(np.nanmean(residuals**2))


@pytest.fixture(scope="module")
def train():
    return pictures(boards(12), SIGMA)


@pytest.fixture(scope="module")
def learned(train):
    return calibrate_cameras(train)


def test_boards_held_out_of_true_cameras_leave_their_noise():
    views = pictures(boards(20, 7), SIGMA, 7)
    left_over = held_out_residuals(RIG.cameras, views)
    assert left_over.shape == views.pixels.shape
    # Each board's own pose takes up six of its 216 coordinates.
    assert rms(left_over) == pytest.approx(SIGMA * np.sqrt(1.0 - 6.0 / 216.0), rel=0.03)
    assert np.abs(held_out_residuals(RIG.cameras, pictures(boards(4, 7)))).max() < 1e-6


def test_residuals_of_held_out_boards_are_measured_minus_predicted():
    push = np.zeros((54, 4))
    push[20] = [3.0, 0.0, 0.0, 0.0]
    left_over = held_out_residuals(RIG.cameras, changed(pictures(boards(2, 7)), 1, push))
    assert np.abs(left_over[0]).max() < 1e-6
    assert left_over[1, 20, 0] > 2.5
    assert np.abs(np.delete(left_over[1], 20, axis=0)).max() < 0.5


def test_held_out_boards_may_be_seen_by_one_camera_and_in_part():
    views = pictures(boards(4, 7))
    hidden = unseen(
        views,
        (0, slice(None), RIGHT),
        (1, slice(None), LEFT),
        (2, slice(0, 40), LEFT),
        (3, slice(20, 30)),
    )
    left_over = held_out_residuals(RIG.cameras, hidden)
    assert np.array_equal(np.isnan(left_over), np.isnan(hidden.pixels))
    assert np.nanmax(np.abs(left_over)) < 1e-6
    alone = held_out_residuals((RIG.left,), views.only("left"))
    assert alone.shape == (4, 54, 2)
    assert np.abs(alone).max() < 1e-6


def test_a_board_of_which_a_lens_reaches_one_line_alone_is_beyond_it():
    views = pictures(boards(3, 7))
    line, one_more, two = np.zeros((3, 54), bool)
    line[:5], one_more[:10], two[:11] = True, True, True  # nine are in a row
    for within, reached in ((line, False), (one_more, False), (two, True)):
        alone = views.only("left")
        pixels = np.where(within[:, None], alone.pixels, np.nan)
        assert within_reach((RIG.left,), replace(alone, pixels=pixels)).tolist() == [reached] * 3


def test_a_board_that_no_camera_saw_cannot_be_held_out():
    with pytest.raises(EstimationError, match="no camera saw board 01, or only beyond the fold"):
        held_out_residuals(RIG.cameras, unseen(pictures(boards(3, 7)), (1, slice(None))))


def test_wrong_cameras_are_found_out_by_held_out_boards():
    views = pictures(boards(4, 7), SIGMA)
    wrong = (RIG.left, replace(RIG.right, fx=RIG.right.fx * 1.02))
    assert rms(held_out_residuals(wrong, views)) > 3.0 * SIGMA


def test_cross_validation_foretells_held_out_boards_and_exceeds_the_fit(train, learned):
    crossed = cross_validate_cameras(learned, CameraOptions(), np.ones(12, dtype=bool))
    assert crossed.shape == (12, 54, 4)
    test = pictures(boards(30, 9), SIGMA, 9)
    foretold, held_out = rms(crossed), rms(held_out_residuals(learned.cameras, test))
    assert rms(learned.residuals) < foretold
    assert foretold == pytest.approx(held_out, rel=0.08)


@pytest.mark.slow
def test_boards_that_were_not_believed_take_no_part(train):
    noise = np.random.default_rng(3).normal(0.0, 30.0, (54, 4))
    bad = changed(train, 5, noise)
    inliers = np.arange(12) != 5
    crossed = cross_validate_cameras(calibrate_cameras(bad), CameraOptions(), inliers)
    assert crossed.shape == (11, 54, 4)
    sound = calibrate_cameras(train.select(inliers))
    alone = cross_validate_cameras(sound, CameraOptions(), np.ones(11, dtype=bool))
    assert crossed == pytest.approx(alone, abs=1e-4)


@pytest.mark.parametrize(("count", "usable"), [(0, 0), (1, 0), (3, 0), (4, 4), (5, 5)])
def test_too_few_boards_are_not_cross_validated(learned, count, usable):
    crossed = cross_validate_cameras(learned, CameraOptions(), np.arange(12) < count)
    assert crossed.shape == (usable, 54, 4)


def test_cameras_near_a_solution_end_where_those_from_nothing_do(train, learned):
    few = train.select(np.arange(12) < 9)
    near, alone = calibrate_cameras(few, None, learned), calibrate_cameras(few)
    assert near.cost == pytest.approx(alone.cost, rel=1e-7)
    assert near.converged


def test_one_camera_is_cross_validated_too(train):
    right = calibrate_cameras(train.only("right"))
    crossed = cross_validate_cameras(right, CameraOptions(), np.ones(12, dtype=bool))
    assert crossed.shape == (12, 54, 2)
    assert rms(crossed) == pytest.approx(SIGMA, rel=0.1)


def test_epipolar_distances_are_as_large_as_the_noise():
    X_LG = boards(20, 4, rig=PINHOLES)
    exact = pictures(X_LG, rig=PINHOLES)
    assert np.abs(epipolar_errors(PINHOLES, exact)).max() < 1e-9
    found = epipolar_errors(PINHOLES, pictures(X_LG, SIGMA, rig=PINHOLES))
    assert found.shape == (20, 54, 2)
    # Across a line lies the noise of both cameras, sqrt(2) sigma; the mean of |N(0, 1)| is 0.798.
    expected = np.sqrt(2.0) * SIGMA * np.sqrt(2.0 / np.pi)
    assert found.mean(axis=(0, 1)) == pytest.approx([expected] * 2, rel=0.04)


def test_corners_that_one_camera_missed_have_no_epipolar_distance():
    views = unseen(pictures(boards(2, 4)), (0, 3, LEFT), (1, slice(5, 9), RIGHT))
    found = epipolar_errors(RIG, views)
    missing = np.zeros((2, 54, 2), dtype=bool)
    missing[0, 3] = missing[1, 5:9] = True
    assert np.array_equal(np.isnan(found), missing)
    assert np.nanmax(found) < 1e-8


def test_exact_pixels_rebuild_the_boards_exactly():
    X_LG = boards(5, 6)
    found = Reconstruction.from_views(RIG, pictures(X_LG))
    assert found.views == ("00", "01", "02", "03", "04")
    assert found.p_LQ == pytest.approx(apply(X_LG[:, None], P_GQ), abs=1e-10)
    assert found.errors == pytest.approx(np.zeros((5, 54)), abs=1e-10)
    assert found.scale == pytest.approx(np.ones(5), abs=1e-9)
    assert found.square == pytest.approx(SQUARE)
    assert found.edges.shape == (5 * (8 * 6 + 9 * 5),)
    assert found.edges == pytest.approx(SQUARE, abs=1e-10)
    assert found.edge_sd < 1e-10
    assert found.depths == pytest.approx(np.linalg.norm(found.p_LQ, axis=2))


def test_a_longer_baseline_rebuilds_larger_boards():
    """Scale is the one thing that the pixels do not tell: it comes with the baseline."""
    X_LR = RIG.X_LR.copy()
    X_LR[:3, 3] *= 1.01
    found = Reconstruction.from_views(
        StereoRig(RIG.left, RIG.right.at(X_LR)), pictures(boards(3, 6))
    )
    assert found.scale == pytest.approx(np.full(3, 1.01), abs=1e-9)
    assert found.edges == pytest.approx(1.01 * SQUARE, abs=1e-9)
    assert found.errors.max() > 1e-4  # the rigid fit does not stretch


def test_the_spread_of_the_edges_is_the_one_that_the_pixels_foretell():
    X_LG = boards(30, 6)
    found = Reconstruction.from_views(RIG, pictures(X_LG, SIGMA))
    points = RIG.triangulate(pictures(X_LG).pixels.reshape(-1, 4), SIGMA)
    p, covariance = points.p_WQ.reshape(-1, 6, 9, 3), points.covariance.reshape(-1, 6, 9, 3, 3)
    along = p[:, :, 1:] - p[:, :, :-1], p[:, 1:] - p[:, :-1]
    noise = (
        covariance[:, :, 1:] + covariance[:, :, :-1],
        covariance[:, 1:] + covariance[:, :-1],
    )
    variances = np.concatenate(
        [
            np.einsum("...i,...ij,...j->...", a, c, a).ravel() / SQUARE**2
            for a, c in zip(along, noise, strict=True)
        ]
    )
    # Noise across an edge makes it longer, never shorter: the share that this adds is small here.
    assert found.edge_sd == pytest.approx(np.sqrt(variances.mean()), rel=0.1)
    assert found.edges.mean() > SQUARE
    assert found.scale.mean() == pytest.approx(1.0, abs=1e-3)


def test_boards_that_are_not_whole_in_both_cameras_are_not_rebuilt():
    views = unseen(pictures(boards(4, 6)), (1, 0, LEFT), (3, slice(None), RIGHT))
    assert Reconstruction.from_views(RIG, views).views == ("00", "02")
    nothing = Reconstruction.from_views(RIG, views.select([1, 3]))
    assert nothing.views == ()
    assert nothing.p_LQ.shape == (0, 54, 3)
    assert nothing.errors.shape == (0, 54)
    assert nothing.edges.shape == (0,)


def test_distances_are_those_of_the_corners_that_were_seen():
    r = np.full((2, 3, 4), np.nan)
    r[0, 0] = [3.0, 4.0, 0.0, -1.0]
    r[1, 2, 2:] = [-6.0, 8.0]
    assert sorted(corner_distances(r)) == [1.0, 5.0, 10.0]
    assert len(corner_distances(np.zeros((0, 54, 4)))) == 0


def extrapolated():
    """Return a rational lens far outside of where boards told it, and sights that meet nowhere."""
    k = {
        "k1": -0.65093,
        "k2": -0.9985,
        "k3": -0.060522,
        "k4": -0.4517,
        "k5": -1.3734,
        "k6": 0.074359,
    }
    size, turn = (640, 480), rotation_from_vector(np.array([0.00705, -0.027306, 0.010621]))
    X_LR = transform(turn, [0.071405, -0.0027618, 0.00095384])
    left = Camera(385.06, 385.83, 326.95, 233.72, size, k1=0.019807, k2=-0.010331, lens="fisheye")
    right = Camera(387.35, 379.77, 331.65, 245.9, size, **k, lens="rational", X_WC=X_LR)
    corners = [[69.2, 300.7, -32.8, 328.0], [78.9, 329.5, -20.0, 359.3], [89.5, 356.9, -7.3, 389.1]]
    return StereoRig(left, right), np.array([*corners, [100.4, 382.6, 5.1, 417.7]])


def test_boards_whose_sights_meet_nowhere_are_left_out():
    rig, astray = extrapolated()
    square = 0.02 * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    near = rig.project(square + np.array([0.02, 0.01, 0.4]))
    assert have_rays(rig, astray).all()
    assert not np.isfinite(rig.triangulate(astray).p_WQ).all()
    sizes = ((640, 480),) * 2
    views = BoardViews(square, ("near", "astray"), SIDES, np.stack([near, astray]), sizes)
    found = Reconstruction.from_views(rig, views)
    assert found.views == ("near",)
    assert found.errors.max() < 1e-6
    other = StereoRig(rig.left, replace(rig.right, k1=0.0, k2=0.0, k3=0.0, k4=0.0, k5=0.0, k6=0.0))
    flat = views.select([1])
    assert BoardCheck.from_rigs(rig, other, flat, held_out=True) is None
    (reason,) = BoardCheck.from_rigs(other, rig, flat, held_out=True).reasons
    assert "no ray or no place" in reason


@pytest.mark.parametrize(
    ("longer", "said"), [(1.04, None), (1.06, "6 % too large"), (0.94, "6 % too small")]
)
def test_cameras_that_hardly_photographed_the_boards_are_doubted(longer, said):
    """A baseline that is longer makes everything that is rebuilt larger, as a wrong square does."""
    other = replace(
        RIG.right, X_WC=transform(RIG.right.X_WC[:3, :3], longer * RIG.right.X_WC[:3, 3])
    )
    views = pictures(boards(4, 7))
    doubt = BoardCheck.from_rigs(StereoRig(RIG.left, other), RIG, views, held_out=True).doubt
    assert (doubt is None) == (said is None)
    assert said is None or f"rebuild 4 held-out boards {said}" in doubt

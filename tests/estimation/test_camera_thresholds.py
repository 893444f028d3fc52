"""Each threshold of what is said of cameras and their boards, from both sides."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.cameras import pair_checks
from nico_selfmodel.estimation.cameras.board_accuracy import Reconstruction
from nico_selfmodel.estimation.cameras.board_check import BoardCheck
from nico_selfmodel.estimation.cameras.camera_adjustment import Adjustment
from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_findings import LARGEST_APART, NOTABLE_APART
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.estimation.cameras.lenses.lens_misfit import LensMisfit
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.cameras.stereo_rig import StereoRig

from .simulated_boards import RIG, boards, pictures

_TURN = transform(rotation_from_vector([np.radians(0.3), 0.0, 0.0]), np.zeros(3))
TURNED = StereoRig(RIG.left, RIG.right.at(RIG.right.X_WC @ _TURN))
"""The right camera turned by 0.3 deg."""


@pytest.fixture(scope="module")
def pair():
    views = pictures(boards(16), sigma=0.2)
    found = calibrate_cameras(views.select(np.arange(12)))
    return CameraAssessment.from_calibration(found, None, views.select(np.arange(12, 16)))


@pytest.mark.parametrize(("count", "fails"), [(3, False), (4, True)])
def test_cameras_fail_where_more_than_a_quarter_of_the_boards_are_outliers(pair, count, fails):
    outliers = np.arange(12) < count
    bent = replace(pair, calibration=replace(pair.calibration, outliers=outliers))
    said = any("of the boards contradict" in reason for reason in judge(bent).reasons)
    assert said is fails


@pytest.mark.parametrize(("factor", "fails"), [(2.9, False), (3.1, True)])
def test_cameras_fail_where_few_held_out_boards_fit_far_worse(pair, factor, fails):
    three = pair.left_out_residuals[:3]  # too few to be told by their ranks
    rms = [np.sqrt(np.nanmean(r**2)) for r in (three, pair.test_residuals)]
    worse = pair.test_residuals * (factor * rms[0] / rms[1])
    bent = replace(pair, left_out_residuals=three, test_residuals=worse)
    words = " ".join(judge(bent).reasons)
    assert ("some of them contradict the others" in words) is fails


@pytest.mark.parametrize(
    ("apart", "said"),
    [(NOTABLE_APART - 0.02, ""), (NOTABLE_APART + 0.02, "warnings"),
     (LARGEST_APART - 0.02, "warnings"), (LARGEST_APART + 0.02, "reasons")],
)  # fmt: skip
def test_boards_that_fit_each_camera_half_again_better_than_all_fail(pair, apart, said):
    calibration = pair.calibration
    count = 2.0 * calibration.views.seen.sum(axis=2)
    squares = np.stack([apart**2 * count, count - 6.0], axis=2)
    bent = replace(pair, calibration=replace(calibration, view_alone=squares))
    verdict = judge(bent)
    told = [k for k in ("warnings", "reasons") if "each camera" in " ".join(getattr(verdict, k))]
    assert told == ([said] if said else [])


def test_of_a_sound_pair_boards_fit_alone_as_well_as_together(pair):
    together, alone = np.moveaxis(pair.calibration.view_alone, 2, 0)
    count = 2.0 * pair.calibration.views.seen.sum(axis=2)
    ratio = together / count / (alone / (count - 6.0))
    assert 0.9 < np.sqrt(ratio.mean()) < 1.1


def test_a_board_that_a_wrong_lens_puts_where_two_of_its_motions_look_alike_is_no_error(pair):
    calibration = pair.calibration
    adjustment = Adjustment(
        calibration.views, calibration.cameras, calibration.X_LG, CameraOptions()
    )
    r, by_shared, by_own = adjustment.block.evaluate_parts(adjustment.x)
    by_own = by_own.copy()
    by_own[0, 1] = by_own[0, 0]
    by_own[1, 2] = 0.0
    together, alone = np.moveaxis(adjustment._squares_alone((r, by_shared, by_own)), 2, 0)
    assert np.isfinite(alone).all()
    assert (alone <= together).all()


def test_a_camera_that_is_turned_between_pictures_is_told_with_the_boards_it_spoils():
    X_LG = boards(14)
    before, after = pictures(X_LG, 0.2), pictures(X_LG, 0.2, rig=TURNED)
    half = np.arange(14) >= 9
    pixels = np.where(half[:, None, None], after.pixels, before.pixels)
    found = calibrate_cameras(replace(before, pixels=pixels))
    words = " ".join(judge(CameraAssessment.from_calibration(found)).reasons)
    assert "did the cameras keep still against each other" in words


BENDS = "bends light as its model does not"


@pytest.mark.parametrize(
    ("certain", "share", "size", "fails", "warns"),
    [
        (9.0, 0.6, 0.2, True, False),
        (7.9, 0.6, 0.2, False, False),
        (8.1, 0.6, 0.2, True, False),
        (9.0, 0.49, 0.2, False, True),
        (9.0, 0.51, 0.2, True, False),
        (9.0, 0.6, 0.095, False, True),
        (9.0, 0.6, 0.105, True, False),
        (9.0, 0.19, 0.2, False, False),
        (9.0, 0.21, 0.2, False, True),
        (9.0, 0.3, 0.048, False, False),
        (9.0, 0.3, 0.052, False, True),
    ],
)
def test_a_misfit_of_a_lens_fails_or_warns_by_its_size(pair, certain, share, size, fails, warns):
    misfit = LensMisfit("left", certain, share, size, ())
    verdict = judge(replace(pair, misfits=(misfit,)))
    assert any(BENDS in reason for reason in verdict.reasons) is fails
    assert any(BENDS in warning for warning in verdict.warnings) is warns


@pytest.mark.parametrize("louder", [1.0, 2.0])
@pytest.mark.parametrize(("times", "fails"), [(0.98, False), (1.02, True)])
def test_a_corner_six_pixels_or_twenty_sigmas_off_is_none(pair, louder, times, fails):
    calibration = replace(pair.calibration, residuals=louder * pair.calibration.residuals)
    sigma = louder * float(np.median(pair.train_distances)) / np.sqrt(2.0 * np.log(2.0))
    off = pair.test_residuals.copy()
    off[0, 0] = [times * max(6.0, 20.0 * sigma), 0.0, 0.0, 0.0]
    assert (20.0 * sigma < 6.0) == (louder == 1.0)
    words = " ".join(judge(replace(pair, calibration=calibration, test_residuals=off)).reasons)
    assert ("a corner of held-out board" in words) is fails


@pytest.mark.parametrize(("reach", "warns"), [(0.73, True), (0.77, False)])
def test_corners_that_end_at_three_quarters_of_the_way_warn(pair, reach, warns):
    views = pair.calibration.views
    half = 0.5 * (np.array(views.image_sizes[0]) - 1.0)
    off = views.pixels.reshape(-1, 2, 2) - half
    off *= reach * np.linalg.norm(half) / np.linalg.norm(off, axis=2).max(axis=0)[:, None]
    pixels = (half + off).reshape(views.pixels.shape)
    calibration = replace(pair.calibration, views=replace(views, pixels=pixels))
    warnings = replace(pair, calibration=calibration).warnings
    assert any("its distortion is extrapolated" in warning for warning in warnings) is warns


@pytest.fixture(scope="module")
def rebuilt():
    found = Reconstruction.from_views(RIG, pictures(boards(6), sigma=0.2))
    return replace(found, scale=np.ones(6))


@pytest.mark.parametrize(("wider", "worse"), [(1.09, False), (1.11, True)])
def test_edges_that_scatter_a_tenth_more_are_worse(rebuilt, wider, worse):
    mean = rebuilt.edges.mean()
    after = replace(rebuilt, edges=mean + wider * (rebuilt.edges - mean))
    assert bool(BoardCheck(rebuilt, after, held_out=True).reasons) is worse


@pytest.mark.parametrize(("larger", "worse"), [(1.9e-3, False), (2.1e-3, True)])
def test_boards_a_five_hundredth_larger_are_worse(rebuilt, larger, worse):
    after = replace(rebuilt, scale=np.full(6, 1.0 + larger))
    assert bool(BoardCheck(rebuilt, after, held_out=True).reasons) is worse


@pytest.mark.parametrize(("larger", "foreign"), [(0.049, False), (0.051, True)])
def test_boards_a_twentieth_too_large_are_others(rebuilt, larger, foreign):
    before = replace(rebuilt, scale=np.full(6, 1.0 + larger))
    assert (BoardCheck(before, rebuilt, held_out=True).doubt is not None) is foreign


@pytest.mark.parametrize(
    ("alone", "error", "refused"),
    [(0.2, 1.45, False), (0.2, 1.55, True), (0.4, 1.95, False), (0.4, 2.05, True)],
)
def test_a_pair_lies_on_its_epipolar_lines(pair, monkeypatch, alone, error, refused):
    monkeypatch.setattr(pair_checks, "_epipolar_errors", lambda rig, views: np.array([[error] * 2]))
    if refused:
        with pytest.raises(EstimationError, match="no rigid pair"):
            pair_checks.check_pair(pair.calibration, SIDES, alone)
    else:
        pair_checks.check_pair(pair.calibration, SIDES, alone)


@pytest.mark.parametrize(
    ("alone", "error", "refused"),
    [(0.0, 7.9, False), (0.0, 8.1, True), (2.0, 17.9, False), (2.0, 18.1, True)],
)
def test_a_start_lies_about_its_epipolar_lines(pair, monkeypatch, alone, error, refused):
    monkeypatch.setattr(pair_checks, "_epipolar_errors", lambda rig, views: np.array([[error] * 2]))
    if refused:
        with pytest.raises(EstimationError, match="no rigid pair"):
            pair_checks.check_start(RIG, pair.calibration.views, alone)
    else:
        pair_checks.check_start(RIG, pair.calibration.views, alone)


@pytest.mark.parametrize(("share", "one"), [(0.9e-3, True), (1.1e-3, False)])
def test_cameras_a_thousandth_of_the_way_apart_are_one(pair, monkeypatch, share, one):
    monkeypatch.setattr(pair_checks, "_epipolar_errors", lambda rig, views: np.zeros((1, 2)))
    left, right = pair.calibration.cameras
    depth = np.median((left.X_CW @ pair.calibration.X_LG)[:, 2, 3])
    X_WR = left.X_WC.copy()
    X_WR[0, 3] += share * depth
    calibration = replace(pair.calibration, cameras=(left, right.at(X_WR)))
    if one:
        with pytest.raises(EstimationError, match="stand at one place"):
            pair_checks.check_pair(calibration, SIDES, 0.2)
    else:
        pair_checks.check_pair(calibration, SIDES, 0.2)

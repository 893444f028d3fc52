"""Lenses that bend light as their model does not are told by what residuals have in common."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.estimation.cameras.lenses.lens_choice import lens_of
from nico_selfmodel.estimation.cameras.lenses.lens_misfit import lens_misfits
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.model.cameras.camera import Camera

from ..slow_rest import slow_rest
from .real_boards import stereo_chessboard
from .simulated_boards import boards, pictures

SIZE = (640, 480)
GRID = 0.025 * np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0)), axis=-1).reshape(-1, 2)
BOARD = np.column_stack([GRID, np.zeros(len(GRID))])
ORIGIN = np.zeros(3)
NO_K3 = CameraOptions.from_text(pin=["k3=0"])


def fisheye(focal, lens=(0.02, -0.01, 0.003, -0.001)):
    """Return OpenCV's equidistant lens."""
    K = np.array([[focal, 0.0, 320.0], [0.0, focal, 240.0], [0.0, 0.0, 1.0]])
    return lambda p: cv2.fisheye.projectPoints(p[:, None], ORIGIN, ORIGIN, K, np.array(lens))[0][
        :, 0
    ]


def brown(focal, lens=(-0.25, 0.08, 0.0, 0.0, -0.01)):
    """Return OpenCV's pinhole lens: k1, k2, p1, p2, k3."""
    K = np.array([[focal, 0.0, 320.0], [0.0, focal, 240.0], [0.0, 0.0, 1.0]])
    return lambda p: cv2.projectPoints(p, ORIGIN, ORIGIN, K, np.array(lens))[0][:, 0]


def seen_by(lens, seed, *, count=16, pair=False, near=0.1, far=0.35, aside=1.2, noise=0.1):
    """Return boards that one camera, or two 60 mm apart, see whole."""
    rng, found = np.random.default_rng(seed), []
    while len(found) < count:
        turn, _ = cv2.Rodrigues(rng.normal(0.0, 0.35, 3))
        z = rng.uniform(near, far)
        middle = np.array([*(rng.uniform(-aside, aside, 2) * z), z])
        p = (BOARD - BOARD.mean(axis=0)) @ turn.T + middle
        if p[:, 2].min() < 0.03:
            continue
        cameras = [lens(p), lens(p - [0.06, 0.0, 0.0])] if pair else [lens(p)]
        if all((e > 8).all() and (e < np.array(SIZE) - 8).all() for e in cameras):
            found.append(np.hstack([e + rng.normal(0.0, noise, e.shape) for e in cameras]))
    names = tuple(f"{i:02d}" for i in range(count))
    cameras = ("left", "right") if pair else ("left",)
    return BoardViews(BOARD, names, cameras, np.array(found), (SIZE,) * len(cameras))


def judged(views, options=None, seed=0):
    options = options or CameraOptions()
    train, test = views.split(0.25, seed)
    found = calibrate_cameras(train, options)
    return judge(CameraAssessment.from_calibration(found, options, test))


@pytest.mark.parametrize("pair", slow_rest([False, True]))
@pytest.mark.parametrize("options", slow_rest([None, NO_K3]), ids=["default", "k3 held"])
@pytest.mark.parametrize("focal", slow_rest([280.0, 230.0]))
@pytest.mark.parametrize("seed", slow_rest([0, 1]))
def test_a_fisheye_never_passes_and_is_named(seed, focal, options, pair):
    verdict = judged(seen_by(fisheye(focal), seed, pair=pair), options)
    assert verdict.status == "FAIL"
    assert "bends light as its model does not" in verdict.reasons[0]
    assert "fisheye" in verdict.reasons[0] or "let `left.k3` move" in verdict.reasons[0]


@pytest.mark.parametrize("pair", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_a_lens_that_is_as_its_model_has_no_misfit(seed, pair):
    rng = np.random.default_rng(seed)
    lens = brown(rng.uniform(400, 800), (rng.uniform(-0.4, 0.1), rng.uniform(0, 0.1), 0, 0, 0))
    views = seen_by(
        lens, seed, pair=pair, near=0.2, far=0.6, aside=0.8, noise=rng.uniform(0.05, 0.3)
    )
    found = calibrate_cameras(views)
    for misfit in lens_misfits(found):
        assert not misfit.is_certain
        assert misfit.share < 0.1


@pytest.mark.slow
def test_the_score_of_the_test_is_standard_where_there_is_nothing_to_find():
    scores = []
    for seed in range(30):
        views = seen_by(brown(500.0), 100 + seed, count=8, near=0.2, far=0.6, aside=0.7)
        scores += [misfit.certain for misfit in lens_misfits(calibrate_cameras(views))]
    assert abs(np.mean(scores)) < 0.6
    assert 0.6 < np.std(scores) < 1.6


@pytest.mark.slow
def test_a_term_that_is_held_and_would_cure_it_is_named():
    lens = brown(500.0, (-0.25, 0.08, 0.006, -0.005, 0.0))
    views = seen_by(lens, 1, near=0.2, far=0.6, aside=0.8)
    (misfit,) = lens_misfits(calibrate_cameras(views))
    assert misfit.is_certain
    assert misfit.held == ("left.p1", "left.p2")
    verdict = judged(views)
    assert verdict.status == "FAIL"
    assert "let `left.p1` and `left.p2` move" in verdict.reasons[0]
    assert judged(views, CameraOptions(tangential=True)).status == "PASS"


def test_a_slight_misfit_is_mentioned_and_does_not_fail():
    lens = brown(500.0, (-0.25, 0.08, 0.004, -0.003, 0.0))
    views = seen_by(lens, 2, near=0.2, far=0.6, aside=0.8, noise=0.12)
    train, test = views.split(0.25, 0)
    assessment = CameraAssessment.from_calibration(calibrate_cameras(train), None, test)
    assert judge(assessment).status == "PASS"
    assert any("let `left.p1` and `left.p2` move" in words for words in assessment.warnings)


@pytest.mark.slow
@pytest.mark.real_data
def test_real_lenses_pass_as_they_are(real_data_folder):
    found = stereo_chessboard(real_data_folder)
    for options in (CameraOptions(), CameraOptions(tangential=True), NO_K3):
        for misfit in lens_misfits(calibrate_cameras(found, options)):
            assert misfit.share < 0.2
    train, test = found.split(0.2, 0)
    for options in (CameraOptions(), CameraOptions(tangential=True)):
        calibration = calibrate_cameras(train, options)
        verdict = judge(CameraAssessment.from_calibration(calibration, options, test))
        assert verdict.status == "PASS"


# ------------------------------------------------------------------ boards that are none


@pytest.fixture(scope="module")
def good():
    return pictures(boards(16, 5), 0.15)


def with_stray_corners(views, share, largest, seed=0):
    """Return views in a share of which a few corners are off, as a marker beside them has it."""
    rng = np.random.default_rng(seed)
    pixels = views.pixels.copy()
    for view in rng.permutation(len(views))[: round(share * len(views))]:
        rows = rng.choice(pixels.shape[1], 6, replace=False)
        pixels[view, rows, :2] += rng.uniform(-largest, largest, (6, 2))
        pixels[view, rows[0], :2] += largest
    return replace(views, pixels=pixels)


@pytest.mark.slow
def test_a_corner_that_is_none_does_not_pass(good):
    spoilt = with_stray_corners(good, 0.3, 12.0)
    for seed in range(2):
        verdict = judged(spoilt, seed=seed)
        assert verdict.status == "FAIL"
        assert any("px off, typical are" in reason for reason in verdict.reasons)
    assert judged(good).status == "PASS"


@pytest.mark.slow
def test_held_out_boards_that_contradict_the_rest_do_not_pass(good):
    train, test = good.split(0.25, 0)
    noise = np.random.default_rng(0).normal(0.0, 1.2, test.pixels.shape)
    spoilt = replace(test, pixels=test.pixels + noise)
    found = calibrate_cameras(train)
    for held_out, status in ((test, "PASS"), (spoilt, "FAIL")):
        assessment = CameraAssessment.from_calibration(found, None, held_out)
        assert judge(assessment).status == status


# ------------------------------------------------------------------ terms that fold the image


@pytest.mark.slow
def test_a_term_that_folds_the_image_by_chance_is_a_warning():
    """Few boards in the middle of the image: what k3 does in its corners is chance."""
    folded = 0
    for seed in range(12):
        lens = brown(500.0, (-0.3, 0.1, 0.0, 0.0, 0.0))
        views = seen_by(lens, seed, count=9, near=0.3, far=0.6, aside=0.3, noise=0.25)
        train, test = views.split(0.25, 0)
        found = calibrate_cameras(train)
        assessment = CameraAssessment.from_calibration(found, None, test)
        verdict = judge(assessment)
        assert not any("not monotone" in reason for reason in verdict.reasons)
        if any("not monotone" in words for words in assessment.warnings):
            folded += 1
            assert "left.k3" in found.names
    assert folded >= 2


def test_a_term_that_folds_the_image_and_is_known_fails():
    known = Camera(500.0, 500.0, 320.0, 240.0, SIZE, k1=-0.5, k2=0.0, k3=-0.3)
    views = seen_by(known.project, 0, near=0.2, far=0.6, aside=0.35, noise=0.02)
    found = calibrate_cameras(views)
    verdict = judge(CameraAssessment.from_calibration(found))
    assert verdict.status == "FAIL"
    assert "not monotone" in " ".join(verdict.reasons)


def test_pictures_of_another_zoom_are_asked_for_where_the_boards_have_chosen_the_lens():
    found = calibrate_cameras(seen_by(fisheye(230.0), 0))
    for by_boards, advice in (
        (False, "let the boards choose with --lens auto"),
        (True, "--lens auto found no better lens: look for pictures of another zoom or focus"),
    ):
        verdict = judge(CameraAssessment.from_calibration(found, lens_by_boards=by_boards))
        (said,) = [words for words in verdict.reasons if "bends light" in words]
        assert advice in said
        assert ("another zoom" in said) == by_boards


def test_a_lens_that_the_boards_chose_is_known_to_be_their_choice():
    views = seen_by(brown(500.0), 3, count=8, near=0.3, far=0.6, aside=0.35)
    for lens in ("auto", "polynomial"):
        assert lens_of(views, CameraOptions(lens=lens)).by_boards == (lens == "auto")

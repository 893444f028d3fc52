"""Boards that are bent or printed too long, cameras that moved: what no calibration has."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.estimation.cameras.lacks import rig_lacks
from nico_selfmodel.estimation.cameras.lacks.effect_test import EffectTest
from nico_selfmodel.estimation.cameras.lacks.rig_lacks import (
    ASIDE,
    BEND,
    CHANCE,
    LARGE,
    MOVED,
    NOTABLE,
    SHARE,
    SKEW,
    STRETCH,
    SURE,
    ZOOMED,
    Lack,
    is_told,
    lacks_of,
)
from nico_selfmodel.estimation.cameras.lenses.lens_misfit import LensMisfit
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.cameras.stereo_rig import StereoRig

from ..slow_rest import slow_rest
from .real_boards import stereo_chessboard
from .simulated_boards import P_GQ, RIG, SIZE, boards, pictures

MIDDLE = P_GQ.mean(axis=0)
SIGMA = 0.2
SEEDS = slow_rest(range(4), 1)


def seen(X_LG, seed, p_GQ=P_GQ, rig=RIG, sigma=SIGMA):
    """Return what the cameras see of boards of another shape than is thought, with noise."""
    pixels = np.array([rig.project(apply(X, p_GQ)) for X in X_LG])
    noise = np.random.default_rng((seed, 5)).normal(0.0, sigma, pixels.shape)
    names = tuple(f"{v:02d}" for v in range(len(X_LG)))
    return BoardViews(P_GQ, names, ("left", "right"), pixels + noise, (SIZE, SIZE))


def joined(before, after, later):
    """Return some views before and others after something changed."""
    return replace(before, pixels=np.where(later[:, None, None], after.pixels, before.pixels))


def turned(degrees, about=(1.0, 0.0, 0.0), shift=(0.0, 0.0, 0.0)):
    """Return the rig with its right camera moved."""
    X = transform(rotation_from_vector(np.radians(degrees) * np.array(about)), np.array(shift))
    return StereoRig(RIG.left, RIG.right.at(RIG.right.X_WC @ X))


def zoomed(factor):
    """Return the rig with another focal length of its left camera."""
    left = RIG.left
    return StereoRig(replace(left, fx=factor * left.fx, fy=factor * left.fy), RIG.right)


def bent(way):
    """Return corners of a board that is bent along y, so far out of its plane."""
    y = (P_GQ[:, 1] - MIDDLE[1]) / np.ptp(P_GQ[:, 1]) * 2.0
    return P_GQ + np.outer(way * (1.0 - y**2), [0.0, 0.0, 1.0])


def of(views, **options):
    """Return what is found of views, and the verdict's reasons."""
    found = calibrate_cameras(views, CameraOptions(**options))
    assessment = CameraAssessment.from_calibration(found, CameraOptions(**options))
    return assessment.lacks, judge(assessment)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("one", [True, False])
def test_a_board_that_is_printed_longer_one_way_fails_with_the_share(seed, one):
    views = seen(boards(16, seed), seed, P_GQ * [1.02, 1.0, 1.0])
    (lack,), verdict = of(views.only("left") if one else views)
    assert lack.kind == STRETCH
    assert lack.amount == pytest.approx(0.02, abs=0.003)
    assert 0.0 < lack.sigma < 0.003
    assert abs(lack.amount - 0.02) < 4.0 * lack.sigma + 2e-4  # to first order in the share
    assert "the board is longer in x than in y by" in verdict.reasons[0]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_board_whose_rows_are_not_square_to_its_columns_fails_with_the_angle(seed):
    slanted = P_GQ + np.outer(P_GQ[:, 1], [0.02, 0.0, 0.0])
    lacks, verdict = of(seen(boards(16, seed), seed, slanted))
    assert lacks[0].kind == SKEW
    assert lacks[0].amount == pytest.approx(0.02, abs=0.002)
    assert "from a right angle" in verdict.reasons[0]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("one", [True, False])
def test_a_bent_board_fails_with_how_far_it_is_out_of_its_plane(seed, one):
    views = seen(boards(16, seed), seed, bent(0.003))
    (lack, *_), verdict = of(views.only("left") if one else views)
    assert lack.kind == BEND
    assert lack.amount == pytest.approx(0.003, rel=0.15)
    assert "the board is bent" in verdict.reasons[0]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_camera_that_is_bumped_half_way_fails_with_view_and_angle(seed):
    X_LG, later = boards(16, seed), np.arange(16) >= 9
    views = joined(seen(X_LG, seed), seen(X_LG, seed, rig=turned(0.2)), later)
    (lack, *_), verdict = of(views)
    assert (lack.kind, lack.camera, lack.view) == (MOVED, "right", "09")
    assert np.degrees(lack.turn) == pytest.approx(0.2, abs=0.04)
    assert "the right camera moved against the others before view 09" in verdict.reasons[0]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_camera_that_zooms_half_way_fails_with_view_and_share(seed):
    X_LG, later = boards(16, seed), np.arange(16) >= 7
    views = joined(seen(X_LG, seed), seen(X_LG, seed, rig=zoomed(1.03)), later)
    (lack, *_), verdict = of(views)
    assert (lack.kind, lack.camera, lack.view) == (ZOOMED, "left", "07")
    assert lack.amount == pytest.approx(0.03, abs=0.005)
    assert "the focal length of the left camera is" in verdict.reasons[0]
    assert "longer from view 07 on" in verdict.reasons[0]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_pair_of_pictures_that_is_out_of_step_is_named(seed):
    X_LG = boards(16, seed)
    moved = X_LG.copy()
    moved[5, :3, 3] += [0.005, 0.0, 0.0]
    moved[5, :3, :3] = rotation_from_vector([0.0, 0.01, 0.0]) @ moved[5, :3, :3]
    both = seen(X_LG, seed).pixels.copy()
    both[:, :, 2:] = seen(moved, seed).pixels[:, :, 2:]
    (lack, *_), verdict = of(replace(seen(X_LG, seed), pixels=both))
    assert (lack.kind, lack.camera, lack.view) == (ASIDE, "right", "05")
    assert lack.amount == pytest.approx(0.005, abs=0.0015)
    assert np.degrees(lack.turn) == pytest.approx(np.degrees(0.01), abs=0.25)
    told = verdict.reasons if lack.fails else verdict.warnings
    assert any("in view 05 the right camera saw the board" in words for words in told)
    assert lack.off > 4.0


def patterned(views, size, seed):
    """Return views whose corners err alike over each picture, each time in another way."""
    rng, pixels = np.random.default_rng((seed, 9)), views.pixels.copy()
    for row in range(len(views)):
        for camera in range(len(views.cameras)):
            own = slice(2 * camera, 2 * camera + 2)
            x, y = ((pixels[row, :, own] / views.image_sizes[camera]) * 2.0 - 1.0).T
            fields = [x * x, x * y, y * y, x**3, y**3, np.sin(5.0 * x), np.sin(5.0 * y)]
            pixels[row, :, own] += size * np.stack(fields, axis=1) @ rng.normal(size=(7, 2))
    return replace(views, pixels=pixels)


@pytest.mark.parametrize("seed", slow_rest(range(20, 30), 2))
@pytest.mark.parametrize("pattern", [0.0, 0.1])
def test_sound_boards_and_cameras_are_blamed_for_nothing(seed, pattern):
    views = patterned(pictures(boards(14, seed), SIGMA, seed), pattern, seed)
    for some in (views, views.only("left"), views.select(np.arange(7))):
        assert lacks_of(calibrate_cameras(some)) == ()


def test_boards_without_noise_and_few_boards_are_blamed_for_nothing():
    exact = calibrate_cameras(pictures(boards(8)))
    assert lacks_of(exact) == ()
    assert lacks_of(replace(exact, residuals=0.0 * exact.residuals)) == ()
    assert lacks_of(calibrate_cameras(pictures(boards(3), SIGMA))) == ()


def test_a_view_that_is_an_outlier_blames_nobody():
    views = pictures(boards(14), SIGMA)
    found = calibrate_cameras(
        replace(
            views, pixels=views.pixels + 30.0 * (np.arange(14) == 6)[:, None, None] * P_GQ[:, :1]
        )
    )
    outliers = found.outliers | (np.arange(14) == 6)
    assert lacks_of(replace(found, outliers=outliers)) == ()


@pytest.mark.real_data
def test_real_pairs_are_not_failed_by_their_board(real_data_folder):
    views = stereo_chessboard(real_data_folder)
    for some in (views, views.only("left"), views.only("right")):
        assert not any(lack.fails for lack in lacks_of(calibrate_cameras(some)))


@pytest.fixture(scope="module")
def pair():
    found = calibrate_cameras(pictures(boards(12), SIGMA))
    return CameraAssessment.from_calibration(found)


def moved_by(pair, kind, camera, step):
    """Return pixels of all corners by what an effect is defined to do. Shape (V, P, 4)."""
    found, turn = pair.calibration, np.eye(3)
    p_GQ, shift, X_LG = P_GQ.copy(), np.zeros(3), found.X_LG
    rig = [camera.at(found.cameras[0].X_CW @ camera.X_WC) for camera in found.cameras]
    x, y, _ = (P_GQ - 0.5 * (P_GQ.max(axis=0) + P_GQ.min(axis=0))).T
    if kind == "stretch":
        p_GQ += 0.5 * step * np.stack([x, -y, 0.0 * x], axis=1)
    if kind == "skew":
        p_GQ += 0.5 * step * np.stack([y, x, 0.0 * x], axis=1)
    if kind == "bend":
        p_GQ[:, 2] += step * x * y / np.ptp(x) ** 2 * 4.0
    if kind == "turn":
        turn = rotation_from_vector([0.0, step, 0.0])
    if kind == "shift":
        shift = np.array([0.0, 0.0, step])
    if kind == "zoom":
        own = rig[camera]
        rig[camera] = replace(own, fx=own.fx * (1.0 + step), fy=own.fy * (1.0 + step))
    seen_by = []
    for e, own in enumerate(rig):
        p_LQ = np.array([apply(X, p_GQ) for X in X_LG])
        if e == camera:
            c = own.X_WC[:3, 3]
            p_LQ = (p_LQ - c) @ turn.T + c + shift
        seen_by.append(own.project(p_LQ.reshape(-1, 3)).reshape(len(X_LG), -1, 2))
    return np.concatenate(seen_by, axis=2)


@pytest.mark.parametrize("camera", [0, 1])
@pytest.mark.parametrize(
    ("kind", "name", "row"),
    [("stretch", "stretch", 0), ("skew", "skew", 0), ("bend", "bend", 1),
     ("turn", "camera_moved", 1), ("shift", "camera_moved", 5), ("zoom", "camera_zoomed", 0)],
)  # fmt: skip
def test_columns_are_what_an_effect_moves_pixels_by(pair, kind, name, row, camera):
    columns = getattr(EffectTest(pair.calibration).columns, name)
    told = (columns(camera) if name.startswith("camera") else columns())[:, row]
    step = 1e-6
    slope = (moved_by(pair, kind, camera, step) - moved_by(pair, kind, camera, -step)) / (
        2.0 * step
    )
    expected = np.transpose(slope.reshape(12, -1, 2, 2), (0, 2, 3, 1)).reshape(12, -1)
    assert np.abs(told - expected).max() < 1e-6 * np.abs(expected).max()


BOARD = Lack(STRETCH, 0.02, 0.001, 10.0, "left.fx", 0.1, 0.0)


@pytest.mark.parametrize(
    ("change", "fails"),
    [({"off": LARGE - 0.01}, False), ({"off": LARGE + 0.01}, True),
     ({"chance": 1.01 * SURE}, False), ({"chance": 0.99 * SURE}, True)],
)  # fmt: skip
def test_an_effect_fails_where_it_is_sure_and_large_and_warns_below(pair, change, fails):
    verdict = judge(replace(pair, lacks=(replace(BOARD, **change),)))
    words = "the board is longer in x"
    assert any(words in reason for reason in verdict.reasons) is fails
    assert any(words in warning for warning in verdict.warnings) is not fails
    assert (LARGE, SURE) == (5.0, 1e-4)


@pytest.mark.parametrize(
    ("change", "told"),
    [({}, True), ({"chance": 1.01 * CHANCE}, False), ({"chance": 0.99 * CHANCE}, True),
     ({"off": NOTABLE - 0.01}, False), ({"off": NOTABLE + 0.01}, True),
     ({"share": SHARE - 1e-4}, False), ({"share": SHARE + 1e-4}, True)],
)  # fmt: skip
def test_an_effect_is_told_where_it_is_certain_and_notable(pair, change, told):
    test = EffectTest(pair.calibration)
    score = test.of(test.columns.stretch())
    sure = replace(score, chance=0.0, off=10.0, share=0.5)
    assert not is_told(score)
    assert is_told(replace(sure, **change)) is told
    assert (NOTABLE, SHARE, CHANCE) == (3.0, 0.01, 1e-3)


def test_a_board_of_another_shape_is_told_in_place_of_the_lens_that_it_looks_like(pair):
    misfit = LensMisfit("left", 20.0, 0.6, 0.3, ())
    for kind, hidden in ((BEND, True), (ZOOMED, True), (MOVED, False)):
        lack = replace(BOARD, kind=kind, camera="left", view="03")
        for off, fails in ((10.0, True), (4.5, False)):
            told = judge(replace(pair, misfits=(misfit,), lacks=(replace(lack, off=off),)))
            lens = any("bends light as its model does not" in r for r in told.reasons)
            assert lens is not (hidden and fails)


def test_a_lens_that_is_no_such_lens_is_not_blamed_on_the_board(monkeypatch, pair):
    fields = np.zeros((12, 1, 2 * 2 * len(P_GQ)))
    score = EffectTest(pair.calibration).of(EffectTest(pair.calibration).columns.stretch())
    strong = replace(score, chance=0.0, off=9.0, share=0.3, squares=50.0)
    explained = {True: 60.0, False: 40.0}
    for lens_first, squares in explained.items():
        seen_so_far = []

        def found(test, columns, places=1, seen_so_far=seen_so_far):
            seen_so_far.append(test)
            return strong if len(seen_so_far) <= 3 else None

        monkeypatch.setattr(EffectTest, "of", found)
        monkeypatch.setattr(EffectTest, "squares_of", lambda test, columns, s=squares: s)
        lacks = rig_lacks.lacks_of(pair.calibration, None, (fields,))
        assert (lacks == ()) is lens_first

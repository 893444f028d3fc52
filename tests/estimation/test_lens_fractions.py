"""Coefficients of rational lenses: a sigma where boards tell each one, none where all alone."""

import numpy as np
import pytest

from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.estimation.cameras.camera_result import camera_result
from nico_selfmodel.estimation.cameras.lenses.lens_fractions import with_told_sigmas
from nico_selfmodel.estimation.judging import judge

from ..slow_rest import slow_rest
from .wide_boards import wide_camera, wide_views

RATIONAL = CameraOptions(lens="rational")


def boards(seed):
    rng = np.random.default_rng((seed, 5))
    camera = wide_camera("rational", rng)
    return camera, wide_views((camera,), rng), wide_views((camera,), rng, 8)


def told(seed, options=RATIONAL):
    camera, views, _ = boards(seed)
    return camera, with_told_sigmas(calibrate_cameras(views, options), options)


def scores(camera, found):
    """Return errors over sigma of the parameters that have one, by name."""
    sigma = dict(zip(found.names, found.uncertainty.sigma, strict=True))
    truth, learned = camera.named_values, found.cameras[0].named_values
    return {
        name: (learned[name] - truth[name]) / sigma[f"left.{name}"]
        for name in truth
        if np.isfinite(sigma.get(f"left.{name}", np.inf))
    }


def test_coefficients_that_a_pole_and_a_zero_could_move_have_no_sigma():
    camera, found = told(2117)
    plain = calibrate_cameras(boards(2117)[1], RATIONAL).uncertainty
    k = [i for i, name in enumerate(found.names) if ".k" in name]
    nearest = np.array([camera.named_values[found.names[i][5:]] for i in k])
    learned = np.array([found.cameras[0].named_values[found.names[i][5:]] for i in k])
    assert np.abs((learned - nearest) / plain.sigma[k]).max() > 4.0
    assert np.isinf(found.uncertainty.sigma[k]).all()
    assert set(scores(camera, found)) == {"fx", "fy", "cx", "cy"}
    # What they tell together stays.
    np.testing.assert_array_equal(found.uncertainty.covariance, plain.covariance)
    assert found.uncertainty.unobservable == ()


@pytest.mark.parametrize(("seed", "single"), [(2016, False), (2118, True)])
def test_they_have_one_from_a_likelihood_of_25_on(seed, single):
    """A fraction of a degree less is less likely by e^24.0 and by e^25.3."""
    camera, found = told(seed)
    assert ("k4" in scores(camera, found)) == single


@pytest.mark.slow
def test_other_lenses_and_fractions_without_room_for_a_pair_keep_their_sigmas():
    _, views, _ = boards(2117)
    for options in (
        CameraOptions(lens="fisheye"),
        CameraOptions(lens="rational", pinned={"k4": 0.0, "k5": 0.0, "k6": 0.0}),
        CameraOptions(lens="rational", pinned={"k1": 0.7, "k2": 0.12, "k3": 0.002}),
    ):
        plain = calibrate_cameras(views, options)
        assert with_told_sigmas(plain, options) is plain


def test_a_fraction_of_fewer_terms_is_held_against_one_of_fewer_still():
    options = CameraOptions(lens="rational", pinned={"k3": 0.0, "k6": 0.0})
    camera, found = told(2117, options)
    assert set(scores(camera, found)) >= {"k1", "k2", "k4", "k5"}


def test_the_result_says_so_and_passes():
    _, views, test = boards(2117)
    found = calibrate_cameras(views, RATIONAL)
    assessment = CameraAssessment.from_calibration(found, RATIONAL, test)
    verdict = judge(assessment)
    assert verdict.status == "PASS"
    (said,) = [words for words in verdict.warnings if "stand for each other" in words]
    assert "k1 to k6 of the left camera's rational lens" in said
    table = camera_result(assessment).parameters
    assert table["left.k4"].sigma is None
    assert table["left.fx"].sigma is not None


@pytest.mark.slow
@pytest.mark.parametrize("seeds", slow_rest([range(4000, 4004), range(4100, 4140)], plain=1))
def test_truth_lies_within_sigma(seeds):
    found = np.concatenate([list(scores(*told(seed)).values()) for seed in seeds])
    assert np.abs(found).max() < 4.5
    assert np.sqrt(np.mean(found**2)) < 1.25
    assert np.mean(np.abs(found) < 1.0) > 0.55

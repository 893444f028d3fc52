"""Tracker noise and joint noise, told apart by what they do to four pixels."""

import numpy as np
import pytest

from nico_selfmodel.estimation.noise.hand_noise import HandNoise
from nico_selfmodel.estimation.noise.noise_variances import most_likely_noise
from nico_selfmodel.estimation.noise.pose_groups import PoseGroups
from nico_selfmodel.estimation.noise.pose_noise import PoseNoise
from nico_selfmodel.estimation.noise.variance_components import LinearResiduals

from ..slow_rest import slow_rest

NOISE = HandNoise(0.3, 0.005)


def drawn(count=2000, noise=NOISE, seed=0, hidden=0):
    rng = np.random.default_rng(seed)
    slopes = 300.0 * rng.normal(size=(count, 4, 4))
    # Both cameras see the hand move alike, but for a small disparity.
    slopes[:, 2:] = slopes[:, :2] + 20.0 * rng.normal(size=(count, 2, 4))
    play = noise.joint_sigma * rng.normal(size=(count, 4))
    r = (slopes @ play[:, :, None])[:, :, 0] + noise.sensor_sigma * rng.normal(size=(count, 4))
    seen = np.ones((count, 4), dtype=bool)
    seen[:hidden, 2:] = False
    return np.where(seen, r, 0.0), slopes, seen


def searched(r, slopes, seen):
    groups = PoseGroups(np.arange(len(r)), np.ones(len(r), dtype=bool), 4)
    data = LinearResiduals(groups, groups.gather(r), np.zeros((r.size, 1)), slopes)
    return most_likely_noise(data, PoseNoise(0.5, np.full(4, 0.003)), np.zeros(4))


@pytest.mark.parametrize("noise", slow_rest([NOISE, HandNoise(2.0, 0.005)]))
def test_the_error_bars_of_both_are_those_of_many_recordings(noise):
    found = []
    for seed in range(120):
        best = searched(*drawn(count=60, noise=noise, seed=seed))
        found.append([best.sensor_sigma, best.joint_sigma[0]])
    _, slopes, seen = drawn(count=60, noise=noise)
    assert np.std(found, axis=0) == pytest.approx(noise.sigmas(slopes, seen), rel=0.25)


def test_without_play_nothing_tells_how_much_there_is():
    _, slopes, seen = drawn(count=60)
    sensor, joint = HandNoise(0.5, 0.0).sigmas(slopes, seen)
    assert sensor == pytest.approx(0.5 / np.sqrt(2.0 * seen.sum()))
    assert joint == np.inf


def test_whitened_sightings_have_unit_covariance_and_gaps_stay_zero():
    r, slopes, seen = drawn(count=4000, hidden=1000)
    w = NOISE.whitening(slopes, seen)
    white = (w @ r[:, :, None])[:, :, 0]
    assert white[1000:].T @ white[1000:] / 3000 == pytest.approx(np.eye(4), abs=0.08)
    assert not white[:1000, 2:].any()
    assert np.mean(white[:1000, :2] ** 2) == pytest.approx(1.0, rel=0.1)
    assert not w[:1000, 2:].any()


def test_a_hand_beside_a_camera_is_whitened_too():
    _, slopes, seen = drawn(count=3)
    slopes[1] *= 1e12
    w = NOISE.whitening(slopes, seen)
    assert np.isfinite(w).all()
    np.testing.assert_allclose(w[0].T @ w[0], np.linalg.inv(NOISE.covariance(slopes)[0]), rtol=1e-6)

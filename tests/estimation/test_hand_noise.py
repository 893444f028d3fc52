"""Tracker noise and joint noise, told apart by what they do to four pixels."""

import numpy as np
import pytest

from nico_selfmodel.estimation.noise.hand_noise import HandNoise

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


@pytest.mark.parametrize("hidden", [0, 500])
@pytest.mark.parametrize("noise", [NOISE, HandNoise(2.0, 0.005), HandNoise(0.3, 0.0005)])
def test_both_variances_come_back(noise, hidden):
    found = HandNoise.most_likely(*drawn(noise=noise, hidden=hidden))
    assert found.sensor_sigma == pytest.approx(noise.sensor_sigma, rel=0.05)
    assert found.joint_sigma == pytest.approx(noise.joint_sigma, rel=0.05)


def test_without_play_none_is_found():
    found = HandNoise.most_likely(*drawn(noise=HandNoise(0.5, 0.0)))
    assert found.joint_sigma < 2e-4
    assert found.sensor_sigma == pytest.approx(0.5, rel=0.03)


def test_it_is_the_minimum_of_the_likelihood():
    r, slopes, seen = drawn(count=200)
    best = HandNoise.most_likely(r, slopes, seen)

    def surprise(noise):
        s = noise.covariance(slopes)
        return np.sum(np.linalg.slogdet(s)[1] + np.einsum("ni,nij,nj->n", r, np.linalg.inv(s), r))

    least = surprise(best)
    for sensor, joint in ((1.02, 1.0), (0.98, 1.0), (1.0, 1.02), (1.0, 0.98)):
        other = HandNoise(sensor * best.sensor_sigma, joint * best.joint_sigma)
        assert surprise(other) > least


@pytest.mark.parametrize("noise", [NOISE, HandNoise(2.0, 0.005)])
def test_the_error_bars_of_both_are_those_of_many_recordings(noise):
    found = []
    for seed in range(120):
        best = HandNoise.most_likely(*drawn(count=60, noise=noise, seed=seed))
        found.append([best.sensor_sigma, best.joint_sigma])
    _, slopes, seen = drawn(count=60, noise=noise)
    assert np.std(found, axis=0) == pytest.approx(noise.sigmas(slopes, seen), rel=0.25)


def test_without_play_nothing_tells_how_much_there_is():
    _, slopes, seen = drawn(count=60)
    sensor, joint = HandNoise(0.5, 0.0).sigmas(slopes, seen)
    assert sensor == pytest.approx(0.5 / np.sqrt(2.0 * seen.sum()))
    assert joint == np.inf


def test_what_a_fit_took_out_of_the_residuals_is_put_back():
    """Thirty parameters fitted to forty observations take a fifth of their squares."""
    kept, put_back = [], []
    for seed in range(60):
        r, slopes, seen = drawn(count=40, seed=seed)
        w = NOISE.whitening(slopes, seen)
        x = slopes @ np.random.default_rng((seed, 1)).normal(size=(40, 4, 30))
        white = (w @ x).reshape(160, 30)
        step, covariance = np.linalg.lstsq(white, (w @ r[:, :, None]).ravel())[0], white.T @ white
        left, fitted = r - x @ step, x @ np.linalg.inv(covariance) @ x.transpose(0, 2, 1)
        kept.append(HandNoise.most_likely(left, slopes, seen))
        put_back.append(HandNoise.most_likely(left, slopes, seen, fitted))
    assert np.mean([n.joint_sigma for n in kept]) < 0.9 * NOISE.joint_sigma
    assert np.mean([n.joint_sigma for n in put_back]) == pytest.approx(NOISE.joint_sigma, rel=0.04)
    assert np.mean([n.sensor_sigma for n in put_back]) == pytest.approx(
        NOISE.sensor_sigma, rel=0.04
    )


def test_whitened_sightings_have_unit_covariance_and_gaps_stay_zero():
    r, slopes, seen = drawn(count=4000, hidden=1000)
    w = NOISE.whitening(slopes, seen)
    white = (w @ r[:, :, None])[:, :, 0]
    assert white[1000:].T @ white[1000:] / 3000 == pytest.approx(np.eye(4), abs=0.08)
    assert not white[:1000, 2:].any()
    assert np.mean(white[:1000, :2] ** 2) == pytest.approx(1.0, rel=0.1)
    assert not w[:1000, 2:].any()


def test_nothing_seen_tells_no_noise():
    r, slopes, seen = drawn(count=3)
    with pytest.raises(ValueError, match="at least one row"):
        HandNoise.most_likely(r, slopes, np.zeros_like(seen))


def test_closeness_is_relative_to_the_larger():
    assert NOISE.close_to(HandNoise(0.302, 0.005))
    assert not NOISE.close_to(HandNoise(0.31, 0.005))
    assert HandNoise(0.3, 0.0).close_to(HandNoise(0.3, 0.0))


def test_a_hand_beside_a_camera_is_whitened_too():
    _, slopes, seen = drawn(count=3)
    slopes[1] *= 1e12
    w = NOISE.whitening(slopes, seen)
    assert np.isfinite(w).all()
    np.testing.assert_allclose(w[0].T @ w[0], np.linalg.inv(NOISE.covariance(slopes)[0]), rtol=1e-6)

"""Core, tail and outliers of the noise, found again."""

import numpy as np
import pytest

from nico_selfmodel.estimation.noise.mixture_fit import most_likely_mixture

from ..slow_rest import slow_rest

LIMITS = (1e-4, 10.0)
CORE, TAIL, SHARE = (5e-4, 0.006), (1.5e-3, 0.02), 0.12


def drawn(count, rng, coordinates=3, joints=4, core=CORE, tail=TAIL, share=SHARE):
    """Return residuals of poses and their derivatives by the joint angles."""
    by_angle = rng.normal(0.0, 0.2, (count, coordinates, joints))
    rare = rng.random(count) < share
    sensor, joint = np.where(rare[:, None], tail, core).T
    turned = rng.normal(size=(count, joints)) * joint[:, None]
    own = rng.normal(size=(count, coordinates)) * sensor[:, None]
    return np.einsum("nij,nj->ni", by_angle, turned) + own, by_angle


def found(residuals, by_angle, seen=None, fitted=None, limits=LIMITS):
    seen = np.ones(residuals.shape, dtype=bool) if seen is None else seen
    k = residuals.shape[1]
    fitted = np.zeros((len(residuals), k, k)) if fitted is None else fitted
    return most_likely_mixture(residuals, by_angle, seen, fitted, limits, 0.1)


@pytest.mark.parametrize("coordinates", [3, 9])
def test_core_and_tail_are_found_again(coordinates):
    noise = found(*drawn(800, np.random.default_rng(1), coordinates))
    assert noise.joint_sigma == pytest.approx(CORE[1], rel=0.1)
    assert noise.tail_joint_sigma == pytest.approx(TAIL[1], rel=0.15)
    assert noise.sensor_sigma == pytest.approx(CORE[0], rel=0.15)
    assert noise.tail_share == pytest.approx(SHARE, abs=0.03)
    assert noise.outlier_share < 0.002
    assert noise.poses == 800


def test_what_the_prediction_is_uncertain_by_is_no_noise():
    rng = np.random.default_rng(2)
    residuals, by_angle = drawn(600, rng, share=0.0)
    off = rng.normal(0.0, 2e-3, residuals.shape)
    fitted = np.broadcast_to(4e-6 * np.eye(3), (len(residuals), 3, 3))
    noise = found(residuals + off, by_angle, fitted=fitted)
    assert noise.joint_sigma == pytest.approx(CORE[1], rel=0.1)


@pytest.mark.parametrize("seed", slow_rest(range(8), plain=2))
def test_false_detections_shape_neither_core_nor_tail(seed):
    rng = np.random.default_rng((seed, 3))
    residuals, by_angle = drawn(200, rng)
    residuals[:4] += 0.14 * rng.normal(size=(4, 3))
    noise = found(residuals, by_angle)
    assert noise.tail_joint_sigma < 0.03, seed
    assert noise.outlier_share == pytest.approx(0.02, abs=0.006), seed


@pytest.mark.parametrize("seed", slow_rest(range(8), plain=2))
def test_rare_looseness_of_an_exact_arm_is_a_tail_and_no_false_detection(seed):
    rng = np.random.default_rng((seed, 4))
    residuals, by_angle = drawn(100, rng, core=(1e-9, 0.0), tail=(1e-9, 0.02))
    noise = found(residuals, by_angle)
    assert noise.sensor_sigma == LIMITS[0]
    assert noise.joint_sigma < 5e-4, seed
    # Which of the two it is, twelve poses hardly tell: what a coordinate is off by is sure.
    lever = np.mean(np.sum(by_angle**2, axis=2))
    size = np.hypot(noise.tail_sensor_sigma, noise.tail_joint_sigma * np.sqrt(lever))
    assert size == pytest.approx(0.02 * np.sqrt(lever), rel=0.4), seed
    assert noise.outlier_share < 0.01, seed


def test_exact_data_have_the_least_noise_and_the_prior_tail():
    noise = found(np.zeros((50, 3)), np.ones((50, 3, 4)))
    assert noise.sensor_sigma == LIMITS[0]
    assert noise.joint_sigma < 1e-6
    assert noise.tail_sensor_sigma == 2.0 * LIMITS[0]
    assert 0.0 < noise.tail_share < 0.07


def test_coordinates_that_were_not_measured_say_nothing():
    rng = np.random.default_rng(5)
    residuals, by_angle = drawn(300, rng)
    padded = np.concatenate([residuals, np.full((300, 2), 7.0)], axis=1)
    slopes = np.concatenate([by_angle, np.full((300, 2, 4), 3.0)], axis=1)
    seen = np.tile([True, True, True, False, False], (300, 1))
    plain, masked = found(residuals, by_angle), found(padded, slopes, seen)
    assert masked.joint_sigma == pytest.approx(plain.joint_sigma, rel=1e-3)
    assert masked.tail_share == pytest.approx(plain.tail_share, rel=1e-3)
    with pytest.raises(ValueError, match="no pose, no noise"):
        found(padded, slopes, np.zeros_like(seen))


def test_wild_residuals_stay_within_what_can_be():
    noise = found(np.full((30, 3), 1e5), np.ones((30, 3, 4)))
    assert noise.tail_sensor_sigma <= LIMITS[1]
    assert noise.tail_joint_sigma <= np.pi

"""What a sum of squares is to be expected to be, held against sums that were drawn."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.noise.expected_misfit import expected_misfit
from nico_selfmodel.estimation.noise.hand_observations import hand_observations_of
from nico_selfmodel.estimation.noise.mixture_density import core_and_tail

from .arms_that_change import THESIS, learned_arm, session

SEED = 50
DRAWS = 400


@pytest.fixture(scope="module")
def held():
    model = learned_arm(THESIS, SEED)
    return model, hand_observations_of(model, session(THESIS, SEED, 8, 60))


def drawn_sums(model, observations):
    """Return sums of whitened squares of noise drawn as the model says that it is."""
    noise, rng = model.noise_mixtures[observations.sensor], np.random.default_rng(0)
    by_angle, white = observations.block.by_angle(observations.x), observations.whitening()
    parts = [np.linalg.cholesky(part.covariance(by_angle)) for part in core_and_tail(noise)]
    sums = []
    for _ in range(DRAWS):
        loose = rng.random(len(observations)) < noise.tail_share
        root = np.where(loose[:, None, None], parts[1], parts[0])
        r = root @ rng.normal(size=(*observations.seen.shape, 1))
        sums.append(np.sum((white @ r) ** 2))
    return np.array(sums)


@pytest.mark.slow
def test_mean_and_spread_are_those_of_sums_that_were_drawn(held):
    model, observations = held
    sums = drawn_sums(model, observations)
    mean, spread = expected_misfit(model, observations, np.ones(len(observations), dtype=bool), 0)
    assert mean == pytest.approx(sums.mean(), rel=0.05)
    assert spread == pytest.approx(sums.std(), rel=0.12)
    # Normal noise of the same mean would scatter less.
    assert spread > 1.5 * np.sqrt(2.0 * mean)


@pytest.mark.slow
def test_rows_left_out_and_parameters_learned_take_their_share(held):
    model, observations = held
    inliers = np.ones(len(observations), dtype=bool)
    whole, spread = expected_misfit(model, observations, inliers, 0)
    count = int(observations.seen.sum())
    assert expected_misfit(model, observations, inliers, 9)[0] == pytest.approx(
        whole * (count - 9) / count
    )
    half = inliers & (np.arange(len(inliers)) % 2 == 0)
    part = int(observations.seen[half].sum()) / count
    fewer = expected_misfit(model, observations, half, 0)
    assert fewer == pytest.approx((part * whole, np.sqrt(part) * spread))
    assert expected_misfit(model, observations, half, count) == (0.0, 0.0)


@pytest.mark.slow
def test_noise_that_nobody_told_is_taken_for_normal(held):
    model, observations = held
    fit = {key: value for key, value in model.fit.items() if key != "noise"}
    inliers = np.ones(len(observations), dtype=bool)
    mean, spread = expected_misfit(replace(model, fit=fit), observations, inliers, 4)
    assert mean == observations.seen.sum() - 4
    assert spread == pytest.approx(np.sqrt(2.0 * mean))

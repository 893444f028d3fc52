"""Losses on whole observations, and the scale from the median."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nico_selfmodel.optimization.losses import LOSSES, TUNING, Loss, robust_scale

KIND = st.sampled_from(LOSSES)
COORDINATES = st.integers(1, 4)
SCALE = st.floats(1e-4, 10.0)


def corner(kind, scale, coordinates):
    """Return the norm at which a loss turns away from least squares."""
    return TUNING[kind] * scale * np.sqrt(coordinates / 3.0)


@given(kind=KIND, coordinates=COORDINATES, scale=SCALE, at=st.floats(0.0, 50.0))
def test_the_weight_is_the_slope_of_rho(kind, coordinates, scale, at):
    squared = scale**2 * np.array([at])
    h = 1e-5 * scale**2 * (1.0 + at)
    loss = Loss(kind, scale)
    ahead, behind = (loss.rho_and_weight(squared + e, coordinates)[0] for e in (h, -h))
    weight = loss.rho_and_weight(squared, coordinates)[1]
    assert (ahead - behind) / (2.0 * h) == pytest.approx(weight, abs=2e-4)


@given(kind=KIND, coordinates=COORDINATES, scale=SCALE)
def test_every_loss_begins_as_least_squares_and_never_exceeds_it(kind, coordinates, scale):
    squared = scale**2 * np.linspace(0.0, 200.0, 500)
    rho, weight = Loss(kind, scale).rho_and_weight(squared, coordinates)
    assert (rho[0], weight[0]) == (0.0, 1.0)
    assert np.all(rho <= squared * (1.0 + 1e-12))
    assert np.all((weight >= 0.0) & (weight <= 1.0))
    assert np.all(np.diff(weight) <= 1e-12)
    assert np.all(np.diff(rho) >= -1e-9 * scale**2)


@given(coordinates=COORDINATES, scale=SCALE)
def test_far_out_each_loss_has_its_own_way_to_give_up(coordinates, scale):
    def at(kind, times):
        norm = times * corner(kind, scale, coordinates)
        rho, weight = Loss(kind, scale).rho_and_weight(np.array([norm**2]), coordinates)
        return rho[0] / corner(kind, scale, coordinates) ** 2, weight[0]

    # Huber: a straight line in the norm
    assert at("huber", 1.0) == pytest.approx((1.0, 1.0))
    assert at("huber", 100.0) == pytest.approx((199.0, 0.01))
    # Cauchy: a logarithm; the pull fades as 1 / norm
    assert at("cauchy", 1.0) == pytest.approx((np.log(2.0), 0.5))
    assert at("cauchy", 1e4) == pytest.approx((2.0 * np.log(1e4), 1e-8), rel=1e-3)
    # Tukey: nothing at all beyond its corner
    assert at("tukey", 0.5) == pytest.approx(((1.0 - 0.75**3) / 3.0, 0.75**2))
    assert at("tukey", 1.001) == at("tukey", 1e6) == pytest.approx((1.0 / 3.0, 0.0))


def test_no_loss_is_plain_least_squares():
    squared = np.array([0.0, 1.0, 1e6])
    rho, weight = Loss().rho_and_weight(squared, 3)
    assert rho.tolist() == squared.tolist()
    assert weight.tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize("coordinates", [1, 2, 3, 4])
@pytest.mark.parametrize("sigma", [1e-4, 1.0, 30.0])
def test_the_scale_of_gaussian_noise_is_its_sigma(coordinates, sigma):
    rng = np.random.default_rng(coordinates)
    norms = np.linalg.norm(rng.normal(0.0, sigma, (coordinates, 100_000)), axis=0)
    assert robust_scale(norms, coordinates) == pytest.approx(sigma, rel=0.01)
    norms[:10_000] = 1e6 * sigma
    assert robust_scale(norms, coordinates) == pytest.approx(sigma, rel=0.2)


def test_the_scale_of_perfect_data_is_still_a_scale():
    scale = robust_scale(np.zeros(5), 3)
    assert scale > 0.0
    with np.errstate(all="raise"):
        rho, weight = Loss("cauchy", scale).rho_and_weight(np.array([0.0, 1.0]), 3)
    assert np.isfinite(rho).all()
    assert weight[0] == 1.0


@pytest.mark.parametrize(
    ("kind", "scale", "message"),
    [
        ("squared", 1.0, "no loss 'squared'; there are none, huber, cauchy, tukey"),
        ("huber", 0.0, "scale must be positive, got 0.0"),
        ("huber", np.nan, "scale must be positive"),
    ],
)
def test_a_loss_that_is_none_is_refused(kind, scale, message):
    with pytest.raises(ValueError, match=message):
        Loss(kind, scale)

"""Error bars of numbers whose prior variance the data told: as wide as they scatter."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.estimation.bending.uncertain_variances import with_uncertain_variances
from nico_selfmodel.optimization.uncertainty import Uncertainty

NAMES = tuple(f"w{i}" for i in range(6))


def drawn(rng, sigma, spread):
    """Six numbers, each measured once, and their spread by evidence: truth, estimate, fit."""
    true = spread * rng.normal(size=len(NAMES))
    z = true + sigma * rng.normal(size=len(NAMES))
    v = sigma**2
    for _ in range(300):
        told = len(NAMES) * v / (v + sigma**2)
        w = z * v / (v + sigma**2)
        v = (w @ w + 0.5 * sigma**2) / (told + 0.5)
    C = np.eye(len(NAMES)) / (1.0 / sigma**2 + 1.0 / v)
    known = Uncertainty(NAMES, C, np.sqrt(np.diag(C)), 1.0, len(NAMES), 1.0, (), 10**6 + len(NAMES))
    return true, z * v / (v + sigma**2), fit_of(v), known


def fit_of(v, known=frozenset()):
    return SimpleNamespace(
        groups={"sag": NAMES},
        variance={"sag": v},
        variances=dict.fromkeys(NAMES, v),
        means={},
        known=known,
    )


@pytest.mark.slow
def test_numbers_that_are_told_at_all_scatter_as_said():
    rng, narrow, wide = np.random.default_rng(7), [], []
    for _ in range(1500):
        spread = np.exp(rng.uniform(np.log(1.3), np.log(8.0)))
        true, found, fit, known = drawn(rng, 1.0, spread)
        wider = with_uncertain_variances(known, dict(zip(NAMES, found, strict=True)), fit)
        for C, out in ((known.covariance, narrow), (wider.covariance, wide)):
            out.append((found - true) @ np.linalg.solve(C, found - true) / len(NAMES))
    assert np.mean(wide) == pytest.approx(1.0, abs=0.05)
    assert np.mean(narrow) > 1.05


def test_a_spread_that_was_known_beforehand_widens_nothing():
    _, found, fit, known = drawn(np.random.default_rng(0), 1.0, 2.0)
    fit.known = frozenset({"sag"})
    same = with_uncertain_variances(known, dict(zip(NAMES, found, strict=True)), fit)
    assert same.covariance == pytest.approx(known.covariance, rel=1e-4, abs=1e-6)
    assert same.sigma == pytest.approx(np.sqrt(np.diag(same.covariance)))


def test_few_equations_say_that_the_noise_is_uncertain_too():
    _, found, fit, known = drawn(np.random.default_rng(0), 1.0, 2.0)
    fit.known, values = frozenset({"sag"}), dict(zip(NAMES, found, strict=True))
    few = with_uncertain_variances(replace(known, equations=40 + len(NAMES)), values, fit)
    # Of nothing but noise, told by f equations, its variance is 1 + 2 / f times larger in the mean.
    assert np.all(np.diag(few.covariance) > (1.0 + 2.0 / 40.0) * np.diag(known.covariance))


def test_units_make_no_difference():
    _, found, fit, known = drawn(np.random.default_rng(3), 1.0, 2.0)
    one = with_uncertain_variances(known, dict(zip(NAMES, found, strict=True)), fit)
    fit = fit_of(1e6 * fit.variance["sag"])
    large = replace(known, covariance=1e6 * known.covariance, sigma=1e3 * known.sigma)
    two = with_uncertain_variances(large, dict(zip(NAMES, 1e3 * found, strict=True)), fit)
    assert two.covariance == pytest.approx(1e6 * one.covariance)


def test_what_nothing_tells_stays_unknown():
    _, found, fit, known = drawn(np.random.default_rng(3), 1.0, 2.0)
    sigma = known.sigma.copy()
    sigma[2] = np.inf
    wider = with_uncertain_variances(
        replace(known, sigma=sigma), dict(zip(NAMES, found, strict=True)), fit
    )
    assert np.isinf(wider.sigma[2])
    assert np.isfinite(np.delete(wider.sigma, 2)).all()

"""Searches whose steps fall short arrive in fewer of them."""

import numpy as np
import pytest

from nico_selfmodel.optimization.mixed_steps import mixed_step

TRUE = np.array([1.0, -2.0, 0.5])
SHARES = np.array([1.0, 0.3, 0.1])
"""How far a step goes along each of three axes that lie askew."""
AXES = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]


def falls_short(x):
    return AXES @ (SHARES * (AXES.T @ (TRUE - x)))


def searched(step, steps, memory):
    x, tried = np.zeros(3), []
    for _ in range(steps):
        tried = [*tried, (x, step(x))][-memory - 1 :]
        x = x + mixed_step(tried, np.diag([1.0, 4.0, 0.25]))
    return x


def test_the_first_step_is_that_of_the_search():
    assert mixed_step([(np.zeros(3), falls_short(np.zeros(3)))], np.eye(3)) == pytest.approx(
        falls_short(np.zeros(3))
    )


def test_a_linear_search_of_three_unknowns_arrives_in_four_steps():
    assert searched(falls_short, 4, 4) == pytest.approx(TRUE, abs=1e-9)
    assert np.abs(searched(falls_short, 4, 0) - TRUE).max() > 0.5


def test_what_does_not_change_from_step_to_step_tells_nothing():
    x, f = np.zeros(3), np.array([1.0, 0.0, 0.0])
    assert mixed_step([(x, f), (x, f)], np.eye(3)) == pytest.approx(f)


@pytest.mark.parametrize("units", [1e-3, 1.0, 1e3])
def test_units_do_not_matter(units):
    rng = np.random.default_rng(1)
    tried = [(rng.standard_normal(3), rng.standard_normal(3)) for _ in range(4)]
    spread = rng.standard_normal((3, 3))
    scale = np.diag([units, 1.0, 1.0])
    plain = mixed_step(tried, spread @ spread.T)
    told = mixed_step([(scale @ x, scale @ f) for x, f in tried], scale @ spread @ spread.T @ scale)
    assert told == pytest.approx(scale @ plain, rel=1e-6)

"""A light that is turned about a body is told by its shades, whatever its brightness."""

import numpy as np
import pytest

from nico_selfmodel.estimation.mirrors.light_turn import ShadedLook, light_turn

TURN = np.radians([2.0, -3.0, 1.0])


def looks(turn, rng, gain=0.0, count=3000):
    """Return two looks at paint that a turned light makes brighter or darker by its normal."""
    found = []
    for _ in range(2):
        expected = rng.uniform(40.0, 200.0, (count, 3))
        by_turn = expected[:, :, None] * rng.normal(0.0, 0.5, (count, 1, 3))
        off = by_turn @ turn + gain * expected + rng.normal(0.0, 2.0, expected.shape)
        found.append(ShadedLook(off, expected, by_turn, np.full(expected.shape, 4.0)))
    return found


@pytest.mark.parametrize("gain", [0.0, 0.04])
def test_the_turn_is_found_to_its_sigma(gain):
    squares = []
    for seed in range(40):
        found = light_turn(looks(TURN, np.random.default_rng(seed), gain), 1.0 / 3.0)
        off = found.turn - TURN
        squares.append(off @ np.linalg.solve(found.covariance, off) / 3.0)
    assert 0.7 < np.mean(squares) < 1.4


def test_a_mark_on_the_body_does_not_turn_the_light():
    rng = np.random.default_rng(0)
    first, second = looks(TURN, rng)
    first.off[:60] += 80.0
    found = light_turn([first, second], 1.0)
    assert np.degrees(found.turn) == pytest.approx([2.0, -3.0, 1.0], abs=0.2)


def test_where_nothing_is_told_the_light_stays_and_is_known_to_five_degrees():
    rng = np.random.default_rng(0)
    plain = [
        ShadedLook(one.off, one.expected, 0.0 * one.by_turn, one.variance)
        for one in looks(TURN, rng)
    ]
    found = light_turn(plain, 40.0)
    assert found.turn == pytest.approx(np.zeros(3), abs=1e-9)
    assert np.degrees(np.sqrt(np.diag(found.covariance))) == pytest.approx(5.0)

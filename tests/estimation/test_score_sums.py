"""What residuals that are asked for a change in time are left by what else is free."""

import numpy as np
import pytest

from nico_selfmodel.estimation.diagnosis.score_sums import Left, ScoreSums


@pytest.mark.parametrize("strength", [0.0, 1.0, 1e3])
def test_what_priors_give_way_by_is_not_taken_off_the_residuals(strength):
    rng = np.random.default_rng(1)
    U, r, visit = rng.normal(size=(60, 2)), rng.uniform(-1.0, 1.0, 60), np.arange(60)
    left = Left(r[:, None], U[:, None], np.ones(2), visit)
    prior = (strength * np.eye(2), strength * np.array([1e3, -1e3]))
    found = ScoreSums.of(np.column_stack([r, U]), visit, left, np.arange(2), visit, prior)
    step = np.linalg.solve(U.T @ U + strength**2 * np.eye(2), U.T @ r + strength * prior[1])
    taken = np.trace(np.linalg.solve(U.T @ U + strength**2 * np.eye(2), U.T @ U))
    expected = np.sum((r - U @ step) ** 2) / (60 - taken)
    assert found.variance == pytest.approx(expected, rel=1e-9)

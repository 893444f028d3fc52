"""Where something moved between two pictures."""

import numpy as np
import pytest

from nico_selfmodel.vision.images.motion_mask import CELL, moving_cells, still_limit

from ..slow_rest import slow_rest


def picture(rng, noise, shape=(240, 320, 3)):
    """Return a grey picture with noise."""
    values = 120.0 + noise * rng.standard_normal(shape)
    return np.clip(np.round(values), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("noise", slow_rest([0.0, 2.0, 0.3, 8.0], plain=2))
def test_noise_is_not_motion_whatever_its_size(noise):
    rng = np.random.default_rng(1)
    alarms = sum(moving_cells(picture(rng, noise), picture(rng, noise)).any() for _ in range(30))
    # One in a thousand pictures of four times this size.
    assert alarms == 0


@pytest.mark.slow
def test_one_still_cell_in_more_than_a_million_seems_to_move():
    # Of noise of 2 grey levels; the mean of 768 squares is a chi-square, and skew.
    still, count = 8.0, CELL * CELL * 3
    limit = still_limit(still, count)
    drawn = still / count * np.random.default_rng(3).chisquare(count, 12_000_000)
    assert 2 <= np.sum(drawn > limit) <= 20


def test_what_moves_is_found_in_its_cells_and_nowhere_else():
    rng = np.random.default_rng(2)
    before, after = picture(rng, 2.0), picture(rng, 2.0)
    after[CELL * 3 + 4 : CELL * 3 + 10, CELL * 5 + 4 : CELL * 5 + 10] += 20
    moving = moving_cells(before, after)
    assert np.argwhere(moving).tolist() == [[3, 5]]
    assert moving.shape == (15, 20)


def test_pictures_that_do_not_belong_together_are_refused():
    small = np.zeros((8, 8, 3), np.uint8)
    for a, b in (
        (small, small),
        (np.zeros((32, 32, 3), np.uint8), np.zeros((32, 48, 3), np.uint8)),
    ):
        with pytest.raises(ValueError, match="one shape"):
            moving_cells(a, b)

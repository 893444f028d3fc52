"""Pictures that are blurred only by what counts."""

import numpy as np
import pytest

from nico_selfmodel.vision.images.image_array import smoothed_within


def test_what_does_not_count_does_not_blur_into_what_does():
    inside = np.zeros((40, 40), dtype=bool)
    inside[:, :20] = True
    picture = np.where(inside[:, :, None], 50.0, 200.0) * np.ones(3)
    found = smoothed_within(picture, inside, 3.0)
    assert found[:, :22] == pytest.approx(50.0, abs=1e-3)
    assert (found[:, 35:] == 0.0).all()


def test_where_all_counts_it_is_a_plain_blur():
    rng = np.random.default_rng(0)
    picture = rng.uniform(0.0, 255.0, (30, 30, 3))
    found = smoothed_within(picture, np.ones((30, 30), dtype=bool), 2.0)
    assert found[15, 15].std() < picture.std()
    assert found.mean() == pytest.approx(picture.mean(), rel=0.02)

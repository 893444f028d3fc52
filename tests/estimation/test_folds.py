"""Folds leave whole poses out, each once, and are as equal as they can be."""

import numpy as np
import pytest

from nico_selfmodel.estimation.results.folds import FOLDS, fold_of, splits


@pytest.mark.parametrize("poses", [1, 2, 4, 5, 6, 23])
def test_each_pose_is_left_out_once_and_whole(poses):
    groups = np.random.default_rng(poses).permutation(np.repeat(7 + 3 * np.arange(poses), 3))
    fold, left_out = fold_of(groups), np.zeros(len(groups), dtype=int)
    for rest, left in splits(fold):
        assert (rest ^ left).all()
        assert not set(groups[rest]) & set(groups[left])
        left_out += left
    assert (left_out == 1).all()
    sizes = np.bincount(fold) // 3
    assert len(sizes) == min(poses, FOLDS)
    assert np.ptp(sizes) <= 1


def test_what_the_folds_are_does_not_depend_on_the_order_of_the_rows():
    groups = np.repeat(np.arange(11), 2)
    order = np.random.default_rng(1).permutation(22)
    assert np.array_equal(fold_of(groups[order]), fold_of(groups)[order])


def test_of_nothing_nothing_is_left_out():
    assert not [left for _, left in splits(fold_of(np.zeros(0))) if left.any()]

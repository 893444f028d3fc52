"""Folds leave whole poses out, each once, and are as equal as they can be."""

import numpy as np
import pytest

from nico_selfmodel.estimation.results.folds import FOLDS, cross_validate, fold_of, splits


@pytest.mark.parametrize("poses", [1, 2, 4, 5, 6, 23])
def test_each_pose_is_left_out_once_and_whole(poses):
    groups = np.random.default_rng(poses).permutation(np.repeat(7 + 3 * np.arange(poses), 3))
    fold, left_out = fold_of(groups), np.zeros(len(groups), dtype=int)
    for part in splits(fold):
        rest, left = part.rest, part.left
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
    assert not splits(fold_of(np.zeros(0)))


def test_each_row_is_predicted_by_what_the_other_folds_tell():
    values, fold = np.random.default_rng(2).normal(size=(23, 3)), fold_of(np.arange(23))
    found = cross_validate(
        fold,
        lambda part: values[part.rest].mean(axis=0),
        lambda mean, part: np.broadcast_to(mean, (part.left.sum(), 3)),
    )
    for row in range(23):
        assert np.allclose(found[row], values[fold != fold[row]].mean(axis=0))


def test_rows_of_no_fold_are_learned_from_and_not_predicted():
    fold, learned = np.array([-1, 0, 1, 1]), []
    found = cross_validate(
        fold, lambda part: learned.append(part.rest), lambda _, part: np.zeros(part.left.sum())
    )
    assert np.array_equal(np.isnan(found), fold < 0)
    assert all(rest[0] for rest in learned)
    assert np.isnan(cross_validate(np.full(3, -1), lambda part: part, lambda *_: found)).all()

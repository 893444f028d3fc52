"""Equal rows are numbered as numpy does along an axis, whatever a sum of them rounds to."""

import numpy as np

from nico_selfmodel.arrays import numbered_rows


def assert_numbered(rows):
    lead, same = numbered_rows(rows)
    distinct = np.unique(rows, axis=0)
    assert len(lead) == len(distinct)
    np.testing.assert_array_equal(rows[lead][same], rows)
    for number, first in enumerate(lead):
        assert first == np.flatnonzero((rows == rows[lead[number]]).all(axis=1))[0]


def test_rows_that_stand_there_again_have_one_number_of_their_first():
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(40, 3))
    assert_numbered(rows[rng.integers(0, 40, 200)])
    assert_numbered(rng.integers(0, 3, (200, 2)).astype(float))
    assert_numbered(np.array([[0.0], [-0.0], [1.0]]))


def test_rows_whose_sums_round_to_one_are_told_apart():
    one = np.array([1e16, 0.0])
    other = np.array([1e16, 0.25])
    assert np.sqrt(2.0) * one[0] == np.sqrt(2.0) * one[0] + np.sqrt(3.0) * other[1]
    assert_numbered(np.array([one, other, one]))


def test_no_rows_have_no_number():
    lead, same = numbered_rows(np.zeros((0, 3)))
    assert not len(lead)
    assert not len(same)

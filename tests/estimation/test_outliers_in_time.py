"""Outliers that gather at one end of a recording are named; strewn ones are not."""

import numpy as np
import pytest

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.diagnosis.outliers_in_time import LARGEST_CHANCE, outliers_in_time
from nico_selfmodel.estimation.observations.observations import Observations

POSES = 60


@pytest.fixture(scope="module")
def observations(make_truth) -> Observations:
    truth = make_truth(3, 2, unit="rad", kind="elbow", markers=2)
    data: Dataset = truth.dataset(truth.poses(POSES, 1), sigma=1e-4, seed=1)
    return Observations.from_dataset(data)


def of_samples(observations: Observations, samples) -> np.ndarray:
    return np.isin(observations.sample, samples) & (observations.marker == 0)


def test_outliers_at_the_beginning_are_named(observations):
    found = outliers_in_time(observations, of_samples(observations, [2, 3, 5, 6, 8, 9]))
    assert found is not None
    assert found.notable
    assert "6 of 6 outliers lie up to sample 9: something moved" in found.what


def test_outliers_at_the_end_are_named(observations):
    found = outliers_in_time(observations, of_samples(observations, [5, *range(51, 59)]))
    assert found is not None
    assert "8 of 9 outliers lie after sample 50" in found.what


def test_strewn_outliers_are_named_as_rarely_as_is_said(observations):
    rng = np.random.default_rng(3)
    found = [
        outliers_in_time(observations, of_samples(observations, 1 + rng.choice(POSES, 9)))
        for _ in range(400)
    ]
    assert sum(change is not None for change in found) <= 2
    assert LARGEST_CHANCE == 1e-3


def test_few_outliers_gather_nowhere(observations):
    assert outliers_in_time(observations, of_samples(observations, [1, 2, 3])) is None


def test_frames_of_one_visit_are_one_witness(make_truth):
    truth = make_truth(3, 2, unit="rad", kind="elbow", markers=2)
    visits = np.repeat(truth.poses(12, 1), 5, axis=0)
    observations = Observations.from_dataset(truth.dataset(visits, sigma=1e-4, seed=1))
    last = np.isin(observations.visit, [10, 11])
    assert last.sum() == 20
    assert outliers_in_time(observations, last) is None

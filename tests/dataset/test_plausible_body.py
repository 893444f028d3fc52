"""Recordings of bodies in other units than they say are refused when they are read."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_folder import load_body_dataset, save_body_dataset
from nico_selfmodel.dataset.body.sensors import DISTANCE
from nico_selfmodel.errors import DataError

from ..estimation.simulated_trees import one_arm, two_arms
from ..estimation.test_one_problem import KNOWN, flange_dataset, hand_eye_poses


def read_back(data, tmp_path):
    save_body_dataset(data, tmp_path / "data")
    return load_body_dataset(tmp_path / "data")


def longer(data, keep, columns):
    values = data.observations.values.copy()
    values[np.ix_(keep, columns)] *= 1000.0
    return replace(data, observations=replace(data.observations, values=values))


def test_distances_in_millimetres_are_refused(tmp_path):
    data = two_arms(1, poses=6, distances=KNOWN).data
    kinds = np.array([s.kind for s in data.sensors])[data.observations.sensor]
    assert (kinds == DISTANCE).any()
    with pytest.raises(DataError, match="were millimetres given as metres"):
        read_back(longer(data, np.flatnonzero(kinds == DISTANCE), [0]), tmp_path)


def test_places_in_millimetres_are_refused(tmp_path):
    data = one_arm(1, poses=6).data
    with pytest.raises(DataError, match=r"up to .* m: were millimetres given as metres"):
        read_back(longer(data, np.arange(len(data.observations)), [0, 1, 2]), tmp_path)


def test_a_tracker_far_from_the_robot_is_taken(tmp_path):
    data = one_arm(1, poses=6).data
    values = data.observations.values + np.array([500.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    far = replace(data, observations=replace(data.observations, values=values))
    np.testing.assert_array_equal(read_back(far, tmp_path).observations.values, values)


def test_rotation_vectors_in_degrees_are_refused(tmp_path):
    _, _, F, M = hand_eye_poses(np.random.default_rng(0), 5)
    data = flange_dataset(F, M)
    values = data.observations.values * [1.0, 1.0, 1.0, 57.3, 57.3, 57.3]
    with pytest.raises(DataError, match="were degrees given as radians"):
        read_back(replace(data, observations=replace(data.observations, values=values)), tmp_path)

"""Of many poses a sample finds the minimum, and all of them decide."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nico_selfmodel.dataset.folder import load_dataset
from nico_selfmodel.estimation.arm import kinematic_task, kinematics
from nico_selfmodel.estimation.arm.cross_validation import cross_validate_arm
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.noise import pose_sums
from nico_selfmodel.estimation.observations.observations import Observations

ARM = Path(__file__).parents[1] / "golden" / "arm"
WRONG = [40, 200, 350]


@pytest.fixture(scope="module")
def data():
    found = load_dataset(ARM)
    points = found.p_WH_measured.copy()
    points[WRONG] += 0.1
    return replace(found, p_WH_measured=points)


@pytest.fixture(scope="module")
def of_all(data):
    return calibrate_kinematics(data)


@pytest.fixture
def sampled(data, monkeypatch):
    monkeypatch.setattr(kinematic_task, "MOST_ROWS", 300)
    monkeypatch.setattr(pose_sums, "_PIECE", 70)
    return calibrate_kinematics(data)


@pytest.mark.slow
def test_a_sample_and_all_rows_give_what_all_rows_give(of_all, sampled):
    assert sampled.free == of_all.free
    sigma = of_all.uncertainty.sigma
    names = of_all.model.parameters.names
    free = [names.index(name) for name in of_all.uncertainty.names]
    moved = (sampled.model.parameters.values - of_all.model.parameters.values)[free]
    assert np.abs(moved / sigma).max() < 0.25
    np.testing.assert_allclose(sampled.uncertainty.sigma, sigma, rtol=0.15)
    assert judge(sampled).status == judge(of_all).status
    assert sampled.converged
    assert len(sampled.cross_validation) == np.sum(~sampled.outliers)


@pytest.mark.slow
def test_outliers_are_found_among_all_rows(data, of_all, sampled):
    assert set(WRONG) <= set(np.flatnonzero(sampled.outliers))
    assert sampled.outliers.sum() <= of_all.outliers.sum() + 2


def test_pieces_hold_whole_poses_and_every_row_once(data, monkeypatch):
    observations = Observations.from_dataset(data)
    monkeypatch.setattr(pose_sums, "_PIECE", 50)
    found = list(pose_sums.pieces(observations))
    assert len(found) > 5
    np.testing.assert_array_equal(np.sort(np.concatenate(found)), np.arange(len(observations)))
    of_pose = [set(observations.pose[rows].tolist()) for rows in found]
    assert sum(len(poses) for poses in of_pose) == len(observations.poses)


@pytest.mark.slow
def test_sums_do_not_depend_on_the_pieces(data, of_all, monkeypatch):
    observations = Observations.from_dataset(data)
    arguments = (of_all.model.parameters, of_all.free, ~of_all.outliers, of_all.noise)
    once = pose_sums.PoseSums.of(observations, *arguments)
    monkeypatch.setattr(pose_sums, "_PIECE", 50)
    parts = pose_sums.PoseSums.of(observations, *arguments)
    scale = np.sqrt(np.diag(once.H.sum(axis=0)))
    np.testing.assert_allclose(
        parts.H / np.outer(scale, scale), once.H / np.outer(scale, scale), atol=1e-12
    )
    np.testing.assert_allclose(parts.g / scale, once.g / scale, atol=1e-9)
    assert parts.moved == pytest.approx(once.moved)


@pytest.fixture
def refined(data, monkeypatch):
    """Return all rows, the arm that they tell and what they say of it, before cross-validation."""
    given = []

    def caught(*known):
        given.append(known)
        return cross_validate_arm(*known)

    monkeypatch.setattr(kinematic_task, "MOST_ROWS", 300)
    monkeypatch.setattr(kinematics, "cross_validate_arm", caught)
    calibrate_kinematics(data, explain=False)
    return given[0]


@pytest.mark.slow
def test_what_rows_say_of_the_arm_that_they_tell_is_not_worked_out_twice(refined):
    observations, solved, sums = refined
    errors = cross_validate_arm(observations, solved)
    assert len(errors) > 300
    np.testing.assert_allclose(cross_validate_arm(observations, solved, sums), errors, rtol=1e-9)
    # The same base, turned the other way round: its derivatives are others than the result's.
    turn = solved.parameters.base_turn
    long_way = replace(solved.parameters, turn=turn * (1.0 - 2.0 * np.pi / np.linalg.norm(turn)))
    again, other = pose_sums.refine_on_all(
        observations, replace(solved, parameters=long_way), trim=False
    )
    assert other is None
    np.testing.assert_allclose(again.parameters.base_turn, turn, atol=0.1)

"""Depth, and tilts of what a camera tells by corners, are far less sure than the rest."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from nico_selfmodel.dataset.body.sensors import SensorInfo
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.monitoring.body_health import check_body_health
from nico_selfmodel.estimation.monitoring.health_document import health_document
from nico_selfmodel.estimation.noise.pose_groups import PoseGroups
from nico_selfmodel.estimation.noise.variance_components import (
    LinearResiduals,
    Variances,
    VarianceSearch,
)
from nico_selfmodel.estimation.tree.noise import likeliest_noise
from nico_selfmodel.estimation.tree.noise.finer_noise import noise_ties
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_noise import noise_named, sensor_noise_named
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_result import body_model
from nico_selfmodel.geometry.rotation import rotation_from_vector, turned_to_z
from nico_selfmodel.geometry.transform import inverse, transform

from .simulated_trees import observed, one_arm
from .test_one_problem import flange_dataset

ACROSS, DEPTH, TILT, ROLL = 6e-5, 9e-4, 5e-3, 3e-4
"""Of a board of 20 cm before a camera that stands 1.2 m away, corners to 0.3 px [m and rad]."""
FLANGE = np.radians(0.05), 3e-4


def before_a_camera(seed, count, sigma=(ACROSS, DEPTH, TILT, ROLL)):
    """Poses of a flange, and of a board on it before a camera that stands."""
    rng = np.random.default_rng(seed)
    X_FT = transform(rotation_from_vector(0.3 * rng.normal(size=3)), 0.05 * rng.normal(size=3))
    F = transform(
        rotation_from_vector(0.3 * rng.normal(size=(count, 3))), 0.1 * rng.normal(size=(count, 3))
    )
    X_CB = transform(rotation_from_vector([np.pi, 0.0, 0.0]), [0.05, 0.1, 1.2])
    M = X_CB @ F @ X_FT
    R_CD = np.swapaxes(turned_to_z(M[:, :3, 3]), 1, 2)
    across, depth, tilt, roll = sigma
    w, v = (
        (R_CD @ (rng.normal(size=(count, 3)) * one)[:, :, None])[:, :, 0]
        for one in ([tilt, tilt, roll], [across, across, depth])
    )
    M[:, :3, :3] = rotation_from_vector(w) @ M[:, :3, :3]
    M[:, :3, 3] += v
    turn, place = (own * rng.normal(size=(count, 3)) for own in FLANGE)
    return X_FT, flange_dataset(F @ transform(rotation_from_vector(turn), place), M)


def errors_of(seed, count=40, **how):
    """Return what was learned, and how far off the board is on the flange [m]."""
    X, data = before_a_camera(seed, count, **how)
    found = calibrate_tree(data)
    return found, found.tree.markers[0].X_LA[:3, 3] - X[:3, 3]


def test_a_direction_is_turned_to_z_by_the_least_angle():
    p = np.random.default_rng(0).normal(size=(200, 3))
    p = np.vstack([p, np.diag([1.0, 2.0, 3.0]), -np.eye(3), [1e-9, 0.0, -1.0], np.zeros(3)])
    R = turned_to_z(p)
    length = np.linalg.norm(p, axis=1)
    assert_allclose(R @ np.swapaxes(R, 1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12)
    assert_allclose(np.linalg.det(R), 1.0)
    assert_allclose((R @ p[:, :, None])[:, :, 0], length[:, None] * [0.0, 0.0, 1.0], atol=1e-12)
    z = np.divide(p[:, 2], length, out=np.ones(len(p)), where=length > 0.0)
    assert_allclose((np.trace(R, axis1=1, axis2=2) - 1.0) / 2.0, z, atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_a_camera_that_knows_little_of_depth_is_no_flange_that_slips(seed):
    _, data = before_a_camera(seed, 50)
    held = np.arange(50) % 5 == 0
    found = calibrate_tree(data.select(~held), test=data.select(held))
    assert judge(found).status == "PASS"
    assert not found.solution.slipped.any()
    assert found.noise["camera depth"] == pytest.approx(DEPTH, rel=0.4)
    assert found.noise["camera orientation"] == pytest.approx(TILT, rel=0.3)
    assert found.noise["camera roll orientation"] < 0.3 * TILT


def test_across_the_line_of_sight_a_camera_and_a_flange_are_as_sure_as_both_are():
    # Nothing tells the camera's error from the flange's there, but their sum.
    noise = [errors_of(seed)[0].noise for seed in range(3)]
    across = [one["camera"] ** 2 + one["tcp place"] ** 2 for one in noise]
    assert np.sqrt(np.mean(across)) == pytest.approx(np.hypot(ACROSS, FLANGE[1]), rel=0.2)


def test_a_camera_that_was_moved_is_told_of_a_hand_eye_calibration_and_a_sound_day_is_not():
    _, data = before_a_camera(7, 80)
    model = body_model(calibrate_tree(data.select(np.arange(80) < 50)))
    day = data.select(np.arange(80) >= 50)
    assert check_body_health(model, day).healthy
    moved = transform(rotation_from_vector([0.004, -0.003, 0.0]), [0.002, -0.001, 0.001])
    M = moved @ transform(
        rotation_from_vector(day.observations.values[:, 3:6]), day.observations.values[:, :3]
    )
    report = check_body_health(model, flange_dataset(_flanges(day), M))
    assert health_document(report)["reasons"][0].startswith("something changed")
    assert report.diagnoses[0].hypothesis.cause == "sensor camera on its link"


@pytest.mark.slow
@pytest.mark.parametrize(("count", "first", "median"), [(40, 100, 0.35), (10, 9000, 0.8)])
def test_error_bars_are_right_where_depth_is_less_sure(count, first, median):
    off, squares = [], []
    for seed in range(first, first + 40):
        found, error = errors_of(seed, count)
        index = [found.uncertainty.names.index(f"target.{a}") for a in "xyz"]
        C = found.uncertainty.covariance[np.ix_(index, index)]
        squares.append(error @ np.linalg.solve(C, error) / 3.0)
        off.append(1e3 * np.linalg.norm(error))
    assert 0.7 < np.mean(squares) < 1.5
    assert np.median(off) < median


def test_what_is_as_sure_in_depth_has_one_standard_deviation():
    for seed in range(5):
        found, _ = errors_of(seed, sigma=(5e-4, 5e-4, 2e-3, 2e-3))
        assert set(found.noise) == {"camera", "camera orientation", "tcp turn", "tcp place"}


def test_what_is_a_little_less_sure_in_depth_is_not_told_apart_by_few_poses():
    ratios = (1.2, 4.0)
    split = [
        sum("camera depth" in errors_of(seed, sigma=(5e-4, ratio * 5e-4, 2e-3, 2e-3))[0].noise
            for seed in range(5))
        for ratio in ratios
    ]  # fmt: skip
    assert split == [0, 5]


def test_what_is_surer_in_depth_is_no_noise_of_a_sensor():
    # Sensors know depth less surely than the rest: what makes it look surer errs otherwise.
    for seed in range(3):
        found, _ = errors_of(seed, sigma=(2e-3, 2e-4, 2e-4, 2e-3))
        assert set(found.noise) == {"camera", "camera orientation", "tcp turn", "tcp place"}


def test_places_that_a_sensor_tells_worse_in_depth_are_told_so():
    joint, away = np.radians(0.03), np.array([0.0, 0.0, 1.5])
    sim, rng = one_arm(1, poses=80, joint_sigma=joint), np.random.default_rng(7)
    seen = (*(sim.data.joints, sim.data.markers), (SensorInfo("tracker", "points"),))
    sigma = {"points": 4e-4}
    data = observed(sim.tree, *seen, sim.readings_true, rng, sigma=sigma, joint_sigma=joint)
    values = data.observations.values.copy()
    p = values[:, :3] + away
    values[:, :3] = p * (
        1.0 + 3e-3 * rng.normal(size=(len(p), 1)) / np.linalg.norm(p, axis=1)[:, None]
    )
    data = replace(data, observations=replace(data.observations, values=values))
    noise = calibrate_tree(data, effects=()).noise
    assert noise["tracker"] == pytest.approx(4e-4, rel=0.15)
    assert noise["tracker depth"] == pytest.approx(3e-3, rel=0.15)


def test_noise_of_a_sensor_that_was_not_told_apart_is_that_of_all_its_numbers():
    seen = TreeObservations.of(before_a_camera(0, 12)[1])
    names = {"camera": 1.0, "camera orientation": 2.0, "tcp turn": 3.0, "tcp place": 4.0}
    assert_allclose(sensor_noise_named(names, seen), [1.0, 1.0, 2.0, 2.0])
    finer = {**names, "camera depth": 5.0, "camera roll orientation": 6.0}
    assert_allclose(sensor_noise_named(finer, seen), [1.0, 5.0, 2.0, 6.0])
    assert noise_named(names, seen) is not None
    del names["camera"]
    assert noise_named(names, seen) is None
    assert np.isnan(sensor_noise_named(names, seen)).tolist() == [True, True, False, False]


def test_noise_ties_are_of_one_sensors_places_and_turns():
    seen = TreeObservations.of(before_a_camera(0, 12)[1])
    assert seen.noise_groups == (
        "camera",
        "camera depth",
        "camera orientation",
        "camera roll orientation",
    )
    assert noise_ties(seen.noise_groups).tolist() == [0, 0, 1, 1]
    assert noise_ties(seen.noise_groups, {3}).tolist() == [0, 0, 1, 2]
    assert noise_ties(seen.noise_groups, {1, 3}).tolist() == [0, 1, 2, 3]
    assert seen.noise_group[:6].tolist() == [0, 0, 1, 2, 2, 3]


@pytest.mark.parametrize("ratio", [0.1, 0.3, 0.8, 1.0, 1.5, 3.0, 10.0])
def test_one_step_promises_half_of_what_a_search_finds_or_more(ratio):
    rng = np.random.default_rng(0)
    rows, J = 400, rng.normal(size=(400, 2))
    sensor = np.arange(rows) % 2
    r = rng.normal(size=rows) * np.where(sensor, ratio, 1.0)
    groups = PoseGroups(np.arange(rows), np.ones(rows, dtype=bool), 1)
    residuals = LinearResiduals(groups, r, J, np.zeros((rows, 1, 1)), sensor[:, None])
    none, joint = np.zeros(1), np.full(1, 1e-3)

    def search(sensors):
        own = replace(residuals, sensor=sensor[:, None] % sensors)
        held = np.zeros(sensors, dtype=bool)
        return VarianceSearch(own, none, none.astype(int), np.full(sensors + 1, 1e-6), held)

    tied = search(1).run(np.ones(1), joint)
    start = np.repeat(tied.sensor, 2)
    gain = search(2).run(start, joint).likelihood - tied.likelihood
    assert search(2).promised(start, joint) > 0.45 * gain


@pytest.mark.parametrize(("rows", "factor"), [(12, 10 / 8), (102, 100 / 98), (5, 2.0)])
def test_a_variance_that_few_freedoms_tell_is_larger_in_the_mean_than_the_likeliest(rows, factor):
    rng = np.random.default_rng(1)
    groups = PoseGroups(np.arange(rows), np.ones(rows, dtype=bool), 1)
    residuals = LinearResiduals(
        groups, rng.normal(size=rows), rng.normal(size=(rows, 2)), np.zeros((rows, 1, 1))
    )
    floor, none = np.full(2, 1e-6), np.zeros(1, dtype=int)
    search = VarianceSearch(residuals, np.zeros(1), none, floor, np.zeros(1, dtype=bool))
    found = search.run(np.ones(1), np.full(1, 1e-3))
    mean = search.expected(found)
    assert float(mean.sensor[0] / found.sensor[0]) ** 2 == pytest.approx(factor, rel=1e-2)
    assert mean.joint == pytest.approx(found.joint, rel=1e-6)


def test_residuals_are_in_frames_of_which_z_is_the_line_of_sight():
    _, data = before_a_camera(3, 12)
    rows = TreeObservations.of(data).sensors[0]
    length = np.linalg.norm(rows.measured[:, :3], axis=1)
    assert_allclose(rows.in_sight[:, :3], length[:, None] * [0.0, 0.0, 1.0], atol=1e-12)
    assert_allclose(
        np.linalg.norm(rows.in_sight[:, 3:], axis=1), np.linalg.norm(rows.measured[:, 3:], axis=1)
    )


def test_the_same_poses_about_another_axis_of_the_camera_tell_the_same():
    _, data = before_a_camera(5, 30)
    turned = transform(rotation_from_vector([0.0, 2.0, 0.0]), np.zeros(3))
    values = data.observations.values
    M = turned @ transform(rotation_from_vector(values[:, 3:6]), values[:, :3])
    one, other = (
        calibrate_tree(flange_dataset(_flanges(data), P)) for P in (inverse(turned) @ M, M)
    )
    assert_allclose(one.tree.markers[0].X_LA, other.tree.markers[0].X_LA, atol=2e-6)
    for name, sigma in one.noise.items():
        assert other.noise[name] == pytest.approx(sigma, rel=0.02)


def _flanges(data):
    return data.X_flange[:, 0]


@pytest.mark.parametrize(
    ("promised", "gain", "told"), [(3.9, 100.0, False), (4.1, 7.9, False), (4.1, 8.1, True)]
)
def test_depth_has_noise_of_its_own_where_a_likelihood_of_eight_says_so(
    monkeypatch, promised, gain, told
):
    seen = TreeObservations.of(before_a_camera(0, 12)[1])
    evidence: Any = SimpleNamespace(data=seen)
    found = Variances(np.array([1.0, 1.0, 2.0, 2.0]), np.ones(6), 0.0)
    finer = Variances(np.array([1.0, 5.0, 2.0, 1.0]), np.ones(6), gain)
    search = SimpleNamespace(promised=promised, run=lambda: finer)
    monkeypatch.setattr(likeliest_noise._GroupedSearch, "of", lambda *_: search)
    kept = likeliest_noise._along_sight(evidence, found, frozenset(), np.zeros(6, dtype=int))
    assert (kept is finer) is told

"""Errors that poses share with poses that are alike: a controller whose arm is not quite right."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from nico_selfmodel.dataset.body.sensors import SensorInfo
from nico_selfmodel.estimation.judging import judge, result_of
from nico_selfmodel.estimation.noise.alike_errors import AlikeErrors, Decorrelation, alike_basis
from nico_selfmodel.estimation.noise.pose_noise import PoseGroups, PoseNoise, PoseWhitening
from nico_selfmodel.estimation.tree.bending_tree import BendingTree
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_setup import Wishes, setup_of
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vectors_of
from nico_selfmodel.geometry.transform import inverse, transform

from .simulated_trees import observed, one_arm
from .test_one_problem import flange_dataset

TURNS = 2
"""Noise group of the turns of a sensor of poses, after its places and their depth."""


def drawn_poses(rng, count):
    return transform(
        rotation_from_vector(0.5 * rng.normal(size=(count, 3))), 0.15 * rng.normal(size=(count, 3))
    )


def test_the_basis_is_the_root_of_what_poses_share():
    X = drawn_poses(np.random.default_rng(0), 80)
    basis = alike_basis(X, 1.4)
    K = basis @ basis.T
    assert basis.shape[1] < 37
    assert np.diag(K) == pytest.approx(np.ones(80), abs=0.2)
    assert 0.97 * 80 < np.trace(K) < 80
    same = alike_basis(np.concatenate([X[:1], X]), 1.4)  # recorded twice: the same error
    assert_allclose(same[0], same[1])
    far = np.linalg.norm(X[:, :3, 3] - X[0, :3, 3], axis=1)
    assert K[0, np.argsort(far)[:5]].mean() > K[0, np.argsort(far)[-5:]].mean() + 0.3


def test_rows_are_whitened_by_all_that_disturbs_them():
    rng = np.random.default_rng(1)
    visits, parts = 12, 3
    A = rng.normal(size=(6 * visits, 1, parts))
    pose = np.repeat(np.arange(visits), 6)
    groups = PoseGroups(pose, np.ones(len(pose), dtype=bool), 1)
    alike = AlikeErrors(rng.normal(size=(visits, 4)), np.array([0.7, 0.0, 0.3]), np.full(3, 0.5))
    plain = PoseWhitening(groups, A, PoseNoise(1.0, alike.alone))
    joined = plain.sharing(alike.columns(A[:, 0], pose)[:, None])
    S = np.eye(len(pose))
    K = alike.basis @ alike.basis.T
    for k in range(parts):
        outer = np.outer(A[:, 0, k], A[:, 0, k])
        shared = alike.sigma[k] ** 2 * K[np.ix_(pose, pose)]
        S += outer * (alike.alone[k] ** 2 * (pose[:, None] == pose) + shared)
    W = joined.white(np.eye(len(pose))[:, None]).reshape(len(pose), -1)
    assert_allclose(W.T @ W, np.linalg.inv(S), atol=1e-10)
    # Of some poses alone what they share with the others is as unknown as what is their own.
    some = pose < 7
    by_row = joined.shared_by_row
    rows = by_row.of_some(W, some)
    assert_allclose(
        rows[:, some].T @ rows[:, some], np.linalg.inv(S[np.ix_(some, some)]), atol=1e-10
    )


def test_nothing_shared_changes_nothing():
    rows = np.random.default_rng(2).normal(size=(9, 4))
    assert_allclose(Decorrelation.of(np.zeros((9, 2)))(rows), rows)


def off_alike(seed, count, turn, place, own=(5e-4, 2e-4)):
    """Flange poses that are off by a smooth function of themselves, and each by its own."""
    rng = np.random.default_rng(seed)
    X, Z = (transform(rotation_from_vector(rng.normal(size=3)), rng.normal(size=3)) for _ in "xz")
    F = drawn_poses(rng, count)
    at = np.hstack([rotation_vectors_of(F[:, :3, :3]) / 0.5, F[:, :3, 3] / 0.15])
    waves = rng.normal(size=(6, 60)) / 1.8
    field = np.cos(at @ waves + rng.uniform(0.0, 2.0 * np.pi, 60)) @ rng.normal(size=(60, 6))
    field *= np.sqrt(2.0 / 60.0) * np.repeat([turn, place], 3)
    field += np.repeat(own, 3) * rng.normal(size=(count, 6))
    told = F @ transform(rotation_from_vector(field[:, :3]), field[:, 3:])
    return X, flange_dataset(told, inverse(Z) @ F @ X)


def squares(seed, count, **how):
    X, data = off_alike(seed, count, **how)
    found = calibrate_tree(data)
    error = found.tree.markers[0].X_LA[:3, 3] - X[:3, 3]
    index = [found.uncertainty.names.index(f"target.{a}") for a in "xyz"]
    C = found.uncertainty.covariance[np.ix_(index, index)]
    return found, error @ np.linalg.solve(C, error) / 3.0


@pytest.mark.slow
def test_error_bars_count_what_a_controllers_poses_share():
    # Counted as each pose's own these are 11 in the mean. Where sixty poses tell of a dozen bumps,
    # how large these are is itself not sure.
    scores = [squares(s, 60, turn=np.radians(0.4), place=2e-3)[1] for s in range(40)]
    assert 0.6 < np.mean(scores) < 2.2


@pytest.mark.slow
def test_errors_that_are_alike_are_told():
    found, _ = squares(3, 60, turn=np.radians(0.4), place=2e-3)
    said = result_of(found).details["alike_errors"]["tcp"]
    assert np.degrees(said["shared_turn"]) == pytest.approx(0.4, rel=0.5)
    assert said["own_turn"] < 0.5 * said["shared_turn"]
    assert 1e3 * said["shared_place"] == pytest.approx(2.0, rel=0.5)
    assert any("off alike in poses alike" in words for words in judge(found).warnings)
    assert found.cross_validation is not None
    none, _ = squares(3, 60, turn=0.0, place=0.0, own=(np.radians(0.1), 5e-4))
    assert result_of(none).details["alike_errors"] == {}


def arm_with_turns_off_alike(seed, turn, alone=1e-3):
    """An arm before a sensor of poses; turns are off by a smooth function of these, and alone."""
    joint = np.radians(0.03)
    sim, rng = one_arm(seed, poses=80, joint_sigma=joint), np.random.default_rng((seed, 7))
    sigma = {"poses": 4e-4, "points": 4e-4, "turn": alone}
    seen = (*(sim.data.joints, sim.data.markers), (SensorInfo("tracker", "poses"),))
    data = observed(sim.tree, *seen, sim.readings_true, rng, sigma=sigma, joint_sigma=joint)
    values = data.observations.values.copy()
    R = rotation_from_vector(values[:, 3:])
    at = np.hstack([R[:, :, 0], R[:, :, 1], values[:, :3] / 0.3])
    waves = np.cos(at @ rng.normal(scale=0.5, size=(9, 60)) + rng.uniform(0.0, 2.0 * np.pi, 60))
    off = turn * np.sqrt(2.0 / 60.0) * waves @ rng.normal(size=(60, 3))
    values[:, 3:] = rotation_vectors_of(rotation_from_vector(off) @ R)
    return sim.tree, replace(data, observations=replace(data.observations, values=values))


def errors_in_sigmas(true, data):
    """Return the solution from the truth, and errors of what is free in standard deviations."""
    parameters = TreeParameters(true)
    setup = setup_of(data, parameters, None, Wishes())
    residuals = TreeResiduals(TreeObservations.of(data), parameters)
    problem = TreeProblem(residuals, setup.free, setup.priors)
    values = parameters.values_of(true)
    found = problem.refine(values)
    C = np.linalg.pinv(found.whitened.T @ found.whitened, rcond=1e-13)
    return found, (found.values - values)[problem.columns] / np.sqrt(np.diag(C))


@pytest.mark.slow
def test_turns_of_a_sensor_that_are_off_alike_are_no_slips_of_joints_and_counted():
    # Taken for each pose's own, squares are 11 in the mean and joints slip.
    squares = []
    for seed in (0, 1):
        found, off = errors_in_sigmas(*arm_with_turns_off_alike(seed, turn=3e-3))
        squares += (off**2).tolist()
        (alike,) = found.noise.alike
        assert alike.turns == TURNS
        assert alike.alone == pytest.approx(np.full(3, 1e-3), rel=0.2)
        assert alike.sigma == pytest.approx(np.full(3, 3e-3), rel=0.5)
        assert found.noise.sensor[TURNS] == pytest.approx(np.hypot(alike.alone, alike.sigma)[0])
        assert not found.slipped.any()
    assert 0.4 < np.mean(squares) < 2.0


def test_sound_turns_of_a_sensor_share_nothing():
    for seed in (0, 1):
        found, _ = errors_in_sigmas(*arm_with_turns_off_alike(seed, turn=0.0))
        assert not found.noise.alike


@pytest.mark.slow
def test_turns_of_a_sensor_that_are_off_alike_are_told():
    found = calibrate_tree(arm_with_turns_off_alike(2, turn=3e-3)[1], effects=())
    said = result_of(found).details["alike_errors"]["tracker"]
    assert said["shared_turn"] > 2.0 * said["own_turn"]
    assert set(said) == {"shared_turn", "own_turn"}
    (words,) = (words for words in judge(found).warnings if "off alike in poses alike" in words)
    assert words.startswith("how 'tracker' takes markers to be turned is off")


@pytest.mark.slow
def test_effects_are_weighed_beside_what_turns_of_a_sensor_share():
    found = calibrate_tree(arm_with_turns_off_alike(2, turn=3e-3)[1], effects=())
    bend = found.ladder.solution
    (alike,) = bend.solution.noise.alike
    body = BendingTree(bend)
    free, noise = bend.problem.free_names, bend.solution.noise
    weighed = body.weighed(body.posture, free, noise)
    shared = weighed.U.shape[1] - len(free)
    assert shared == 3 * alike.basis.shape[1]
    # What is left beside shared errors as parameters is what is left of rows that they correlate.
    step = np.linalg.lstsq(weighed.U, weighed.u, rcond=1e-12)[0]
    left = float(np.sum((weighed.u - weighed.U @ step) ** 2))
    assert left == pytest.approx(float(bend.solution.rest @ bend.solution.rest), rel=1e-3)
    apart = replace(weighed, noise=noise.own).log_determinant
    E = bend.solution.shared.E
    more = np.linalg.slogdet(np.eye(E.shape[1]) + E.T @ E)[1]
    assert weighed.log_determinant - apart == pytest.approx(more, rel=1e-6)
    again = weighed.likeliest(np.zeros(len(free)), np.full(len(free), np.inf))
    np.testing.assert_allclose(again.alike[0].sigma, alike.sigma)
    np.testing.assert_allclose(again.sensor, noise.sensor, rtol=0.05)


@pytest.mark.slow
def test_error_bars_count_what_turns_of_a_sensor_share():
    off = [errors_in_sigmas(*arm_with_turns_off_alike(s, 3e-3))[1] for s in range(10, 30)]
    assert 0.8 < np.mean(np.concatenate(off) ** 2) < 1.25

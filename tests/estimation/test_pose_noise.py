"""Noise of sensor and joints: one draw a pose, whitened together, variances by likelihood."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.noise.noise_variances import most_likely_noise
from nico_selfmodel.estimation.noise.pose_groups import PoseGroups
from nico_selfmodel.estimation.noise.pose_noise import PoseNoise, PoseWhitening
from nico_selfmodel.estimation.noise.variance_components import LinearResiduals


def grouped(seed=0, visits=30, markers=3, joints=4, missing=0.3):
    """Return visits, which rows count, and slopes by the joint angles."""
    rng = np.random.default_rng(seed)
    visit = np.repeat(np.arange(visits), markers)
    order = rng.permutation(len(visit))
    keep = rng.random(len(visit)) > missing
    return visit[order], keep, rng.normal(size=(len(visit), 3, joints))


def dense(visit, rows, by_angle, noise):
    """Return S of the rows that count, formed as it is written. Shape (3K, 3K)."""
    A = by_angle[rows] * noise.joint_sigma
    S = np.einsum("aij,bkj->aibk", A, A) * (visit[rows][:, None] == visit[rows])[:, None, :, None]
    return S.reshape(3 * len(rows), -1) + noise.sensor_sigma**2 * np.eye(3 * len(rows))


@pytest.mark.parametrize("markers", [1, 3])  # fewer coordinates than joints, and more
@pytest.mark.parametrize("joint", [0.0, 1e-6, 0.01, 3.0])
def test_whitening_and_inverse_are_those_of_the_whole_covariance(joint, markers):
    visit, keep, by_angle = grouped(markers=markers)
    noise = PoseNoise(0.02, joint * np.array([1.0, 0.0, 2.0, 0.5]))
    groups = PoseGroups(visit, keep, 3)
    whitening = PoseWhitening(groups, by_angle, noise)
    S = dense(visit, groups.rows, by_angle, noise)
    x = np.random.default_rng(1).normal(size=(len(visit), 3, 2))
    flat = x[groups.rows].reshape(-1, 2)
    white = groups.scatter(whitening.root(groups.gather(x)))
    solved = groups.scatter(whitening.inverse(groups.gather(x)))
    assert not white[~keep].any()
    assert solved[keep].reshape(-1, 2) == pytest.approx(np.linalg.solve(S, flat), rel=1e-8)
    white = white[keep].reshape(-1, 2)
    assert white.T @ white == pytest.approx(flat.T @ np.linalg.solve(S, flat), rel=1e-9)
    assert whitening.log_determinant == pytest.approx(np.linalg.slogdet(S)[1], rel=1e-9)
    taken = groups.scatter(whitening.taken)[keep].ravel()
    assert taken == pytest.approx(1.0 - 0.02**2 * np.diag(np.linalg.inv(S)), abs=1e-8)


@pytest.mark.parametrize("markers", [1, 3])
def test_joint_errors_are_what_a_pose_tells_of_its_joints(markers):
    visit, keep, by_angle = grouped(3, markers=markers)
    noise = PoseNoise(0.02, np.array([0.1, 0.0, 0.2, 0.05]))
    groups = PoseGroups(visit, keep, 3)
    r = np.random.default_rng(2).normal(scale=0.05, size=(len(visit), 3))
    mean, spread = PoseWhitening(groups, by_angle, noise).joint_errors(r)
    own = groups.rows[groups.pose == 5]
    B = (by_angle[own] * noise.joint_sigma).reshape(-1, 4) / noise.sensor_sigma
    G = np.eye(4) + B.T @ B
    assert mean[5] == pytest.approx(np.linalg.solve(G, B.T @ r[own].ravel() / 0.02), rel=1e-9)
    assert spread[5] == pytest.approx(np.linalg.inv(G), abs=1e-10)


def test_the_order_of_rows_does_not_matter():
    visit, keep, by_angle = grouped(2)
    noise = PoseNoise(0.02, np.full(4, 0.01))
    x = np.random.default_rng(1).normal(size=(len(visit), 3, 2))
    order = np.random.default_rng(5).permutation(len(visit))

    def whitened(rows):
        groups = PoseGroups(visit[rows], keep[rows], 3)
        found = PoseWhitening(groups, by_angle[rows], noise)
        return groups.scatter(found.inverse(groups.gather(x[rows])))

    assert whitened(order) == pytest.approx(whitened(np.arange(len(visit)))[order], rel=1e-9)


def test_all_visits_of_a_pose_together_count_as_one():
    groups = PoseGroups(np.array([0, 1, 1, 2, 3]), np.ones(5, bool), 3, np.array([0, 1, 1, 0, 0]))
    assert groups.weight == pytest.approx([1 / 3, 1.0, 1 / 3, 1 / 3])


def drawn(seed, sensor, joint, visits=80, markers=2, parameters=12):
    """Return residuals of a linear fit whose noise has these standard deviations."""
    rng = np.random.default_rng(seed)
    joint = np.asarray(joint, dtype=float)
    visit = np.repeat(np.arange(visits), markers)
    by_angle = rng.normal(scale=0.3, size=(len(visit), 3, len(joint)))
    delta = rng.normal(size=(visits, len(joint))) * joint
    r = np.einsum("nij,nj->ni", by_angle, delta[visit]) + sensor * rng.normal(size=(len(visit), 3))
    J = rng.normal(size=(len(visit), 3, parameters))
    flat, target = J.reshape(-1, parameters), r.ravel()
    r = (target - flat @ np.linalg.lstsq(flat, target)[0]).reshape(-1, 3)
    groups = PoseGroups(visit, np.ones(len(visit), dtype=bool), 3)
    return LinearResiduals(groups, groups.gather(r), groups.gather(J), by_angle)


def test_variances_are_found_without_the_bias_of_what_the_fit_took():
    start = PoseNoise(1e-3, np.full(4, 1e-3))
    found = [
        most_likely_noise(drawn(seed, 2e-4, [4e-3] * 4, visits=30), start, np.zeros(4))
        for seed in range(60)
    ]
    sensor = np.array([noise.sensor_sigma**2 for noise in found])
    joint = np.array([noise.joint_sigma[0] ** 2 for noise in found])
    assert sensor.mean() == pytest.approx(4e-8, rel=0.06)
    assert joint.mean() == pytest.approx(16e-6, rel=0.06)


@pytest.mark.slow
def test_numbers_that_are_known_beforehand_take_less_out_of_the_residuals():
    """As many numbers as half the coordinates: as free ones they leave half, as known ones more."""
    start, v = PoseNoise(1e-3, np.full(2, 1e-3)), (1e-5) ** 2

    def sigmas(information):
        found = []
        for seed in range(40):
            rng = np.random.default_rng((seed, 7))
            free = drawn(seed, 2e-4, [4e-3] * 2, visits=30, parameters=90)
            e = 2e-4 * rng.normal(size=(free.groups.poses, 6, 1)) + free.by_angle.reshape(
                free.groups.poses, -1, 2
            ) @ (4e-3 * rng.normal(size=(free.groups.poses, 2, 1)))
            r = e.ravel() + free.J @ rng.normal(scale=np.sqrt(v), size=90)
            known = replace(free, r=r, information=information)
            found.append(most_likely_noise(known, start, np.zeros(2)).sensor_sigma ** 2)
        return np.array(found)

    known, free = sigmas(np.full(90, 1.0 / v)), sigmas(None)
    assert known.mean() == pytest.approx(4e-8, rel=0.1)
    assert known.std() < 0.85 * free.std()


def test_joints_have_variances_of_their_own_only_where_the_data_ask_for_it():
    start = PoseNoise(1e-3, np.full(3, 1e-3))
    alike = [
        most_likely_noise(drawn(s, 2e-4, [3e-3] * 3), start, np.zeros(3), apart=True)
        for s in range(40)
    ]
    assert sum(np.ptp(noise.joint_sigma) > 1e-9 for noise in alike) <= 1
    differing = most_likely_noise(
        drawn(0, 2e-4, [1e-3, 1e-2, 3e-3]), start, np.zeros(3), apart=True
    )
    assert differing.joint_sigma == pytest.approx([1e-3, 1e-2, 3e-3], rel=0.35)


def test_what_is_known_of_the_joints_is_part_of_their_noise():
    start = PoseNoise(1e-3, np.full(3, 1e-3))
    known = np.array([9e-6, 0.0, 0.0])
    found = most_likely_noise(drawn(0, 2e-4, [3e-3, 1e-9, 1e-9]), start, known)
    assert found.joint_sigma[0] == pytest.approx(3e-3, rel=0.05)
    assert found.joint_sigma[1:].max() < 3e-4


def test_visits_of_many_rows_cost_those_of_few_no_empty_places():
    visit = np.concatenate([np.arange(100), np.zeros(30, dtype=int), np.ones(25, dtype=int)])
    groups = PoseGroups(visit, np.ones(len(visit), dtype=bool), 3)
    assert len(groups.visit) <= 3 * len(visit) + 15
    values = np.random.default_rng(0).normal(size=(len(visit), 3, 2))
    np.testing.assert_array_equal(groups.scatter(groups.gather(values)), values)
    flat = groups.gather(values)
    expected = [flat[groups.visit == k].T @ flat[groups.visit == k] for k in range(100)]
    np.testing.assert_allclose(groups.products(flat, flat), expected, atol=1e-12)


def test_where_no_row_counts_there_is_nothing_to_whiten():
    groups = PoseGroups(np.array([0, 0, 1]), np.zeros(3, dtype=bool), 3)
    whitening = PoseWhitening(groups, np.ones((3, 3, 2)), PoseNoise(1.0, np.ones(2)))
    assert whitening.root(groups.gather(np.ones((3, 3, 4)))).shape == (0, 4)
    assert whitening.taken.shape == (0,)
    assert whitening.log_determinant == 0.0
    assert not groups.scatter(np.zeros((0, 4))).any()

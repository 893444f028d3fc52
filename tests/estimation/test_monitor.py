"""The statistic of Shiryaev and Roberts, and what a pose says for a change."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.monitoring.monitor import (
    HEAD_START,
    THRESHOLD,
    Monitor,
    chance_of_false_alarm,
)
from nico_selfmodel.estimation.monitoring.monitored_changes import LARGEST_STEP, monitored_changes
from nico_selfmodel.estimation.noise.hand_observations import covariance_of, hand_observations_of
from nico_selfmodel.estimation.noise.mixture_density import MixtureDensity
from nico_selfmodel.estimation.noise.pose_residuals import PoseResiduals

from .simulated_bodies import body, learned, only_cameras, poses

JUMPS = np.array([-2.0, -1.0, 1.0, 2.0])


def steps_of(x):
    """Return ln N(x; h, 1) / N(x; 0, 1) for every h."""
    return np.outer(x, JUMPS) - 0.5 * JUMPS**2


@pytest.mark.slow
def test_no_more_false_alarms_than_theory_allows_and_not_far_fewer():
    rng, limit, poses_each, runs = np.random.default_rng(0), 5.0, 60, 1500
    alarms = 0
    for _ in range(runs):
        monitor = Monitor.of(np.full(4, 0.25))
        for step in steps_of(rng.normal(size=poses_each)):
            monitor = monitor.after(step)
            if monitor.log_ratio > limit:
                alarms += 1
                break
    bound = (poses_each + HEAD_START) * np.exp(-limit)
    assert 0.2 * bound < alarms / runs < bound
    assert chance_of_false_alarm(60) == pytest.approx(bound * np.exp(limit - THRESHOLD))
    assert chance_of_false_alarm(10**9) == 1.0
    assert chance_of_false_alarm(100) < 0.006


def test_a_change_raises_the_alarm_and_its_first_pose_is_found():
    rng = np.random.default_rng(1)
    delays, first = [], []
    for _ in range(50):
        x = np.concatenate([rng.normal(size=40), 2.0 + rng.normal(size=40)])
        monitor = Monitor.of(np.full(4, 0.25))
        for step in steps_of(x):
            monitor = monitor.after(step)
            if monitor.alarm:
                break
        delays.append(monitor.poses - 40)
        first.append(monitor.changed_at)
    # Lorden: at least (threshold + what four hypotheses cost) / information of 2 nats a pose.
    assert 5.0 < np.mean(delays) < 8.0
    assert np.median(first) == pytest.approx(40, abs=1)


def test_a_change_before_the_first_pose_is_seen_sooner_than_one_in_between():
    late = Monitor.of(np.ones(1))
    for _ in range(40):
        late = late.after(np.full(1, -2.0))
    early = Monitor.of(np.ones(1))
    assert early.log_ratio == pytest.approx(np.log(HEAD_START))
    assert early.after(np.full(1, 3.0)).log_ratio > late.after(np.full(1, 3.0)).log_ratio + 2.0


@pytest.fixture(scope="module")
def watched():
    model = learned(0).model
    seen = PoseResiduals.of(hand_observations_of(model, only_cameras(poses(body(), 60))))
    return model, seen, monitored_changes(model, seen.names)


def test_the_changes_looked_for_weigh_one_in_all(watched):
    _, seen, changes = watched
    assert changes.weights.sum() == pytest.approx(1.0)
    assert (changes.weights > 0.0).all()
    # Jumps and gears of four joints, 28 shifts of the point, two cameras, anything.
    assert len(changes) == 4 * 4 + 4 * 2 + 28 + 12 + 2
    moved = seen.slopes @ changes.basis
    assert (np.abs(moved).max(axis=(0, 1)) > 1.0).all()


def test_what_healthy_poses_say_is_no_larger_than_chance_in_the_mean(watched):
    """E exp(l) is 1 at most while nothing changed: that is what bounds the false alarms."""
    model, seen, changes = watched
    noise = model.noise_mixtures["pixels"]
    density = MixtureDensity(seen, noise, covariance_of(model, seen.names))
    steps = changes.steps(density, seen.residuals, seen.slopes)
    assert changes.weights @ np.exp(steps).mean(axis=0) < 1.2


def steps_at(watched, residuals):
    """Return what poses with other residuals would say for each change."""
    model, seen, changes = watched
    noise = model.noise_mixtures["pixels"]
    density = MixtureDensity(seen, noise, covariance_of(model, seen.names))
    return changes.steps(density, residuals, seen.slopes)


def test_what_lies_far_off_says_only_that_all_may_be_far_off_from_now_on(watched):
    """... and that no more than it says for an outlier: one of them raises no alarm."""
    model, seen, changes = watched
    said = steps_at(watched, seen.residuals + 300.0)
    assert np.abs(said[:, :-1]).max() < 0.1
    most = -np.log(model.noise_mixtures["pixels"].outlier_share)
    assert said[:, -1].max() == pytest.approx(most)
    monitor = Monitor.of(changes.weights).after(said.max(axis=0))
    assert not monitor.alarm
    assert monitor.after(said.max(axis=0)).alarm


def test_a_pose_where_a_change_puts_it_says_much_and_raises_no_alarm_alone(watched):
    _, seen, changes = watched
    jump = int(np.argmax(np.abs(seen.slopes @ changes.basis).max(axis=(0, 1))))
    said = steps_at(watched, seen.slopes @ changes.basis[:, jump])
    assert said[:, jump].max() == LARGEST_STEP == 6.0
    monitor = Monitor.of(changes.weights).after(np.full(len(changes), LARGEST_STEP))
    assert not monitor.alarm
    assert monitor.after(np.full(len(changes), LARGEST_STEP)).alarm


def test_false_detections_are_cauchy_about_the_tail(watched):
    model, seen, _ = watched
    noise = model.noise_mixtures["pixels"]
    density = MixtureDensity(seen, noise)
    (whole,) = np.flatnonzero(seen.dof == 4)[:1]
    S = np.linalg.inv(density.whitening[1, whole].T @ density.whitening[1, whole])
    r = seen.residuals[whole] + 500.0
    # Gamma(5 / 2) / Gamma(1 / 2) = 3 / 4
    far = (1.0 + r @ np.linalg.solve(S, r)) ** -2.5
    u = 0.75 / np.pi**2 / np.sqrt(np.linalg.det(S)) * far
    found = density.log_false(seen.residuals + 500.0)[whole] - 2.0 * np.log(2.0 * np.pi)
    assert found == pytest.approx(np.log(u))


@pytest.mark.parametrize("corners", [1, 5])
def test_poses_that_fit_better_than_expected_are_no_false_detections(watched, corners):
    """Of many coordinates a Cauchy distribution is far denser in its middle than the tail."""
    model, seen, changes = watched
    whole = np.flatnonzero(seen.dof == 4)
    own = [np.tile(one[whole], (1, corners, *[1] * (one.ndim - 2))) for one in
           (seen.residuals, seen.slopes, seen.by_angle, seen.by_side, seen.seen)]  # fmt: skip
    residuals, slopes, by_angle, by_side, shown = own
    poses = replace(
        seen, residuals=0.0 * residuals, slopes=slopes, by_angle=by_angle, by_side=by_side,
        seen=shown, sample=seen.sample[whole],
    )  # fmt: skip
    density = MixtureDensity(poses, model.noise_mixtures["pixels"])
    said = changes.steps(density, poses.residuals, poses.slopes)
    assert said[:, -1].max() < -1.0
    far = density.log_false(residuals + 1e3)
    assert (far < density.log_false(poses.residuals) - 1.0).all()

"""A sensor, or an encoder, that is of another moment than the rest of a recording is named."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.sensors import SensorInfo
from nico_selfmodel.estimation.diagnosis.changes_in_time import Change
from nico_selfmodel.estimation.diagnosis.lag_in_time import (
    Steps,
    lag_taken_for_noise,
    late_together,
    they_explain,
)
from nico_selfmodel.estimation.diagnosis.score_test import Score, ScoreTest
from nico_selfmodel.estimation.judging import judge, result_of
from nico_selfmodel.estimation.results.calibration_result import CAUSE, FAILURE, WARNING
from nico_selfmodel.estimation.tree.timing import late_sensors as module
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vectors_of
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.tree.body_tree import WORLD, Attached

from ..slow_rest import slow_rest
from .simulated_trees import observed, one_arm
from .test_one_problem import flange_dataset, hand_eye_poses

POSES = 50
SIGMA = {"points": 2e-4, "camera": 0.3}


def path(rng, n, *, smooth):
    if not smooth:
        return rng.uniform(-1.2, 1.2, size=(POSES, n))
    phase, period = rng.uniform(0.0, 6.3, size=(2, n)), rng.uniform(8.0, 30.0, size=(2, n))
    waves = np.sin(2.0 * np.pi * np.arange(POSES)[:, None, None] / period + phase)
    return 0.7 * waves.sum(axis=1)


def before(q, part):
    """Where joints were a part of a step before each pose, or after it."""
    other = np.vstack([q[:1], q[:-1]]) if part > 0.0 else np.vstack([q[1:], q[-1:]])
    return q + abs(part) * (other - q)


def recorded(seed, *, smooth, late=None, joint=None, lag=0.0, sensor="points"):
    """An arm of three joints; a sensor sees it late, or an encoder reads it late."""
    rng, made = np.random.default_rng(seed), one_arm(seed, joints=3, markers=2, sensor=sensor)
    q, data = path(rng, 3, smooth=smooth), made.data
    how = {"joint_sigma": np.radians(0.05), "sigma": SIGMA}
    of = made.tree, data.joints, data.markers, data.sensors
    now, then = (observed(*of, at, rng, **how) for at in (q, before(q, lag)))
    if joint is not None:
        readings = now.readings.copy()
        readings[:, joint] = then.readings[:, joint]
        return replace(now, readings=readings)
    values, own = now.observations.values.copy(), now.observations.sensor == (late or 0)
    if late is None:
        own[:] = True
    values[own] = then.observations.values[own]
    table = replace(now.observations, values=values)
    return replace(now, observations=table)


def told(words):
    return float(re.search(r"by about ([\d.]+) of the time", words).group(1))


@pytest.mark.parametrize(
    ("smooth", "lag"),
    slow_rest([(True, 0.05), (False, 0.05), (True, -0.02), (False, 0.01), (True, 0.3)]),
)
def test_a_tracker_of_another_moment_is_the_cause_with_how_far(smooth, lag):
    found = calibrate_tree(recorded(1, smooth=smooth, lag=lag), effects=())
    verdict = judge(found)
    assert verdict.status == "FAIL"
    verb = "lags behind" if lag > 0.0 else "leads"
    assert verdict.reasons[0].startswith(f"what 'tracker' saw {verb} the readings")
    assert told(verdict.reasons[0]) == pytest.approx(abs(lag), rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("late", [0, None])
def test_of_two_cameras_the_late_one_is_named_or_both(late):
    found = calibrate_tree(
        recorded(2, smooth=True, lag=0.05, late=late, sensor="cameras"), effects=()
    )
    subject = "what all sensors saw" if late is None else "what 'left' saw"
    assert found.late.what.startswith(f"{subject} lags behind the readings")
    assert told(found.late.what) == pytest.approx(0.05, rel=0.2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("joints", "late"), [(3, "cameras"), (4, "cameras"), (3, "right"), (3, "tracker")]
)
def test_cameras_of_one_moment_are_named_beside_a_tracker_and_it_is_not(joints, late):
    """All three were said to lag, or none."""
    how = {"joints": joints, "markers": 4, "sensor": "cameras"}
    made, rng = one_arm(2, **how), np.random.default_rng(2)
    tree = replace(made.tree, sensors=(*made.tree.sensors, Attached("tracker", WORLD, np.eye(4))))
    sensors = (*made.data.sensors, SensorInfo("tracker", "points"))
    noise = {"joint_sigma": np.radians(0.05), "sigma": SIGMA}
    q, of = path(rng, joints, smooth=False), (tree, made.data.joints, made.data.markers, sensors)
    now, then = (observed(*of, at, rng, **noise) for at in (q, before(q, 0.25)))
    table, sees_late = now.observations, {"cameras": [0, 1], "right": [1], "tracker": [2]}[late]
    own = np.isin(table.sensor, sees_late)
    values = np.where(own[:, None], then.observations.values, table.values)
    seen = replace(now, observations=replace(table, values=values))
    seen = seen.of_rows((table.sensor < 2) | (table.marker == 0))  # of which it sees one
    found = calibrate_tree(seen, effects=())
    named = {sensors[s].name for s in sees_late}
    assert set(re.findall(r"what '(\w+)' saw lags behind", found.late.what)) == named
    assert "all sensors" not in found.late.what
    assert told(found.late.what) == pytest.approx(0.25, rel=0.3)  # of a jump it is told roughly


class Told:
    """A score test of which lags and their standard scores are given, by sensor."""

    def __init__(self, scores):
        self.scores, self.redundancy = scores, 100

    def of(self, columns):
        values = np.array([self.scores[int(k)] for k in columns.ravel()])
        return Score(float(np.sum(values**2)), len(values), values, np.ones(len(values)), 0, 1)


@pytest.mark.parametrize(
    ("scores", "named"),
    [
        ((5.34, 9.0, 1.0), "ab"),
        ((5.32, 9.0, 1.0), ""),
        ((5.34, 9.0, -9.0), "ab"),
        ((6.0, 6.0, 6.0), ""),
        ((1.0, 9.0, 1.0), ""),
        ((6.0, 6.0, 6.0, 1.0), "abc"),
    ],
)
def test_several_lag_and_not_all_where_each_surely_does_beside_the_others(scores, named):
    suspects = [
        SimpleNamespace(name=name, lags=lags, column=np.full((1, 1, 1), k if lags else -1))
        for lags in (True, False)
        for k, name in zip(range(len(scores)), "abcd", strict=False)
    ]
    found = late_together(Told({-1: 0.0, **dict(enumerate(scores))}), suspects)
    assert "".join(one.name for one in found) == named
    assert all(one.lags for one in found)


@pytest.mark.parametrize(
    ("scores", "alone", "beside", "left", "do"),
    [
        ((8.0, 8.0), 90.0, (3.0, 3.0), 15, True),
        ((8.0, 8.0), 99.0, (3.0, 3.0), 1000, True),
        ((8.0, 8.0), 101.0, (3.0, 3.0), 1000, False),
        ((8.0, 8.0), 90.0, (2.6, 2.6), 1000, False),
        ((8.0, 8.0), 90.0, (3.0, 3.0), 14, False),
    ],
)
def test_several_explain_more_than_one_by_what_each_more_must_and_what_no_time_does(
    scores, alone, beside, left, do
):
    found = [SimpleNamespace(column=np.full((1, 1, 1), k)) for k in range(2)]
    both = [Told(dict(enumerate(one))) for one in (scores, beside)]
    both[0].redundancy, both[1].redundancy = 1e6, left
    singly = np.array([alone, 500.0]), np.array([0.1, -0.1])
    assert they_explain(*both, found, singly) is do


@pytest.mark.slow
@pytest.mark.parametrize("lag", [0.05, 0.1])
def test_an_encoder_that_is_late_is_named_and_no_sensor(lag):
    found = calibrate_tree(recorded(3, smooth=False, joint=1, lag=lag), effects=())
    assert found.late.what.startswith("the readings of 'j2' lag behind what was seen")
    assert found.late.what.count("about") == 1
    assert told(found.late.what) == pytest.approx(lag, rel=0.3)


class OfOneJoint:
    """Residuals of one number a sample, off by a joint's errors alone, which count as its noise."""

    def __init__(self, errors):
        self.residuals, self.by_angle = errors[:, None], np.ones((len(errors), 1, 1))
        self.rows, self.whitened_residuals = np.arange(len(errors)), errors

    def whitened(self, columns):
        return columns[:, 0]


@pytest.mark.parametrize(
    ("lag", "side", "told"), [(0.02, 0.0, True), (0.002, 0.0, False), (0.0, 0.01, False)]
)
def test_errors_of_a_joint_read_worse_than_others_are_its_lag_where_no_place_or_side_is(
    lag, side, told
):
    rng = np.random.default_rng(7)
    q = path(rng, 1, smooth=True)
    step = np.diff(q, axis=0, prepend=q[:1])
    errors = (-lag * step + side * np.sign(step))[:, 0] + 1.2e-3 * rng.normal(size=POSES)
    linear = OfOneJoint(errors)
    test = ScoreTest(linear, np.ones((POSES, 1, 1)))
    every = np.arange(POSES)
    found = lag_taken_for_noise(Steps.of(every, q), test, "elbow", 0, errors, every)
    assert (found is not None) is told
    assert not told or found.what.startswith("the readings of 'elbow' l")


@pytest.mark.slow
def test_an_encoder_of_a_smooth_recording_is_late_though_its_noise_explains_it():
    rng, made = np.random.default_rng(4), one_arm(4, joints=6, markers=3)
    q, data = path(rng, 6, smooth=True), made.data
    how = {"joint_sigma": np.radians(0.01), "sigma": SIGMA}
    now = observed(made.tree, data.joints, data.markers, data.sensors, q, rng, **how)
    readings = np.array(q)
    readings[:, 3] = before(q, 0.05)[:, 3]
    found = calibrate_tree(replace(now, readings=readings), effects=())
    assert 3 in found.solution.noise.loud
    assert found.late.what.startswith("the readings of 'j4' lag behind what was seen")
    assert told(found.late.what) == pytest.approx(0.05, rel=0.2)


@pytest.mark.parametrize(
    ("seed", "smooth"), slow_rest([(s, how) for s in range(4, 10) for how in (True, False)])
)
def test_nothing_is_late_of_a_sound_recording(seed, smooth):
    assert calibrate_tree(recorded(seed, smooth=smooth), effects=()).late is None


@pytest.mark.slow
@pytest.mark.parametrize("what", slow_rest(["backlash", "gear", "eccentric"]))
def test_what_depends_on_place_or_side_is_not_late(what):
    rng, made = np.random.default_rng(11), one_arm(11, joints=3, markers=2)
    q, data = path(rng, 3, smooth=False), made.data
    side = np.sign(np.diff(q, axis=0, prepend=q[:1] - 1.0))
    off = {"gear": 0.01 * q, "backlash": -2e-3 * side, "eccentric": 5e-3 * np.sin(q + 1.0)}[what]
    how = {"joint_sigma": np.radians(0.02), "sigma": SIGMA}
    seen = observed(made.tree, data.joints, data.markers, data.sensors, q + off, rng, **how)
    assert calibrate_tree(replace(seen, readings=q), effects=()).late is None


@pytest.mark.slow
def test_a_camera_that_sees_a_hand_later_than_its_controller_tells_is_late():
    rng = np.random.default_rng(5)
    X, Z, F, _ = hand_eye_poses(rng, 40)
    turns = np.cumsum(0.2 * rng.normal(size=(40, 3)), axis=0)
    F = transform(rotation_from_vector(turns), 0.05 * np.cumsum(rng.normal(size=(40, 3)), axis=0))
    step = rotation_vectors_of(np.swapaxes(F[:-1, :3, :3], 1, 2) @ F[1:, :3, :3])
    then = F.copy()
    then[1:, :3, :3] = F[1:, :3, :3] @ rotation_from_vector(-0.2 * step)
    then[1:, :3, 3] -= 0.2 * np.diff(F[:, :3, 3], axis=0)
    noise = transform(
        rotation_from_vector(np.radians(0.1) * rng.normal(size=(40, 3))),
        5e-4 * rng.normal(size=(40, 3)),
    )
    for flanges, late in ((then, True), (F, False)):
        found = calibrate_tree(flange_dataset(F, inverse(Z) @ flanges @ X @ noise)).late
        assert (found is not None) == late
        if found is not None:
            assert found.what.startswith("what 'camera' saw lags behind the readings")
            assert told(found.what) == pytest.approx(0.2, rel=0.2)


@pytest.mark.slow
def test_held_out_samples_tell_how_joints_moved_between_the_others():
    train, test = recorded(6, smooth=False, lag=0.02).split(0.4, seed=0)
    alone, together = (calibrate_tree(train, test=t, effects=()).late for t in (None, test))
    assert alone is None or together.ratio > alone.ratio
    assert told(together.what) == pytest.approx(0.02, rel=0.2)


@pytest.mark.parametrize(
    ("ratio", "kind"), [(1.51, CAUSE), (1.49, FAILURE), (1.11, FAILURE), (1.09, WARNING)]
)
def test_a_lag_is_the_cause_a_failure_or_a_word_by_what_it_explains(sound, ratio, kind):
    late = replace(sound, late=Change("what 'tracker' saw lags", ratio))
    kinds = [one.severity for one in result_of(late).findings if "saw lags" in one.text]
    assert kinds == [kind]


@pytest.fixture(scope="module")
def sound():
    return calibrate_tree(recorded(12, smooth=False), effects=())


@pytest.mark.slow
def test_a_recording_of_few_poses_is_not_asked(sound):
    problem, solution = sound.ladder.solution.problem, sound.ladder.solution.solution
    unknown = SimpleNamespace(variances_known=False)
    assert module.late_sensors(problem, unknown) is None
    few = recorded(1, smooth=False, lag=0.05)
    assert calibrate_tree(few.select(np.arange(POSES) < 19), effects=()).late is None
    assert module.late_sensors(problem, solution) is None

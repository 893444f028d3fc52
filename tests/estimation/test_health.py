"""Does the body still fit, and what changed."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import EstimationError, ModelError
from nico_selfmodel.estimation.arm.evaluation import evaluate
from nico_selfmodel.estimation.body.workspace_accuracy import workspace_accuracy
from nico_selfmodel.estimation.monitoring.health import ENOUGH, check_health
from nico_selfmodel.estimation.monitoring.health_document import health_document
from nico_selfmodel.estimation.monitoring.monitor import Monitor
from nico_selfmodel.estimation.monitoring.relearning import relearn_cause
from nico_selfmodel.estimation.noise.hand_observations import covariance_of, hand_observations_of

from .joined_data import joined_data
from .simulated_bodies import blinded, body, learned, only_cameras, poses, scenario


@pytest.fixture(scope="module")
def model():
    return learned(0).model


def changed(what, *arguments, count=15, seed=3):
    one = body()
    getattr(one.faults, what)(*arguments)
    return poses(one, count, seed=seed)


def test_a_healthy_body_raises_no_alarm_and_its_innovations_are_as_expected(model):
    report = check_health(model, only_cameras(poses(body(), 200)))
    assert report.healthy
    assert report.diagnoses == ()
    assert np.mean(report.nis / report.dof) == pytest.approx(1.0, abs=0.15)
    assert (report.dof == 4).all()
    assert health_document(report)["status"] == "PASS"


@pytest.mark.parametrize("joint", [0, 1, 3])
@pytest.mark.parametrize("angle", [2.0, -2.0])
def test_a_slip_of_two_degrees_is_seen_and_named(model, joint, angle):
    name = model.joints[joint]
    report = check_health(model, only_cameras(changed("slip", name, np.radians(angle))))
    assert report.alarm_at is not None
    assert report.alarm_at <= 4
    best = report.diagnoses[0]
    assert best.hypothesis.cause == f"zero of {name}"
    assert best.hypothesis.names == (f"{name}.theta_offset",)
    assert best.statistic > 30.0
    gear = model.servos.gear[joint]
    shift = np.degrees(-best.change[0] / gear)
    assert shift == pytest.approx(angle, abs=4.0 * np.degrees(best.sigma[0] / gear))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "arguments", "cause"),
    [
        ("take_tool", ([0.0, 0.01, -0.03],), "point hand on the hand"),
        ("bump_camera", ([0.01, 0.01, 0.0],), "pose of the right camera"),
        ("change_gear", ("right_elbow", 1.06), "gear of right_elbow"),
    ],
)
def test_other_changes_are_told_apart_too(model, what, arguments, cause):
    report = check_health(model, only_cameras(changed(what, *arguments, count=20)))
    assert not report.healthy
    assert report.diagnoses[0].hypothesis.cause == cause
    assert report.diagnoses[0].score > report.diagnoses[1].score


@pytest.mark.slow
def test_the_time_of_a_change_within_a_recording_is_found(model):
    before = only_cameras(poses(body(), 40))
    after = only_cameras(changed("slip", "right_shoulder_roll", np.radians(3.0)))
    report = check_health(model, joined_data(before, after))
    assert report.changed_at == pytest.approx(40, abs=1)
    assert 40 <= report.alarm_at <= 42
    assert report.sure
    document = health_document(report)
    assert document["status"] == "FAIL"
    assert document["causes"][0]["cause"] == "zero of right_shoulder_roll"
    assert document["changed_at"] == pytest.approx(41, abs=1)


@pytest.mark.slow
def test_measured_points_serve_as_well(model):
    healthy = replace(poses(body(), 60), pixels=None)
    assert check_health(model, healthy).healthy
    slipped = replace(changed("slip", "right_elbow", np.radians(3.0)), pixels=None)
    report = check_health(model, slipped)
    assert report.diagnoses[0].hypothesis.cause == "zero of right_elbow"
    assert (report.dof == 3).all()
    assert not any(
        "camera" in d.hypothesis.cause and "pose" in d.hypothesis.cause for d in report.diagnoses
    )


@pytest.mark.slow
def test_a_model_learned_from_points_watches_points():
    from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics

    data = scenario().test
    model = calibrate_kinematics(data.select(np.arange(70))).model
    assert check_health(model, data.select(np.arange(70, 100))).healthy
    moved = replace(data, p_WH_measured=data.p_WH_measured + np.array([0.02, 0.0, 0.0]))
    assert not check_health(model, moved).healthy


def test_no_single_sighting_raises_the_alarm(model):
    data = only_cameras(poses(body(), 30))
    pixels = data.pixels.copy()
    pixels[12] += 200.0
    report = check_health(model, replace(data, pixels=pixels))
    assert report.nis[12] > 1000.0
    assert report.healthy


def test_three_of_them_do():
    """As much as a pose may say three times over passes the threshold, twice it does not."""
    monitor, step = Monitor.of(np.full(4, 0.25)), np.full(4, -np.log(0.005))
    monitor = monitor.after(np.full(4, -9.0))
    for _ in range(2):
        assert not monitor.alarm
        monitor = monitor.after(np.where([True, False, False, False], step, -9.0))
    assert not monitor.alarm
    assert monitor.after(np.where([True, False, False, False], step, -9.0)).alarm


@pytest.mark.slow
def test_few_sightings_after_a_change_say_that_they_are_few(model):
    report = check_health(model, only_cameras(changed("slip", "right_elbow", 0.1, count=4)))
    assert not report.sure
    assert len(report.nis) < ENOUGH
    assert "record 10 or more" in " ".join(health_document(report)["reasons"])


def test_sightings_of_one_camera_count_two_coordinates(model):
    data = blinded(only_cameras(poses(body(), 20)), np.arange(10), 0)
    report = check_health(model, data)
    assert report.dof.tolist() == [2] * 10 + [4] * 10
    assert report.healthy


def test_just_what_changed_is_learned_anew(model):
    data = only_cameras(changed("slip", "right_elbow", np.radians(3.0), count=25))
    report = check_health(model, data)
    update = relearn_cause(model, data, report)
    assert update.learned == ("right_elbow.theta_offset",)
    assert update.fits
    fresh = changed("slip", "right_elbow", np.radians(3.0), seed=9, count=40)
    before, after = (1e3 * evaluate(m, fresh).statistics.mean for m in (model, update.model))
    assert after < 2.6 < before
    assert check_health(update.model, only_cameras(fresh)).healthy
    with pytest.raises(EstimationError, match="nothing to learn"):
        relearn_cause(
            update.model, only_cameras(fresh), check_health(update.model, only_cameras(fresh))
        )


@pytest.mark.slow
def test_a_camera_that_was_bumped_is_learned_anew(model):
    data = only_cameras(changed("bump_camera", [0.01, 0.02, 0.0], count=30))
    update = relearn_cause(model, data, check_health(model, data))
    assert update.learned[0].startswith("right.pose")
    fresh = only_cameras(changed("bump_camera", [0.01, 0.02, 0.0], seed=9, count=40))
    assert check_health(update.model, fresh).healthy


def test_innovations_of_the_truth_would_be_chi_square(model):
    """NIS of 200 poses: mean as expected, and no more than chance beyond 99 %."""
    observations = hand_observations_of(model, only_cameras(poses(body(), 200)))
    new = observations.innovations(covariance_of(model, observations.names))
    r, _ = new.whitened
    nis = np.sum(r**2, axis=1)
    assert np.mean(nis > 13.3) < 0.04
    assert np.abs(r.mean(axis=0)).max() < 0.35


def test_the_workspace_splits_into_what_data_cure_and_what_mechanics_leave(model):
    trained = scenario().train.encoders
    readings = np.random.default_rng(0).uniform(trained.min(axis=0), trained.max(axis=0), (1600, 4))
    pixels = model.rig.project(model.predict(readings).p_WH)
    with np.errstate(invalid="ignore"):
        shown = ((pixels > 0.0) & (pixels < [*model.rig.left.image_size] * 2)).all(axis=1)
    readings = readings[shown][:200]
    found = workspace_accuracy(model, readings)
    assert found.p_LH.shape == (200, 3)
    assert found.total == pytest.approx(np.hypot(found.learned, found.mechanics))
    # Half a degree of play each way moves the hand by some 2 mm, all that was learned by less.
    assert 1e3 * found.mechanics.mean() == pytest.approx(1.9, abs=0.3)
    assert 0.2 < 1e3 * found.learned.mean() < 1.5
    assert 0.0 < found.curable < 0.5
    seen = np.isfinite(found.mechanics_px)
    assert seen.mean() > 0.9
    # A pixel is about depth / focal length: 0.25 m / 390.
    scale = np.linalg.norm(found.p_LH, axis=1)[seen] / 390.0
    assert np.median(found.mechanics_px[seen] * scale / found.mechanics[seen]) == pytest.approx(
        1.0, abs=0.3
    )
    with pytest.raises(ModelError, match="does not say how well"):
        workspace_accuracy(replace(model, covariance=None), readings)


@pytest.mark.slow
def test_twice_the_data_cure_half_of_the_learned_variance():
    from nico_selfmodel.estimation.body.body import calibrate_body

    few, many = scenario(0, random_poses=40), scenario(0, random_poses=100)
    readings = few.test.encoders
    found = [
        workspace_accuracy(calibrate_body(one.train, one.cameras, one.boards).model, readings)
        for one in (few, many)
    ]
    assert found[1].learned.mean() < 0.95 * found[0].learned.mean()
    assert found[1].mechanics.mean() == pytest.approx(found[0].mechanics.mean(), rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("angle", [15.0, 40.0, -70.0])
@pytest.mark.parametrize("joint", ["right_elbow", "right_shoulder_roll"])
def test_a_slip_of_any_size_is_laid_to_its_joint(model, angle, joint):
    """The hand goes round a circle: what follows its chord is a point, or the base."""
    data = only_cameras(changed("slip", joint, np.radians(angle)))
    report = check_health(model, data)
    best = report.diagnoses[0]
    assert best.hypothesis.cause == f"zero of {joint}"
    gear = model.servos.gear[model.joints.index(joint)]
    off = -best.change[0] / gear - np.radians(angle)
    assert abs((off + np.pi) % (2.0 * np.pi) - np.pi) < np.radians(4.0)

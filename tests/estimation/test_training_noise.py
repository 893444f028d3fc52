"""What a training says of the noise to expect, and how a check uses it."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.body.stereo_points import StereoPoints
from nico_selfmodel.estimation.monitoring.health import check_health
from nico_selfmodel.estimation.noise.hand_observations import hand_observations_of
from nico_selfmodel.estimation.noise.pose_residuals import PoseResiduals
from nico_selfmodel.estimation.noise.training_noise import FLOOR, expected_noise, without_itself

from .arms_that_change import CELLS, THESIS, jumped, learned_arm, session
from .simulated_bodies import learned, scenario

SEED = 50


@pytest.fixture(scope="module")
def model():
    return learned_arm(THESIS, SEED)


def test_a_residual_without_its_pose_is_that_of_a_fit_without_it():
    """A line through points of two coordinates each: every pose left out and fitted again."""
    rng = np.random.default_rng(0)
    slopes, measured = rng.normal(size=(12, 2, 3)), rng.normal(size=(12, 2))
    weighed = np.array([np.diag(d) + 0.3 for d in rng.uniform(0.5, 2.0, (12, 2))])
    inverse = np.linalg.inv(weighed)

    def fit(rows):
        h = np.einsum("nki,nkl,nlj->ij", slopes[rows], inverse[rows], slopes[rows])
        g = np.einsum("nki,nkl,nl->i", slopes[rows], inverse[rows], measured[rows])
        return np.linalg.solve(h, g), np.linalg.inv(h)

    x, covariance = fit(np.arange(12))
    seen = np.ones((12, 2), dtype=bool)
    poses = PoseResiduals(
        "points",
        ("a", "b", "c"),
        measured - slopes @ x,
        slopes,
        0.0 * slopes,
        slopes,
        seen,
        np.arange(12),
    )
    fitted = slopes @ covariance @ np.swapaxes(slopes, 1, 2)
    left_out = [measured[i] - slopes[i] @ fit(np.delete(np.arange(12), i))[0] for i in range(12)]
    assert without_itself(poses, fitted, weighed) == pytest.approx(np.array(left_out))


@pytest.mark.slow
def test_every_estimator_of_an_arm_writes_its_noise(model):
    noise = model.noise_mixtures["points"]
    assert noise.sensor_sigma == pytest.approx(THESIS.marker_sigma)
    # Uniform play of +-0.6 deg.
    assert np.degrees(noise.joint_sigma) == pytest.approx(0.6 / np.sqrt(3.0), rel=0.3)
    assert noise.tail_joint_sigma > 1.8 * noise.joint_sigma
    assert 0.02 < noise.tail_share < 0.25
    body = learned(0).model.noise_mixtures
    assert set(body) == {"pixels"}
    assert body["pixels"].sensor_sigma == pytest.approx(0.3, rel=0.1)
    stereo = StereoPoints.of(scenario(0).cameras, scenario(0).train)
    found = stereo.complete(calibrate_kinematics(stereo.train, explain=False)).model
    assert set(found.noise_mixtures) == {"points", "pixels"}
    circles = calibrate_kinematics(session(THESIS, SEED, 0, sweeps=True), method="circle-points")
    assert circles.model.noise_mixtures["points"].joint_sigma > 0.0


@pytest.mark.slow
def test_noise_is_told_by_free_poses_where_there_are_enough(model):
    """Sweeps fit better than any other pose where a model leaves something out."""
    sag = CELLS["sag"]
    train = session(sag, SEED, 0, sweeps=True)
    noise = learned_arm(sag, SEED).noise_mixtures["points"]
    assert noise.poses == 100
    free = train.sweep == ""
    few = np.flatnonzero(~free | (np.cumsum(free) <= 20))
    swept = calibrate_kinematics(train.select(few), explain=False).model.noise_mixtures["points"]
    assert swept.poses > 100
    # Unmarked, they are found.
    unmarked = replace(train, sweep=np.full(len(train), ""))
    assert calibrate_kinematics(unmarked, explain=False).model.noise_mixtures["points"].poses <= 101


@pytest.mark.slow
def test_a_sensor_that_is_stated_to_be_worse_is(model):
    data = session(THESIS, SEED, 3, 20)
    own = model.noise_mixtures["points"]
    assert expected_noise(model, "points", data) == own
    assert expected_noise(model, "points") == own
    worse = expected_noise(model, "points", replace(data, point_sigma_m=5e-3))
    assert worse.sensor_sigma == 5e-3
    assert worse.joint_sigma == own.joint_sigma
    better = expected_noise(model, "points", replace(data, point_sigma_m=1e-5))
    assert better == own


def test_joint_noise_is_the_bodys_own_whatever_measures_it():
    body = learned(0).model
    noise = expected_noise(body, "points")
    assert noise.joint_sigma == body.noise_mixtures["pixels"].joint_sigma
    assert noise.sensor_sigma == FLOOR["points"]


def test_a_body_that_does_not_say_what_noise_to_expect_cannot_be_checked(model):
    fit = {key: value for key, value in model.fit.items() if key != "noise"}
    with pytest.raises(ModelError, match=r"does not say what noise .* learn it anew"):
        check_health(replace(model, fit=fit), session(THESIS, SEED, 3, 20))


@pytest.mark.slow
def test_seven_tags_of_a_bad_pose_are_one_vote():
    model = learned_arm(THESIS, SEED, tags=7)
    data = session(THESIS, SEED, 4, 40, tags=7)
    assert check_health(model, data).healthy
    points = data.p_WH_measured.copy()
    bad = data.sample == np.unique(data.sample)[21]
    assert bad.sum() >= 6
    points[bad] += 0.1
    report = check_health(model, replace(data, p_WH_measured=points))
    assert report.healthy
    assert len(report.nis) == 40
    assert report.dof[21] == 3 * bad.sum()
    assert report.nis[21] > 1000.0


def test_frames_of_a_standing_robot_are_one_vote_too(model):
    data = session(THESIS, SEED, 5, 30)
    points = data.p_WH_measured.copy()
    points[11] += 0.02
    rows = np.repeat(np.arange(30), np.where(np.arange(30) == 11, 10, 1))
    parts = ("encoders", "pixels", "marker", "mirror", "sweep")
    often = replace(
        data,
        sample=np.arange(1, len(rows) + 1),
        p_WH_measured=points[rows],
        **{name: getattr(data, name)[rows] for name in parts},
    )
    report = check_health(model, often)
    assert len(report.nis) == 30
    assert report.healthy


@pytest.mark.slow
def test_tags_that_move_together_are_told_from_one_that_moves():
    model = learned_arm(THESIS, SEED, tags=7)
    data = session(THESIS, SEED, 6, 25, tags=7)
    turned = replace(
        model, table=replace(model.dh, p_NH=model.dh.p_NH + np.array([0.008, 0.0, 0.006]))
    )
    off = PoseResiduals.of(hand_observations_of(turned, data)).residuals
    off -= PoseResiduals.of(hand_observations_of(model, data)).residuals
    rows = np.arange(len(data))
    pose = np.unique(data.sample, return_inverse=True)[1]
    tag = np.array([model.markers.index(name) for name in data.marker.tolist()])
    moved = data.p_WH_measured - off.reshape(-1, 7, 3)[pose, tag]
    together = check_health(model, replace(data, p_WH_measured=moved))
    assert together.diagnoses[0].hypothesis.cause == "all points on the hand together"
    single = np.where((tag == 2)[rows, None], moved, data.p_WH_measured)
    alone = check_health(model, replace(data, p_WH_measured=single))
    assert alone.diagnoses[0].hypothesis.cause == "point tag2 on the hand"


def test_a_jump_is_dated_and_the_poses_before_it_help(model):
    data = session(THESIS, SEED, 7, 60)
    report = check_health(model, jumped(data, model, 1, 3.0, at=40))
    assert report.changed_at == pytest.approx(40, abs=1)
    assert report.diagnoses[0].hypothesis.cause == "zero of right_shoulder_roll"
    assert np.degrees(report.diagnoses[0].change[0]) == pytest.approx(3.0, abs=0.4)

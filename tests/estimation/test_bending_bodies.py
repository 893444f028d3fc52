"""What bends in any body: sag by Drake's masses, loads of another arm, cameras, backlash."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_folder import load_body_dataset, save_body_dataset
from nico_selfmodel.dataset.body.conversion import body_dataset_of
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.bending.ladder import climb
from nico_selfmodel.estimation.body.body import calibrate_body
from nico_selfmodel.estimation.body.body_options import BodyOptions
from nico_selfmodel.estimation.judging import judge, to_json
from nico_selfmodel.estimation.tree.bending_tree import BendingTree, TreeBend
from nico_selfmodel.estimation.tree.body_prediction import predict_body
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_errors import errors_of
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_result import body_model
from nico_selfmodel.model.tree.body_model import load_body, save_body
from nico_selfmodel.sessions.whole_body import whole_body_session, whole_nico
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.viz.reports.body import body_report
from nico_selfmodel.viz.reports.tree import tree_report

from ..slow_rest import slow_rest
from .filmed_arms import eyes, filmed
from .sagging_arms import SaggingArm, mean_mm
from .sagging_humanoids import SaggingHumanoid
from .simulated_bodies import CLEAN, scenario
from .simulated_trees import observed, one_arm
from .test_bending_arms import arm_and_data


def mean_error(calibration):
    return float(np.nanmean(calibration.test.by_row()))


def told(truth, rigid, test):
    """Mean error of the fit that is told what bends."""
    parameters = rigid.parameters.with_bending(truth.bending())
    residuals = TreeResiduals(rigid.train.observations, parameters)
    problem = TreeProblem(residuals, rigid.setup.free, rigid.setup.priors)
    values = problem.refine(np.concatenate([rigid.values, truth.bending().values])).values
    return float(np.nanmean(errors_of(parameters.tree_of(values), test).by_row()))


def humanoid(seed, poses, *, hands="lr", cameras=False, **weak):
    rng = np.random.default_rng((seed, 7))
    truth = SaggingHumanoid.drawn(rng, **weak)
    train, _ = truth.recorded(rng, poses, hands=hands, cameras=cameras)
    test, _ = truth.recorded(rng, 100, hands=hands, cameras=cameras)
    return truth, train, test, truth.described(rng, train)


@pytest.fixture(scope="module")
def sagging():
    """An arm that sags, learned as an arm and as a body."""
    _, train, test, true = arm_and_data(0, 40)
    arm = calibrate_kinematics(train, explain=False)
    body = calibrate_tree(body_dataset_of(train), test=body_dataset_of(test))
    return arm, body, test, true


@pytest.mark.slow
def test_an_arm_bends_alike_whether_it_is_learned_as_an_arm_or_as_a_body(sagging):
    arm, body, test, _ = sagging
    assert body.ladder.kept == arm.ladder.kept == ("sag",)
    of_arm = mean_mm(arm.model.parameters, test, test.p_WH_measured)
    # Loads of a body are held by one standard deviation for all, those of an arm each by its own.
    assert 1e3 * mean_error(body) == pytest.approx(of_arm, rel=0.05)
    sags = body.tree.bending.sag, arm.model.bending.sag
    assert sags[0] == pytest.approx(sags[1], abs=0.2 * np.abs(sags[1]).max())


@pytest.mark.slow
def test_what_bends_in_a_body_is_written_read_and_predicted_with_its_sigma(sagging, tmp_path):
    _, body, test, true = sagging
    save_body(body_model(body), tmp_path / "body.yaml")
    model = load_body(tmp_path / "body.yaml")
    assert model.tree.bending.names == body.tree.bending.names
    assert model.tree.bending.values.tolist() == body.tree.bending.values.tolist()
    found = predict_body(model, test.encoders)
    off = found.p_FM[:, 0] - true
    normalised = np.sum(off**2, axis=1) / (3.0 * found.total_sigma[:, 0] ** 2)
    assert 0.4 < normalised.mean() < 2.2


@pytest.mark.slow
def test_what_bends_stands_in_result_and_verdict(sagging):
    document = to_json(sagging[1], judge(sagging[1]))
    assert document["bending"]["effects"] == ["sag"]
    assert document["bending"]["hand_mm"]["sag"]["max"] > 0.5
    assert any("joints sag" in note for note in document["reasons"])
    assert "j2.sag" in document["parameters"]


@pytest.mark.slow
def test_a_body_that_may_not_bend_says_what_it_would_gain():
    _, train, _, _ = arm_and_data(1, 40)
    rigid = calibrate_tree(body_dataset_of(train), effects=())
    assert rigid.tree.bending is None
    words = " ".join(to_json(rigid, judge(rigid))["warnings"])
    assert "joints sag by up to" in words
    assert "--effects auto" in words


@pytest.mark.parametrize("how", slow_rest([{"markers": 2}, {"markers": 2, "sensor": "camera"}]))
def test_a_rigid_body_stays_rigid(how):
    found = calibrate_tree(one_arm(904, poses=40, **how).data)
    assert found.ladder.kept == ()
    assert found.tree.bending is None
    assert len(found.ladder.steps) >= 4


@pytest.mark.slow
@pytest.mark.parametrize("coupled", [0.03, 0.0])
def test_what_bends_in_one_joint_alone_is_not_taken_for_its_noise(coupled):
    rng, made = np.random.default_rng((2, 3)), one_arm(2, joints=4, markers=2)
    q, data = rng.uniform(-1.2, 1.2, size=(60, 4)), made.data
    off = np.zeros_like(q)
    off[:, 2] = coupled * q[:, 1] if coupled else 0.02 * rng.normal(size=60)
    of = made.tree, data.joints, data.markers, data.sensors
    quiet = {"joint_sigma": np.radians(0.01), "sigma": {"points": 2e-4}}
    found = calibrate_tree(replace(observed(*of, q + off, rng, **quiet), readings=q))
    assert 2 in found.solution.noise.loud
    assert found.ladder.kept == (("coupling",) if coupled else ())
    assert (found.solution.noise.joint[2] < np.radians(0.02)) == bool(coupled)


@pytest.mark.slow
def test_a_disc_far_out_of_centre_is_no_gear_and_lets_nothing_bend():
    rng, made = np.random.default_rng((3, 3)), one_arm(3, joints=4, markers=2)
    q, data = rng.uniform(-1.2, 1.2, size=(60, 4)), made.data
    off = np.zeros_like(q)
    off[:, 2] = 0.1 * np.sin(q[:, 2] + 1.0)
    of = made.tree, data.joints, data.markers, data.sensors
    quiet = {"joint_sigma": np.radians(0.01), "sigma": {"points": 2e-4}}
    found = calibrate_tree(replace(observed(*of, q + off, rng, **quiet), readings=q))
    assert 2 in found.solution.noise.loud
    assert not found.ladder.adopted
    assert not found.ladder.doubtful_gears


@pytest.mark.slow
def test_what_bends_is_not_asked_of_poses_that_all_are_outliers():
    found = calibrate_tree(one_arm(1, poses=20).data, effects=None)
    residuals = TreeResiduals(found.train.observations, found.parameters)
    problem = TreeProblem(residuals, found.setup.free, found.setup.priors)
    solution = problem.refine(found.values)
    slipped = replace(solution, slipped=np.ones_like(solution.slipped))
    asked = [
        len(list(BendingTree(TreeBend(problem, one), frozenset(), None, 0, None).few()))
        for one in (solution, slipped)
    ]
    assert asked == [1, 1]
    nothing = SimpleNamespace(enough=True, few=list, solution="rigid")
    assert climb(nothing).solution == "rigid"


@pytest.mark.slow
def test_a_humanoid_that_sags_is_met_better_than_by_a_rigid_one():
    _, train, test, description = humanoid(3, 40, sag=12.0)
    rigid, found = (
        calibrate_tree(train, test=test, description=description, effects=effects)
        for effects in ((), ("sag",))
    )
    assert found.ladder.kept == ("sag",)
    assert mean_error(found) < 0.5 * mean_error(rigid)


@pytest.mark.slow
def test_a_humanoid_that_sags_is_learned_nearly_as_if_its_masses_were_told():
    truth, train, test, description = humanoid(3, 150, bearing=1.0, sag=6.0)
    rigid = calibrate_tree(train, test=test, description=description, effects=())
    found = calibrate_tree(train, test=test, description=description)
    assert found.ladder.kept[:2] == ("sag", "bearing_sag")
    assert mean_error(found) < 1.15 * told(truth, rigid, test)
    assert mean_error(found) < 0.5 * mean_error(rigid)
    assert found.tree.bending.up == pytest.approx([0.0, 0.0, 1.0], abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [11, 12])
@pytest.mark.parametrize(("hands", "bound"), [("lr", 1.15), ("r", 1.4)])
def test_a_humanoid_of_500_poses_reaches_what_it_must(seed, hands, bound):
    truth, train, test, description = humanoid(seed, 500, hands=hands, bearing=1.0, sag=6.0)
    rigid = calibrate_tree(train, test=test, description=description, effects=())
    found = calibrate_tree(train, test=test, description=description)
    assert mean_error(found) < bound * told(truth, rigid, test)


@pytest.mark.slow
def test_cameras_tell_sag_in_pixels():
    _, train, test, description = humanoid(4, 80, cameras=True, sag=12.0, markers=2)
    rigid = calibrate_tree(train, test=test, description=description, effects=())
    found = calibrate_tree(train, test=test, description=description)
    assert "sag" in found.ladder.kept
    assert found.ladder.unit == "px"
    assert "unseen_px" in to_json(found, judge(found))["bending"]
    assert mean_error(found) < 0.8 * mean_error(rigid)


@pytest.fixture(scope="module")
def loose():
    _, train, test, true = arm_and_data(3, 60, sag=0.0, backlash=0.4)
    return body_dataset_of(train), body_dataset_of(test), test, true


def test_sides_of_joints_stay_with_a_recording_of_a_body(loose, tmp_path):
    save_body_dataset(loose[0], tmp_path / "data")
    again = load_body_dataset(tmp_path / "data")
    assert np.array_equal(again.approach, loose[0].approach)
    assert np.abs(again.approach).min() == 1
    half = again.select(np.arange(60) < 30)
    assert np.array_equal(half.approach, again.approach[:30])


@pytest.mark.slow
def test_backlash_of_a_body_is_learned_and_uncertain_where_the_side_is_not_known(loose):
    train, test, dataset, true = loose
    found = calibrate_tree(train, test=test)
    nobody = calibrate_tree(
        replace(train, approach=None), test=replace(test, approach=None), effects=()
    )
    assert "backlash" in found.ladder.kept
    assert mean_error(found) < 0.4 * mean_error(nobody)
    model = body_model(found)
    known = predict_body(model, test.readings, np.asarray(test.approach))
    unknown = predict_body(model, test.readings)
    assert np.linalg.norm(known.p_FM[:, 0] - true, axis=1).mean() < 3e-4
    assert (unknown.sigma > 5.0 * known.sigma).mean() > 0.9
    off = np.sum((unknown.p_FM[:, 0] - true) ** 2, axis=1) / (3.0 * unknown.sigma[:, 0] ** 2)
    assert 0.4 < off.mean() < 2.0
    assert len(dataset) == len(true)


@pytest.fixture(scope="module")
def film():
    """An arm that sags before two cameras: what they saw to learn from, and to test by."""
    rng = np.random.default_rng((1, 17))
    arm = SaggingArm.drawn(rng, sag=8.0)
    train, _ = filmed(arm, rng, 80)
    return train, *filmed(arm, rng, 100)


def body_of(film, **how):
    train, test, true = film
    stage = BodyOptions("kinematics", "unanchored")
    found = calibrate_body(train, eyes()[1], None, stage, test=test, **how)
    read = (test.encoders - found.model.servos.offset) / found.model.servos.gear
    return found, 1e3 * float(np.linalg.norm(found.model.points(read) - true, axis=1).mean())


@pytest.fixture(scope="module")
def bent(film):
    return body_of(film)


@pytest.mark.slow
def test_an_arm_before_two_cameras_bends_too(film, bent):
    rigid, before = body_of(film, effects=())
    assert rigid.model.bending is None
    assert "--effects auto" in " ".join(to_json(rigid, judge(rigid))["warnings"])
    found, after = bent
    assert found.ladder.kept == ("sag",)
    assert after < 0.15 * before
    assert found.noise.sensor_sigma == pytest.approx(0.15, rel=0.15)
    document = to_json(found, judge(found))
    assert document["bending"]["effects"] == ["sag"]
    assert document["parameters"]["j2.sag"]["sigma"] > 0.0
    html = body_report(found, document).html()
    assert "What bends" in html
    assert "unseen before [px]" in html


@pytest.mark.slow
def test_what_bends_before_cameras_is_predicted_with_its_sigma(film, bent):
    found, _ = bent
    _, test, true = film
    told = found.model.predict(test.encoders)
    off = told.p_WH - true
    nees = np.einsum("ni,nij,nj->n", off, np.linalg.inv(told.covariance), off).mean() / 3.0
    assert 0.3 < nees < 2.5


def off_by_sigma(calibration, nico, recording):
    """Squared error of the right hand by its variance, mean over poses; joint noise apart."""
    model = body_model(calibration)
    found = predict_body(model, recording.readings)
    mechanics = nico.mechanics
    q = mechanics.expected_angles(recording.readings)
    hand = mechanics.markers.index("right_hand_fiducial")
    true = np.array([mechanics.points(row)[hand] for row in q])
    i = model.tree.marker_index("right_hand_fiducial")
    off = np.sum((found.p_FM[:, i] - true) ** 2, axis=1)
    return float(np.mean(off / (3.0 * found.sigma[:, i] ** 2)))


@pytest.mark.slow
def test_a_sag_that_joint_noise_hides_is_in_the_sigmas_and_not_claimed():
    world, seed = IMPERFECTIONS["thesis"], 64
    train = whole_body_session(world, seed, 0, looks=60, hands=80)
    test = whole_body_session(world, seed, 1, looks=5, hands=30)
    nico, _ = whole_nico(world, seed)
    rigid, found = calibrate_tree(train, effects=()), calibrate_tree(train, test=test)
    assert found.ladder.kept == ()
    assert [step.effect for step in found.ladder.steps if step.hidden] == ["sag"]
    assert found.tree.bending.effects == ("sag", "loads")
    document = to_json(found, judge(found))
    assert document["bending"]["effects"] == []
    assert any("but not claimed" in note for note in document["reasons"])
    html = tree_report(found, document).html()
    assert "The data tell that joints sag" in html
    assert "it is rigid" not in html
    assert off_by_sigma(rigid, nico, test) > 3.0
    assert off_by_sigma(found, nico, test) < 2.5


@pytest.mark.slow
def test_boards_hold_cameras_while_the_arm_is_asked_what_bends():
    recorded = scenario(0, world=CLEAN)
    found = calibrate_body(recorded.train, recorded.cameras, recorded.boards, test=recorded.test)
    assert found.ladder.steps
    assert found.ladder.kept == ()
    assert found.model.bending is None

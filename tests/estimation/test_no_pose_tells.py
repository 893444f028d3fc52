"""What no pose of a body tells is named, and fails nothing; what other poses would tell fails."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.dataset.body.sensors import SensorInfo
from nico_selfmodel.errors import NotConvergedError
from nico_selfmodel.estimation.judging import judge, result_of
from nico_selfmodel.estimation.tree.body_prediction import predict_body
from nico_selfmodel.estimation.tree.contradictions.no_pose_tells import told_by_no_pose
from nico_selfmodel.estimation.tree.contradictions.ran_away import check_that_it_stayed
from nico_selfmodel.estimation.tree.contradictions.unplaced_markers import hardly_seen, seldom_seen
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_result import body_model
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_tree import Attached
from nico_selfmodel.optimization.uncertainty import UnobservableDirection

from ..slow_rest import slow_rest
from .simulated_trees import LENS, Simulated, assembled, looking_at, observed, one_arm, tags


def palletizer(seed, limits, poses=60, reach=0.6):
    """A hand that a parallelogram keeps upright: `level` undoes what `upper` and `fore` turn."""
    rng = np.random.default_rng(seed)
    quarter = np.pi / 2
    joints = [
        LinkJoint("base", parent="world"),
        LinkJoint("upper", parent="base"),
        LinkJoint("fore", parent="upper"),
        LinkJoint("level", parent="fore", follows={"upper": -1.0, "fore": -1.0}),
        LinkJoint("turn", parent="level"),
    ]
    joints = [j if j.follows else replace(j, lower=-limits, upper=limits) for j in joints]
    places = [
        ([0.0, 0.02, 0.0], [0.0, 0.0, 0.3]),
        ([quarter, 0.0, 0.0], [0.05, 0.0, 0.2]),
        ([0.0, 0.0, 0.0], [0.4, 0.0, 0.0]),
        ([0.0, 0.0, 0.0], [0.35, 0.0, 0.0]),
        ([-quarter, 0.0, 0.0], [0.08, 0.0, 0.0]),
    ]
    frames = [transform(rotation_from_vector(turn), place) for turn, place in places]
    infos, attached = tags(rng, "hand", "turn", 3)
    sensors = [SensorInfo("tracker", "points")]
    tree = assembled(joints, frames, infos, attached, sensors, [np.eye(4)], {})
    q = rng.uniform(-reach, reach, (poses, len(joints)))
    q[:, 3] = np.nan
    how = {"sigma": {"points": 2e-4}, "joint_sigma": 2e-4}
    data = observed(tree, joints, infos, sensors, np.nan_to_num(q), rng, **how)
    return Simulated(tree, replace(data, readings=q), q)


def filmed(seed, poses):
    """The same before two cameras, a distance known."""
    made, eyes = palletizer(seed, limits=0.6, poses=poses), ("camera1", "camera2")
    lens = dict(LENS.named_values)
    sensors = [SensorInfo(n, "camera", image_size=LENS.image_size, lens=lens) for n in eyes]
    sensors.append(SensorInfo("ruler", "distance", sigma=1e-4))
    places = tuple(
        Attached(name, -1, looking_at(np.array([1.8, y, 0.9]), [0.5, 0.0, 0.4]))
        for name, y in zip(eyes, (0.7, -0.6), strict=True)
    )
    tree = replace(made.tree, sensors=places, lenses=dict.fromkeys(eyes, LENS))
    q, rng, data = np.nan_to_num(made.readings_true), np.random.default_rng((seed, 9)), made.data
    how = {"joint_sigma": 2e-4, "sigma": {"camera": 0.3}}
    tags = [("hand_tag0", "hand_tag1")]
    seen = observed(tree, data.joints, data.markers, sensors, q, rng, distances=tags, **how)
    return replace(seen, readings=made.readings_true)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])  # the third creeps along what is open
def test_cameras_are_asked_what_no_pose_tells_as_well(seed):
    found = calibrate_tree(filmed(seed, 60), test=filmed(seed, 40), effects=())
    assert set(found.told_by_no_pose) == {True}
    verdict = judge(found)
    assert verdict.status == "PASS", verdict.reasons
    assert "in no pose between its joints' limits" in verdict.warnings[0]


@pytest.fixture(scope="module")
def upright():
    return calibrate_tree(
        palletizer(1, limits=0.6).data, test=palletizer(1, limits=0.6, poses=40).data, effects=()
    )


@pytest.mark.slow
def test_what_no_pose_tells_of_a_hand_that_stays_upright_is_named_and_fails_nothing(upright):
    ways = upright.uncertainty.unobservable
    assert {"hand_tag0.z", "hand_tag1.z", "upper.x", "turn.x"} <= set(ways[0].names)
    assert upright.told_by_no_pose == (True,) * len(ways)
    assert result_of(upright).unobservable == ()
    verdict = judge(upright)
    assert verdict.status == "PASS"
    said = [w for w in verdict.warnings if "in no pose between its joints' limits" in w]
    assert len(said) == len(ways)
    assert "`upper.x`" in said[0]
    sigma = dict(zip(upright.uncertainty.names, upright.uncertainty.sigma, strict=True))
    assert np.isinf([sigma["upper.x"], sigma["hand_tag0.z"]]).all()
    assert np.isfinite(sigma["hand_tag0.x"])


@pytest.mark.parametrize(("fall", "creeps"), [(0.009, True), (0.011, False)])
def test_creeping_along_what_is_open_ends_where_a_step_gains_nothing(upright, fall, creeps):
    solution = replace(upright.solution, converged=False, history=(7.0, 1.0 + fall, 1.0))
    assert result_of(replace(upright, solution=solution)).converged == creeps
    told = replace(upright.uncertainty, unobservable=())
    assert not result_of(replace(upright, solution=solution, uncertainty=told)).converged


def test_joints_that_may_go_further_are_asked_to(upright):
    joints = tuple(replace(j, lower=None, upper=None) for j in upright.data.joints)
    problem = upright.ladder.solution.problem
    free = replace(upright, data=replace(upright.data, joints=joints))
    observations = TreeObservations.of(free.data)
    residuals = TreeResiduals(observations, problem.residuals.parameters)
    endless = TreeProblem(residuals, frozenset(problem.free_names), problem.priors)
    known, scales = upright.uncertainty, np.ones(len(problem.free_names))
    told = told_by_no_pose(known, endless, upright.ladder.solution.solution, scales)
    assert not all(told)
    object.__setattr__(free, "told_by_no_pose", told)
    (said, *_) = result_of(free).unobservable
    assert "if 'base', 'upper'" in said
    assert "`lower` and `upper` in dataset.yaml" in said


@pytest.mark.slow
def test_what_poses_further_out_would_tell_fails():
    found = calibrate_tree(palletizer(2, limits=0.6, reach=0.03).data, effects=())
    told = found.told_by_no_pose
    assert not all(told)
    assert len(result_of(found).unobservable) == told.count(False)
    assert judge(found).status == "FAIL"


@pytest.mark.parametrize(
    ("sights", "names", "said"),
    [
        (4, ("hand_tag1.z", "hand_tag1.x"), {"hand_tag1"}),
        (5, ("hand_tag1.z", "hand_tag1.x"), set()),
        (4, ("hand_tag1.z", "upper.x"), set()),
    ],
)
def test_markers_that_were_seen_too_seldom_are_told_from_what_else_is_open(sights, names, said):
    way = UnobservableDirection(names, np.full(2, 0.5**0.5), np.inf)
    assert seldom_seen({"hand_tag0": 40, "hand_tag1": sights}, way) == said


def with_sights(data, sights):
    """The same recording in which the second tag was seen so often."""
    own = np.flatnonzero(data.observations.marker == 1)
    kept = np.setdiff1d(np.arange(len(data.observations.marker)), own[sights:])
    return replace(data, observations=data.observations.select(kept))


@pytest.mark.slow
@pytest.mark.parametrize("sights", slow_rest([0, 1]))
def test_a_marker_that_was_hardly_seen_is_a_warning_and_its_place_is_unknown(sights):
    sim = one_arm(5, joints=3, markers=3, poses=40, sensor="camera")
    few = with_sights(sim.data, sights)
    found = calibrate_tree(few, test=sim.data, effects=())
    assert set(found.test.observations.data.observations.marker) == {0, 2}
    verdict = judge(found)
    assert not any("hand_tag1" in reason for reason in verdict.reasons)
    assert any(f"`hand_tag1` ({sights} times) was seen" in word for word in verdict.warnings)
    assert np.linalg.norm(body_model(found).tree.markers[1].X_LA[:3, 3]) < 1.0  # beside the others
    there = predict_body(body_model(found), sim.data.readings[:1])
    # Without a length all of them are as far off as the body is large.
    assert there.sigma[0, 1] > 3.0 * there.sigma[0, [0, 2]].max()


def test_a_marker_that_was_hardly_seen_may_run_away_and_no_other():
    sim = one_arm(5, joints=3, markers=3, poses=10)
    parameters = TreeParameters(sim.tree)
    start = parameters.values_of(sim.tree)
    values = start.copy()
    values[parameters.index["hand_tag1.z"]] = -2e9
    keep = np.ones(len(sim.data.observations), dtype=bool)
    keep[np.flatnonzero(sim.data.observations.marker == 1)[4:]] = False
    lost = hardly_seen(sim.data, keep)
    assert lost == {"hand_tag1"}
    check_that_it_stayed(parameters, start, values, lost=lost)
    with pytest.raises(NotConvergedError, match=r"hand_tag1\.z went from"):
        check_that_it_stayed(parameters, start, values)

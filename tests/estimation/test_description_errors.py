"""How far a described robot is off is told by the data, and so is what only it tells."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.diagnosis.nominal_check import RobotSize, compare_sizes, odd_axes
from nico_selfmodel.estimation.judging import judge, result_of
from nico_selfmodel.estimation.tree.known import described_scale as module
from nico_selfmodel.estimation.tree.known.described_scale import (
    DescribedScale,
    contradicted_description,
    doubting,
)
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_priors import BEFOREHAND, expected_priors
from nico_selfmodel.estimation.tree.tree_setup import DESCRIBED, Alike, Description, robot_sigmas_of
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.tree.body_tree import BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.optimization.uncertainty import Uncertainty
from nico_selfmodel.planning.sweep_protocol import SweepProtocol
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.sessions.motion_capture_scenario import nominal_of
from nico_selfmodel.sessions.simulated_session import simulated_session
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

from ..slow_rest import slow_rest
from .simulated_trees import LENS, one_arm, turned

NAMES = tuple(f"p{i}" for i in range(60))
TURNS, PLACES = Alike(NAMES[:25], 0.03), Alike(NAMES[25:50], 0.01)


def asked(seed, turn, place, noise=1e-3, told=slice(None)):
    """Priors that the data ask for where parts are off by so much; ten more have none."""
    rng = np.random.default_rng(seed)
    U = rng.normal(size=(200, 60)) / noise
    U[:, np.setdiff1d(np.arange(50), np.arange(50)[told])] = 0.0
    off = np.concatenate([turn * rng.normal(size=25), place * rng.normal(size=25), np.ones(10)])
    u = -U @ off + rng.normal(size=200)
    priors = {name: (0.0, group.sigma) for group in (TURNS, PLACES) for name in group.names}
    values = dict.fromkeys(NAMES, 0.0)
    found = expected_priors(priors, (TURNS, PLACES), NAMES, values, (U, u))
    assert set(found) == set(priors)
    assert len({found[name] for name in TURNS.names}) == 1
    return found[NAMES[0]][1], found[NAMES[25]][1]


@pytest.mark.slow
def test_the_data_tell_how_far_parts_are_off():
    found = np.array([asked(seed, 0.01, 0.003) for seed in range(40)])
    assert np.sqrt(np.mean(found**2, axis=0)) == pytest.approx([0.01, 0.003], rel=0.07)
    # 25 numbers tell a standard deviation to a seventh.
    assert found.std(axis=0) / found.mean(axis=0) == pytest.approx([0.14, 0.14], abs=0.05)


@pytest.mark.slow
def test_what_noise_hides_is_no_error_of_the_description():
    found = np.array([asked(seed, 0.002, 0.002, noise=0.02) for seed in range(40)])
    assert np.median(found, axis=0) == pytest.approx([0.002, 0.002], rel=0.5)


@pytest.mark.slow
def test_untold_parts_are_off_by_what_a_description_is_said_to_be_off_by():
    assert asked(0, 0.01, 0.003, told=slice(0, 0)) == pytest.approx((0.03, 0.01), rel=1e-3)
    # One part that is right says that the others are nearer, by a factor of some three.
    one = np.median([asked(seed, 1e-6, 1e-6, told=slice(0, 1))[0] for seed in range(10)])
    assert one == pytest.approx(0.03 * np.exp(-0.25 / BEFOREHAND**2), rel=0.02)
    assert 0.2 < one / 0.03 < 0.4
    # Five and twenty are believed.
    assert asked(0, 1e-6, 1e-6)[0] < 1e-3


def test_parameters_without_such_priors_keep_theirs():
    rng = np.random.default_rng(1)
    U, u = rng.normal(size=(80, 60)), rng.normal(size=80)
    priors = {"p0": (0.0, 1.0), "p55": (0.2, 0.5)}
    found = expected_priors(priors, (TURNS,), NAMES, dict.fromkeys(NAMES, 0.0), (U, u))
    assert found["p55"] == (0.2, 0.5)
    assert found["p0"] != (0.0, 1.0)
    assert expected_priors(priors, (), NAMES, dict.fromkeys(NAMES, 0.0), (U, u)) == priors


@pytest.mark.parametrize("few", slow_rest([2, 1, 3, 6], plain=0))
def test_what_only_a_description_tells_is_off_as_far_as_is_claimed_be_few_parts_told(few):
    told = [asked(seed, 0.0173, 0.0058, told=slice(0, few))[0] for seed in range(200)]
    # A part that nothing tells is off by 0.0173.
    assert 0.6 < np.mean((0.0173 / np.array(told)) ** 2) < 1.3


@pytest.mark.parametrize(("each", "said"), [(9.9, True), (10.1, False)])
def test_few_told_parts_of_a_description_that_alone_tells_lengths_are_doubted(
    monkeypatch, each, said
):
    places = tuple(f"j{k}.x" for k in range(20))
    left = 1e-4 * (1.0 - each / 20.0) * np.eye(20)
    by_scale = SimpleNamespace(by_scale=lambda values: np.ones(20))
    base = SimpleNamespace(joints=tuple(f"j{k}" for k in range(20)))
    problem = SimpleNamespace(
        priors=dict.fromkeys(places, (0.0, 0.01)),
        free_names=places,
        columns=np.arange(20),
        residuals=SimpleNamespace(parameters=SimpleNamespace(layout=by_scale, base=base)),
    )
    # What lengths are told by is the third place, nearly.
    slope = np.where(np.arange(20) == 2, 1.0, 0.01)
    monkeypatch.setattr(module, "_of_distance", lambda *_: slope)
    solution = SimpleNamespace(values=np.zeros(20), whitened=100.0 * np.eye(20))
    setup = SimpleNamespace(scale_from=DESCRIBED, alike=(Alike((), 0.03), Alike(places, 0.01)))
    known = Uncertainty(
        places, left, np.sqrt(np.diag(left)), 1.0, 20, 1.0, (), 0, np.zeros((0, 20))
    )
    found = DescribedScale.of(problem, solution, setup, known)
    assert (found is not None) == said
    setup.scale_from = "tracker"
    assert DescribedScale.of(problem, solution, setup, known) is None
    if said:
        assert found.warning.startswith("scale: the robot's description alone tells lengths")
        assert "tells 9.9 of its 20 places" in found.warning
        assert "if 'j2', which tells most" in found.warning
        # Not known it may be off by a hundred times its 0.01.
        assert found.sigma == pytest.approx(1.0 / 1.19, rel=0.01)
        sigma = doubting(known, found).sigma_of(slope / slope.sum())
        assert sigma == pytest.approx(found.sigma)


@pytest.mark.parametrize(("off", "said"), [(4.0, False), (4.1, True)])
def test_a_stated_description_is_contradicted_by_what_chance_does_once_in_ten_thousand(off, said):
    priors = {"a.x": (0.0, 1e-3), "b.x": (0.0, 1e-3)}
    # Of a all is told, of b nothing.
    left = np.diag([0.0, 1e-6])
    known = Uncertainty(
        ("a.x", "b.x"), left, np.sqrt(np.diag(left)), 1.0, 2, 1.0, (), 0, np.zeros((0, 2))
    )
    words = contradicted_description(priors, {"a.x": off * 1e-3, "b.x": 0.0}, known)
    assert bool(words) == said
    assert not said or "off by 4.1 times what --robot-sigma says, 'a.x' most" in words


def one_camera(seed, too_long, **how):
    """An arm of three joints before one camera, with a description that has one link too long."""
    sim = one_arm(seed, joints=3, markers=2, sensor="camera", joint_sigma=np.radians(0.02))
    table = sim.data.observations
    seen = table.select(np.flatnonzero(table.sensor == 0))
    data = replace(sim.data, observations=seen, sensors=sim.data.sensors[:1])
    tree = replace(sim.tree, sensors=sim.tree.sensors[:1], lenses={"left": LENS})
    said = described(sim, seed, 0.3, 1.5, **how)
    X = np.array(said.tree.X_PJ)
    X[2, :3, 3] *= 1.0 + too_long / np.linalg.norm(X[2, :3, 3])
    said = replace(said, tree=replace(said.tree, X_PJ=X))
    return tree, calibrate_tree(data, description=said, effects=())


def described(sim, seed, degrees, millimetres, **how):
    """The robot with its frames off, nothing known of its markers."""
    rng = np.random.default_rng(seed)
    X_PJ = np.stack([X @ turned(rng, degrees, millimetres) for X in sim.tree.X_PJ])
    markers = tuple(replace(marker, X_LA=np.eye(4)) for marker in sim.tree.markers)
    tree: BodyTree = replace(sim.tree, X_PJ=X_PJ, markers=markers)
    return Description(tree, **how)


@pytest.mark.slow
def test_a_body_says_how_far_its_description_is_off():
    off = []
    for seed in range(6):
        sim = one_arm(seed, joints=6, markers=3, poses=40)
        found = calibrate_tree(sim.data, description=described(sim, seed, 1.0, 4.0), effects=())
        said = result_of(found).details["description_off"]
        assert said["learned"]
        off.append([said["turn_sigma_deg"], said["shift_sigma_mm"]])
    expected = np.array([1.0, 4.0]) / np.sqrt(3.0)  # of each part
    assert np.mean(off, axis=0) == pytest.approx(expected, rel=0.25)


def test_what_the_user_states_stays():
    sim = one_arm(1, joints=4, markers=3, poses=20)
    stated = described(sim, 1, 1.0, 4.0, turn_sigma=0.02, shift_sigma=0.007, learned=False)
    found = calibrate_tree(sim.data, description=stated, effects=())
    said = result_of(found).details["description_off"]
    assert said == {
        "turn_sigma_deg": pytest.approx(np.degrees(0.02)),
        "shift_sigma_mm": pytest.approx(7.0),
        "learned": False,
    }
    assert found.ladder.solution.problem.priors["j2.x"] == (0.0, 0.007)


@pytest.mark.parametrize(
    ("unit", "status", "said"),
    slow_rest(
        [
            (0.3048, "FAIL", r"0\.30\d* times as large as its description: check the unit"),
            (1.0, "NOT_EVALUATED", None),
            (
                1.1,
                "NOT_EVALUATED",
                r"1\.(09|10)\d* times as large as its description, in all of its",
            ),
            (39.37, "FAIL", r"39\.\d* times as large as its description: check the unit"),
        ],
        plain=2,
    ),
)
def test_a_tracker_in_another_unit_than_the_description_is_told(unit, status, said):
    sim = one_arm(7, joints=5, markers=3, poses=40)
    values = sim.data.observations.values.copy()
    values[:, :3] *= unit
    data = replace(sim.data, observations=replace(sim.data.observations, values=values))
    verdict = judge(calibrate_tree(data, description=described(sim, 7, 0.5, 1.0), effects=()))
    assert verdict.status == status, verdict.reasons
    words = [one for one in (*verdict.reasons, *verdict.warnings) if "times as large" in one]
    assert len(words) == (said is not None)
    assert said is None or re.search(said, words[0])


@pytest.mark.parametrize(
    ("more", "factor", "off", "said"),
    [(4, 4.1, 0.011, True), (3, 4.1, 0.011, False), (4, 3.9, 0.011, False), (4, 4.1, 0.009, False)],
)
def test_a_robot_is_larger_in_all_of_its_lengths_by_the_stated_bounds(more, factor, off, said):
    size = RobotSize(np.exp(off), 0.01, 0.01 * factor, more)
    assert (size.warning is not None) == said
    assert size.reason is None


def test_a_robot_may_differ_from_its_description_by_a_third_in_size():
    for scale, fails in ((1.29, False), (1.31, True), (1 / 1.29, False), (1 / 1.31, True)):
        assert (RobotSize(scale, 0.01, 0.1, 8).reason is not None) == fails


def test_axes_that_are_not_the_described_ones_tell_no_size():
    rng = np.random.default_rng(3)
    d, p = rng.normal(size=(2, 6, 3))
    d = d / np.linalg.norm(d, axis=1, keepdims=True)
    size = compare_sizes((d, p), (d, 1.5 * p))
    assert size is not None
    assert (size.scale, size.left) == (pytest.approx(1.5), pytest.approx(0.0, abs=1e-9))
    assert compare_sizes((d, p), (d[::-1], 1.5 * p)) is None
    assert compare_sizes((d, p), (d, 1.5 * p[::-1])) is None
    along = np.broadcast_to([0.0, 0.0, 1.0], (6, 3))
    assert compare_sizes((along, p), (along, p)) is None
    assert compare_sizes((d, 0.0 * p), (d, 0.0 * p)) is None


@pytest.mark.parametrize(
    ("reach", "off", "told"),
    [(0.0101, 0.19, True), (0.0099, 0.19, False), (0.04, 0.21, False), (0.051, 0.29, True),
     (0.051, 0.31, False)],
)  # fmt: skip
def test_small_distances_between_axes_tell_a_size_where_scaling_leaves_less(reach, off, told):
    rng = np.random.default_rng(3)
    d, p = rng.normal(size=(2, 6, 3))
    d = d / np.linalg.norm(d, axis=1, keepdims=True)
    across = np.eye(3) - d[:, :, None] * d[:, None, :]
    moves = across.reshape(-1, 3)

    def left(columns, points):
        target = (across @ points[:, :, None]).ravel()
        return target - columns @ np.linalg.lstsq(columns, target)[0]

    p = p * (reach / np.linalg.norm(left(moves, p)))
    columns = np.column_stack([(across @ p[:, :, None]).ravel(), moves])
    e = left(columns, rng.normal(size=(6, 3)))
    e *= off * reach / np.linalg.norm(e)
    assert (compare_sizes((d, p), (d, p + e.reshape(-1, 3))) is not None) == told


AXES = Chain(
    ("a", "b", "c"),
    np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]),
    np.array([[0.0, 0.0, 0.1], [0.2, 0.0, 0.3], [0.2, 0.5, 0.4]]),
    ("hand",),
    np.array([[0.5, 0.5, 0.4]]),
)
"""Neighbours are at right angles, pass each other by 0.2 and 0.1 m, and b's are 0.5 m apart."""


def beyond_b(turn, p=(0.0, 0.0, 0.0)):
    """Return the chain with what b carries turned about b's place and shifted."""
    R, b = rotation_from_vector(turn), AXES.points[1]
    d, points = AXES.directions.copy(), AXES.points.copy()
    d[2], points[2] = R @ d[2], b + R @ (points[2] - b) + p
    return replace(AXES, directions=d, points=points)


@pytest.mark.parametrize(
    ("other", "said"),
    [
        (beyond_b(np.radians([0.0, 0.0, 9.9])), None),
        (beyond_b(np.radians([0.0, 0.0, 10.1])), "'b' and 'c' enclose 90 deg there, 79.9 as"),
        (beyond_b(np.zeros(3), [0.0, 0.0, 0.029]), None),
        (beyond_b(np.zeros(3), [0.0, 0.0, 0.031]), "pass each other by 100 mm there, 131 as"),
        (beyond_b(np.zeros(3), [0.0, -0.029, 0.0]), None),
        (beyond_b(np.zeros(3), [0.0, -0.031, 0.0]), "along 'b' its neighbours are 500 mm there"),
        (beyond_b([0.0, 2.0, 0.0]), None),  # another zero of b
    ],
)
def test_a_description_is_far_off_by_ten_degrees_or_thirty_millimetres_between_axes(other, said):
    turned = rotation_from_vector([0.3, -1.2, 0.7])
    moved = replace(
        other,
        directions=other.directions @ turned.T * [[1.0], [-1.0], [1.0]],  # b counts the other way
        points=other.points @ turned.T + [1.0, 2.0, 3.0],
    )
    words = odd_axes(AXES, moved)
    assert (words is None) == (said is None)
    assert said is None or said in words


def test_parallel_axes_have_a_distance_and_nothing_along_them():
    d = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    one = replace(AXES, directions=d)
    first = np.eye(3)[:1].T
    along = replace(one, points=one.points + first * [0.0, 0.0, 0.3])
    assert odd_axes(one, along) is None
    leaning = one.directions + first * [np.tan(np.radians(5.0)), 0.0, 0.0]
    leaning /= np.linalg.norm(leaning, axis=1, keepdims=True)
    slant = replace(one, directions=leaning, points=one.points - first * [0.0, 0.0, 0.8])
    assert odd_axes(one, slant) is None  # how far they pass each other is told nowhere
    beside = replace(one, points=one.points + first * [0.1, 0.0, 0.0])
    assert "'a' and 'b' pass each other by 200 mm there, 100 as learned" in odd_axes(one, beside)


def test_an_arm_whose_description_has_another_axis_is_told_so():
    arm, world = ArmDescription.named("nico"), IMPERFECTIONS["clean"]
    poses = replace(SweepProtocol.for_arm(arm), random_poses=40)
    data = simulated_session(arm, world, poses, "arm", seed=2, session=0)
    nominal = nominal_of(arm)
    assert not any(
        "far off" in one for one in judge(calibrate_kinematics(data, nominal=nominal)).warnings
    )
    d = np.array(nominal.chain.directions)
    d[1] = rotation_from_vector(np.radians([0.0, 40.0, 30.0])) @ d[1]
    wrong = replace(nominal, chain=replace(nominal.chain, directions=d))
    said = judge(calibrate_kinematics(data, nominal=wrong)).warnings
    assert any("the robot's description is far off: axes of" in one for one in said)


@pytest.mark.slow
def test_a_joint_that_moves_the_other_way_than_described_is_named():
    sim = one_arm(4, joints=4, markers=3, poses=30)
    robot = described(sim, 4, 1.0, 4.0)
    readings = np.array(sim.data.readings)
    readings[:, 2] *= -1.0
    with pytest.raises(DataError, match="'j3' moves the other way than described"):
        calibrate_tree(replace(sim.data, readings=readings), description=robot, effects=())


@pytest.mark.parametrize("word", ["2", "2,x", "0,1", "1,-1", "", "1,2,3", "nan,1"])
def test_how_far_a_robot_may_be_off_is_two_positive_numbers(word):
    with pytest.raises(ValueError, match="--robot-sigma"):
        robot_sigmas_of(word)
    assert robot_sigmas_of("2,10") == pytest.approx((np.radians(2.0), 0.01))


def too_far(tree, found):
    """By how much cameras are too far from all markers, as a share, and the sigma of that."""
    seen, problem = found.data.observations, found.ladder.solution.problem

    def usual(body):
        motion = TreeMotion.at(body, found.data.si_readings, found.data.X_flange)
        away = motion.points(seen.marker, seen.pose)
        away = away - motion.pose_of(body.sensors[0])[1].T[seen.pose]
        return np.log(np.linalg.norm(away, axis=1)).mean()

    slope = module._of_distance(problem, found.ladder.solution.solution)
    return usual(found.tree) - usual(tree), found.uncertainty.sigma_of(slope)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_one_camera_and_a_description_with_a_link_that_is_too_long_are_as_sure_as_they_say(seed):
    for too_long in (0.0, 0.08):
        tree, found = one_camera(seed, too_long)
        off, sigma = too_far(tree, found)
        assert any(words.startswith("scale: ") for words in judge(found).warnings)
        assert abs(off) < 3.0 * sigma


@pytest.mark.slow
def test_a_description_that_is_stated_too_sure_fails_where_it_alone_tells_lengths():
    stated = {"turn_sigma": 0.01, "shift_sigma": 0.002, "learned": False}
    sound, wrong = (one_camera(2, off, **stated)[1] for off in (0.0, 0.08))
    assert not any("contradicts the robot's description" in words for words in judge(sound).reasons)
    assert any("contradicts the robot's description" in words for words in judge(wrong).reasons)
    (note,) = [one.text for one in result_of(sound).findings if one.text.startswith("scale: ")]
    assert "alone tells it" in note

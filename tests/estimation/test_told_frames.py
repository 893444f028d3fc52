"""What is told of places on links that nothing describes says where the links' frames are."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import DataError, NotConvergedError
from nico_selfmodel.estimation.bending.effect_sums import Reduced
from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
from nico_selfmodel.estimation.tree.contradictions.ran_away import check_that_it_stayed, too_short
from nico_selfmodel.estimation.tree.guesses.told_frames import exchanged_parts, framed, told_size
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.estimation.tree.tree_setup import Wishes, setup_of
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_tree import PRISMATIC
from nico_selfmodel.model.tree.tree_motion import TreeMotion

from ..slow_rest import slow_rest
from .simulated_trees import observed, one_arm
from .test_one_problem import from_first_camera


def learned(data, pins=None, freed=(), priors=None):
    wishes = Wishes(FixedParameters(pins or {}, frozenset(freed)), priors or {})
    return calibrate_tree(data, wishes=wishes, effects=())


@pytest.fixture(scope="module")
def tracked():
    return one_arm(1, joints=3, markers=2, poses=30, joint_sigma=np.radians(0.1))


@pytest.fixture(scope="module")
def alone(tracked):
    return learned(tracked.data)


def with_known_markers(sim):
    """Return the recording with its markers' places on their link."""
    both = zip(sim.data.markers, sim.tree.markers, strict=True)
    markers = tuple(replace(info, xyz=tuple(true.X_LA[:3, 3].tolist())) for info, true in both)
    return replace(sim.data, markers=markers)


@pytest.mark.slow
def test_markers_of_known_place_on_a_moving_link_tell_cameras_all_lengths():
    sim = one_arm(0, joints=3, markers=3, poses=30, sensor="camera", joint_sigma=np.radians(0.1))
    found = learned(with_known_markers(sim))
    assert found.setup.scale_from == "told places on 'j3'"
    for now, true in zip(found.tree.markers, sim.tree.markers, strict=True):
        np.testing.assert_array_equal(now.X_LA[:3, 3], true.X_LA[:3, 3])
    apart = [
        np.linalg.norm(tree.sensors[0].X_LA[:3, 3] - tree.sensors[1].X_LA[:3, 3])
        for tree in (found.tree, sim.tree)
    ]
    assert apart[0] == pytest.approx(apart[1], rel=0.02)
    assert found.noise["j1"] == pytest.approx(np.radians(0.1), rel=0.2)


@pytest.mark.parametrize(
    ("told", "frame"), slow_rest([({"hand_tag0.z": 0.3}, "j3.z"), ({"hand_tag0.x": 0.01}, "j3.rz")])
)
def test_one_told_coordinate_chooses_the_frame_and_changes_nothing_else(
    tracked, alone, told, frame
):
    found = learned(tracked.data, told)
    (name,) = told
    assert frame in found.setup.free
    assert found.values[found.parameters.index[name]] == told[name]
    assert found.solution.cost == pytest.approx(alone.solution.cost, abs=0.05)
    p = [predicted(one.tree, tracked.data) for one in (found, alone)]
    np.testing.assert_allclose(*p, atol=1e-5)


def predicted(tree, data):
    motion = TreeMotion.at(tree, data.si_readings, data.X_flange)
    return np.stack([motion.pose_of(marker)[1] for marker in tree.markers])


def test_what_is_told_beyond_the_frame_may_contradict(tracked, alone):
    index = alone.parameters.index
    apart = alone.values[index["hand_tag1.z"]] - alone.values[index["hand_tag0.z"]]
    learned(tracked.data, {"hand_tag0.z": 0.3, "hand_tag1.z": 0.3 + apart})
    with pytest.raises(DataError, match=r"hand_tag\d\.z is fixed at .*they contradict each other"):
        learned(tracked.data, {"hand_tag0.z": 0.3, "hand_tag1.z": 0.35 + apart})


def test_a_prior_of_one_coordinate_chooses_the_frame_too(tracked, alone):
    found = learned(tracked.data, priors={"hand_tag0.z": (0.3, 0.01)})
    assert found.values[found.parameters.index["hand_tag0.z"]] == pytest.approx(0.3, abs=1e-3)
    assert found.solution.cost == pytest.approx(alone.solution.cost, abs=0.6)


@pytest.mark.slow
def test_what_nothing_tells_is_not_held_where_a_guess_has_it(tracked):
    with pytest.raises(ValueError, match=r"nothing tells hand_tag0\.z.*--fix hand_tag0\.z=VALUE"):
        learned(tracked.data, {"hand_tag0.z": None})
    cameras = one_arm(0, joints=2, poses=20, sensor="camera").data
    with pytest.raises(ValueError, match=r"nothing tells right\.rx"):
        learned(cameras, {"right.rx": None})


def test_the_world_is_not_freed_where_nothing_tells_lengths():
    data = one_arm(0, joints=2, poses=20, sensor="camera").data
    with pytest.raises(ValueError, match=r"left\.x: 'left' stands for the world.*leave out"):
        learned(data, freed=["left.x"])


def test_link_frames_of_joints_that_shift_are_chosen_by_what_is_told_of_them(tracked):
    tree = replace(tracked.tree, motions=("revolute", PRISMATIC, "revolute"))
    tree = tree.with_markers(tuple(replace(m, on=1) for m in tree.markers))
    told = {"hand_tag0.x": 0.2, "hand_tag0.y": -0.1, "hand_tag0.z": 0.3}
    assert exchanged_parts(tree, told) == {"j2.x", "j2.y", "j2.z"}
    assert told_size(tree, told) is None
    p = tree.markers[1].X_LA[:3, 3] - tree.markers[0].X_LA[:3, 3]
    far = [0.2 - p[1], -0.1 + p[0], 0.3 + p[2]]
    both = {**told, **{f"hand_tag1.{a}": v for a, v in zip("xyz", far, strict=True)}}
    assert exchanged_parts(tree, both) == {"j2.x", "j2.y", "j2.z", "j2.rz"}
    assert told_size(tree, both) == "told places on 'j2'"
    for one in (told, both):
        now = framed(tree, one, sized=True)
        np.testing.assert_allclose(now.markers[0].X_LA[:3, 3], [0.2, -0.1, 0.3])
        np.testing.assert_allclose(*(predicted(t, tracked.data) for t in (now, tree)), atol=1e-12)
    twice = framed(tree.scaled(0.5), both, sized=False)
    np.testing.assert_allclose(*(predicted(t, tracked.data)[1:] for t in (twice, now)), atol=1e-1)
    np.testing.assert_allclose(twice.markers[1].X_LA[:3, 3], far)


def test_a_body_that_ran_away_is_named_with_where_it_went(tracked):
    parameters = TreeParameters(tracked.tree)
    start = parameters.start
    size = max(np.abs(start[np.array(parameters.units) == "m"]).max(), 0.1)
    k = parameters.index["hand_tag1.y"]
    for far, stays in ((99.0, True), (101.0, False), (np.nan, False)):
        values = start.copy()
        values[k] = far * size
        if stays:
            check_that_it_stayed(parameters, start, values)
            continue
        with pytest.raises(NotConvergedError, match=r"ran away: hand_tag1\.y went from .*--fix"):
            check_that_it_stayed(parameters, start, values)


@pytest.mark.parametrize(
    ("held", "priors", "longest"),
    [
        ({"right.y": -0.007, "right.z": 0.3}, {}, "right.z"),
        ({"right.y": -0.3, "right.z": 0.007}, {}, "right.y"),
        ({"right.y": -0.007}, {"right.z": (0.3, 0.05)}, "right.y"),
        ({"right.y": -0.007}, {"right.z": (0.3, 0.04)}, "right.z"),
    ],
)
def test_of_told_lengths_the_one_known_to_the_best_share_says_how_large_all_is(
    held, priors, longest
):
    sim = one_arm(0, joints=2, markers=1, poses=12, sensor="camera")
    parameters = TreeParameters(from_first_camera(sim.tree))
    wishes = Wishes(FixedParameters(held), priors)
    assert setup_of(sim.data, parameters, None, wishes).scale_from == longest


def test_a_length_that_is_too_short_to_tell_how_large_all_is_is_named(tracked):
    parameters = TreeParameters(tracked.tree)
    cause = too_short("right.y", {"right.y": -0.007})
    with pytest.raises(NotConvergedError, match=r"only `right\.y` = -0\.007 m tells.*leave"):
        check_that_it_stayed(parameters, parameters.start, 1e6 * parameters.start, cause)
    assert too_short("tracker", {"right.y": -0.007}) == too_short(None, {}) == ""


def test_what_nothing_tells_stays_where_it_is_beside_effects():
    U = np.random.default_rng(0).normal(size=(30, 4))
    U[:, 1] = 0.0
    reduced = Reduced.of(U.T @ U, U.T @ np.ones(30), {"sag": np.array([3])}, np.ones(4))
    assert abs(reduced.alone[1]) + abs(reduced.gain[1, 0]) < 1e-12


@pytest.mark.slow
def test_one_camera_tells_a_body_and_its_lens_by_a_board_in_its_hand():
    sim = one_arm(2, joints=3, markers=12, poses=40, sensor="camera", joint_sigma=np.radians(0.1))
    grid = 0.03 * np.array([[k % 4, k // 4, 0.0] for k in range(12)]) + [0.05, 0.02, 0.1]
    both = zip(sim.tree.markers, grid, strict=True)
    board = tuple(replace(m, X_LA=transform(np.eye(3), p)) for m, p in both)
    sim = replace(sim, tree=sim.tree.with_markers(board))
    sensors, rng = sim.data.sensors[:1], np.random.default_rng(0)
    held = sim.tree, sim.data.joints, with_known_markers(sim).markers, sensors, sim.readings_true
    noise = {"joint_sigma": np.radians(0.1), "sigma": {"camera": 0.3}}
    seen = observed(*held, rng, **noise)
    seen = replace(seen, sensors=(replace(sensors[0], lens=None),))
    first = np.arange(40) < 28
    found = calibrate_tree(seen.select(first), test=seen.select(~first), effects=())
    assert found.test.by_row().mean() < 1.0
    assert found.setup.scale_from == "told places on 'j3'"
    assert found.tree.lenses["left"].fx == pytest.approx(sim.tree.lenses["left"].fx, rel=0.02)

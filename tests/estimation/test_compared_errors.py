"""What new recordings are held against: errors of one kind, as large as noise lets expect there."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.joining import joined
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.model_verdict import judge_body_errors
from nico_selfmodel.estimation.tree.compared_errors import (
    RELATIVE,
    errors_beside_training,
    errors_of_tree,
    expected_errors,
    other_errors_beside_training,
    usual_errors,
)
from nico_selfmodel.estimation.tree.tree_calibration import refit_tree
from nico_selfmodel.estimation.tree.tree_errors import errors_of, told_by
from nico_selfmodel.estimation.tree.tree_result import tree_result
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.tree_motion import TreeMotion

from .simulated_trees import Simulated, looking_at, observed, one_arm

NOISE = {"left": 0.3, "right": 0.3, **{f"j{i + 1}": float(np.radians(0.2)) for i in range(5)}}


def filmed(seed, poses, near=None):
    """An arm close before two cameras; its poses nearest to them, or farthest, if asked."""
    made = one_arm(seed, markers=3, poses=poses, sensor="camera")
    sensors = tuple(
        replace(sensor, X_LA=looking_at(np.array([0.75, y, 0.4]), [0.0, 0.0, 0.3]))
        for sensor, y in zip(made.tree.sensors, (-0.25, 0.25), strict=True)
    )
    tree, q = replace(made.tree, sensors=sensors), made.readings_true
    motion = TreeMotion.at(tree, q)
    far = np.linalg.norm(motion.pose_of(tree.markers[0])[1].T - sensors[0].X_LA[:3, 3], axis=1)
    order = np.argsort(far)
    kept = {None: order, True: order[: poses // 5], False: order[-poses // 5 :]}[near]
    rng = np.random.default_rng((seed, 9))
    data = made.data
    seen = observed(
        tree, data.joints, data.markers, data.sensors, q, rng,
        joint_sigma=np.radians(0.2), sigma={"camera": 0.3},
    )  # fmt: skip
    return Simulated(tree, seen.select(np.isin(np.arange(poses), kept)), q)


def usual_of(made, data):
    return usual_errors(made.tree, errors_of(made.tree, data).observations, NOISE)


def test_usual_errors_are_those_that_noise_leaves():
    made = filmed(2, 400)
    off = errors_of(made.tree, made.data).by_row()
    relative = off / usual_of(made, made.data)
    assert np.sqrt(np.mean(relative**2)) == pytest.approx(1.0, abs=0.05)


def test_poses_before_the_cameras_are_not_called_worse_for_being_near():
    made, near = filmed(2, 400), filmed(2, 400, near=True)
    errors = errors_of(made.tree, made.data)
    all_rows = np.ones(len(made.data.observations), dtype=bool)
    expected = expected_errors(errors, all_rows, usual_of(made, made.data))
    body = BodyModel("arm", made.tree, np.ones(5), noise=NOISE, expected=expected)
    found = errors_of(near.tree, near.data)
    assert judge_body_errors(body, errors_beside_training(body, found)).status == "PASS"
    plain = {"px": {k: v for k, v in expected["px"].items() if k != RELATIVE}}
    told_less = replace(body, expected=plain)
    assert judge_body_errors(told_less, errors_beside_training(told_less, found)).status == "FAIL"


def test_far_poses_that_are_too_far_off_fail():
    made, far = filmed(2, 400), filmed(2, 400, near=False)
    all_rows = np.ones(len(made.data.observations), dtype=bool)
    expected = expected_errors(errors_of(made.tree, made.data), all_rows, usual_of(made, made.data))
    body = BodyModel("arm", made.tree, np.ones(5), noise=NOISE, expected=expected)
    table = far.data.observations
    pushed = replace(far.data, observations=replace(table, values=table.values + 1.5))
    found = errors_beside_training(body, errors_of(far.tree, pushed))
    assert judge_body_errors(body, found).status == "FAIL"
    sound = errors_beside_training(body, errors_of(far.tree, far.data))
    assert judge_body_errors(body, sound).status == "PASS"


def shifted(data, sensors, by):
    """Return a recording of which some sensors saw all a little aside."""
    table = data.observations
    own = np.isin(np.array([s.name for s in data.sensors])[table.sensor], sensors)
    return replace(data, observations=replace(table, values=table.values + by * own[:, None]))


@pytest.mark.parametrize(
    ("sensors", "by", "status"),
    [((), 0.0, "PASS"), (("left",), 3.0, "FAIL"), (("tracker",), 2e-3, "FAIL")],
)
def test_each_kind_of_error_is_held_against_its_own(both, sensors, by, status):
    """A camera that moved leaves what a tracker measured where it was."""
    tree, data, free, _ = both
    found = refit_tree(tree, data, free, world="tracker")
    kept = ~found.solution.outliers
    expected = expected_errors(found.train, kept, None)
    body = BodyModel("arm", found.tree, np.ones(5), noise=NOISE, expected=expected)
    left = errors_of(found.tree, shifted(data, sensors, by))
    first = errors_beside_training(body, left)
    others = other_errors_beside_training(body, left, first)
    assert (first.compared_by, [one.compared_by for one in others]) == ("mm", ["px"])
    assert judge_body_errors(body, first, None, others).status == status


def test_pixels_are_judged_where_places_are_too_few(both):
    tree, data, free, _ = both
    found = refit_tree(tree, data, free, world="tracker")
    expected = expected_errors(found.train, ~found.solution.outliers, None)
    body = BodyModel("arm", found.tree, np.ones(5), noise=NOISE, expected=expected)
    few = shifted(data, ("left",), 20.0).select(np.arange(80) >= 37)
    left = errors_of(found.tree, few)
    first = errors_beside_training(body, left)
    assert (first.compared_by, len(first.compared)) == ("mm", 3)
    assert judge_body_errors(body, first).status == "NOT_EVALUATED"
    others = other_errors_beside_training(body, left, first)
    assert judge_body_errors(body, first, None, others).status == "FAIL"


@pytest.mark.parametrize(("by", "status"), [(0.0, "PASS"), (3.0, "FAIL")])
def test_held_out_pixels_that_are_worse_fail_though_places_are_not(both, by, status):
    tree, data, free, _ = both
    odd = np.arange(80) % 2 == 1
    test = shifted(data, ("left",), by).select(odd)
    found = refit_tree(tree, data.select(~odd), free, world="tracker", test=test)
    result = tree_result(found)
    assert result.test.compared_by == "mm"
    assert [test.compared_by for test, _ in result.compared_too] == ["px"]
    assert judge(found).status == status


@pytest.fixture(scope="module")
def both():
    """An arm that a tracker and two cameras saw, at other poses."""
    tracked, seen = (
        one_arm(3, markers=2, poses=40),
        one_arm(3, markers=2, poses=40, sensor="camera"),
    )
    data = joined(tracked.data, seen.data, "both")
    tree = replace(seen.tree, sensors=(*tracked.tree.sensors, *seen.tree.sensors))
    free = {f"hand_tag{k}.{part}" for k in (0, 1) for part in "xyz"}
    return tree, data, free, seen.data


def test_held_out_pixels_are_held_against_pixels_though_a_tracker_measured_too(both):
    tree, data, free, seen = both
    test = replace(data, observations=data.observations).select(np.arange(80) >= 40)
    assert len(test.observations) == len(seen.observations)
    found = refit_tree(tree, data, free, world="tracker", test=test)
    result = tree_result(found)
    assert (result.test.compared_by, result.cross_validation.compared_by) == ("px", "px")
    assert judge(found).status == "PASS"


def test_what_is_expected_is_told_for_each_kind(both):
    tree, data, free, _ = both
    found = refit_tree(tree, data, free, world="tracker")
    errors = errors_of_tree(found.train)
    assert errors.compared_by == "mm"
    kept = ~found.solution.outliers
    assert set(expected_errors(found.train, kept, None)) == {"mm", "px"}


@pytest.mark.parametrize(("counts", "refused"), [(4096, False), (4095, True), (8192, True)])
def test_counts_of_a_turn_are_those_that_the_body_was_learned_with(counts, refused):
    made = one_arm(1, joints=2, poses=6)
    per_count = 2.0 * np.pi / 4096.0
    model = BodyModel("arm", made.tree, np.array([per_count, 1.0]), None, {}, {}, {})
    first, second = made.data.joints
    counting = replace(first, encoder_unit="counts", counts_per_turn=counts)
    data = replace(made.data, joints=(counting, second))
    if not refused:
        assert told_by(model, data).joints == data.joints
        return
    with pytest.raises(DataError, match=r"a count of joint 'j1' is .* correct counts_per_turn"):
        told_by(model, data)

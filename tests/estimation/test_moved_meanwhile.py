"""What moves while a body is recorded is found, with when and how far."""

import re
from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_dataset import ObservationTable
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.diagnosis.changes_in_time import NOTABLE, Change
from nico_selfmodel.estimation.diagnosis.jump_taken_for_noise import jump_taken_for_noise
from nico_selfmodel.estimation.diagnosis.score_sums import ScoreSums
from nico_selfmodel.estimation.judging import judge, result_of
from nico_selfmodel.estimation.results.calibration_result import CAUSE, FAILURE
from nico_selfmodel.estimation.tree import tree_findings
from nico_selfmodel.estimation.tree.forward.joint_errors import MOST_SLIPS
from nico_selfmodel.estimation.tree.timing import moved_meanwhile as module
from nico_selfmodel.estimation.tree.timing import parted_sensor
from nico_selfmodel.estimation.tree.timing.lone_outliers import lone_outliers
from nico_selfmodel.estimation.tree.timing.moved_meanwhile import LEAST_RATIO, moved_meanwhile
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_setup import Description
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vector_of
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.optimization.chi_square import chi_square_tail

from ..slow_rest import slow_rest
from .simulated_trees import observed, one_arm, turned
from .test_one_problem import flange_dataset, hand_eye_poses

POSES, AFTER = 60, 34
SIGMA = {"points": 2e-4, "camera": 0.3}


def moved_by(part, shift=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0)):
    return replace(part, X_LA=part.X_LA @ transform(rotation_from_vector(turn), shift))


def later(made, what):
    """What is seen from some sample on: the body, and where its joints are."""
    tree, q = made.tree, made.readings_true
    if what == "encoder":
        return tree, q + np.radians(1.0) * (np.arange(q.shape[1]) == 2)
    if what == "marker":
        first, *rest = tree.markers
        return replace(tree, markers=(moved_by(first, (0.0, 0.004, 0.0)), *rest)), q
    if what == "plate":
        slip = transform(rotation_from_vector([0.0, 0.01, 0.0]), [0.0, 0.003, 0.0])
        return replace(tree, markers=tuple(replace(m, X_LA=slip @ m.X_LA) for m in tree.markers)), q
    first, *rest = tree.sensors
    far = ((0.003, 0.0, 0.0), (0.0, 0.0, 0.0)) if what == "tracker" else (
        (0.0, 0.0, 0.0), (0.0, np.radians(0.5), 0.0))  # fmt: skip
    return replace(tree, sensors=(moved_by(first, *far), *rest)), q


def recorded(what, seed=3, sensor="points"):
    """A recording in the middle of which something moved."""
    made = one_arm(seed, markers=3, poses=POSES, sensor=sensor, joint_sigma=np.radians(0.05))
    if what is None:
        return made.data
    info = made.data.joints, made.data.markers, made.data.sensors
    parts = []
    for (tree, q), late in (((made.tree, made.readings_true), False), (later(made, what), True)):
        rng, how = np.random.default_rng(7), {"joint_sigma": np.radians(0.05), "sigma": SIGMA}
        table = observed(tree, *info, q, rng, **how).observations
        keep = (table.pose > AFTER) == late
        parts.append({f.name: getattr(table, f.name)[keep] for f in fields(ObservationTable)})
    both = {k: np.concatenate([part[k] for part in parts]) for k in parts[0]}
    return replace(made.data, observations=ObservationTable(**both))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "sensor", "said", "size"),
    [
        ("marker", "points", r"'hand_tag0' slipped on its link by about (\S+) mm", 4.0),
        ("encoder", "points", r"the encoder of 'j3' jumped by about (\S+) deg", 1.0),
        ("plate", "points", r"carries markers on 'j5' moved by about (\S+) mm", 3.1),
        ("plate", "camera", r"markers on 'j5' moved by about \S+ mm and (\S+) deg", 0.5),
        ("tracker", "points", r"sensor 'tracker' moved by about (\S+) mm", 3.0),
        ("camera", "camera", r"sensor 'left' moved by about \S+ mm and (\S+) deg", 0.5),
    ],
)
def test_what_moves_is_named_with_when_and_how_far(what, sensor, said, size):
    found = calibrate_tree(recorded(what, sensor=sensor))
    verdict = judge(found)
    assert verdict.status == "FAIL"
    (reason,) = [text for text in verdict.reasons if "learn from one part alone" in text]
    told = re.search(said, reason)
    assert told, reason
    assert float(told[1]) == pytest.approx(size, rel=0.2)
    when = int(re.search(r"after sample (\d+)", reason)[1])
    assert abs(when - AFTER) <= 2


@pytest.mark.parametrize(
    ("what", "said", "size"),
    [
        ("marker", r"'hand_tag0' slipped on its link by about (\S+) mm", 4.0),
        ("tracker", r"sensor 'tracker' moved by about (\S+) mm", 3.0),
    ],
)
def test_what_moves_is_named_with_how_far_of_a_described_robot(what, said, size):
    tree = one_arm(3, markers=3, poses=POSES, joint_sigma=np.radians(0.05)).tree
    found = calibrate_tree(recorded(what), description=Description(tree), effects=())
    change = moved_meanwhile(found.ladder.solution.problem, found.solution)
    assert change is not None
    told = re.search(said + f" .*after sample {AFTER}", change.what)
    assert told, change.what
    assert float(told[1]) == pytest.approx(size, rel=0.1)


def of_a_described_arm(seed, turned_by, poses=40):
    """An arm before two cameras, the right one turned in the middle, and its description."""
    rng = np.random.default_rng(seed)
    made = one_arm(seed, joints=5, markers=4, poses=poses, sensor="camera", joint_sigma=5e-4)
    left, right = made.tree.sensors
    later_on = replace(made.tree, sensors=(left, moved_by(right, turn=(0.0, turned_by, 0.0))))
    info = made.data.joints, made.data.markers, made.data.sensors
    seen = observed(later_on, *info, made.readings_true, rng, joint_sigma=5e-4, sigma=SIGMA)
    first = made.data.observations.pose < poses // 2
    later_rows = seen.observations.pose >= poses // 2
    parts = (made.data.observations, first), (seen.observations, later_rows)
    both = {
        f.name: np.concatenate([getattr(table, f.name)[keep] for table, keep in parts])
        for f in fields(ObservationTable)
    }
    off = np.array([X @ turned(rng, 0.3, 0.7) for X in made.tree.X_PJ])
    data = replace(made.data, observations=ObservationTable(**both))
    return data, Description(replace(made.tree, X_PJ=off))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20, 24))
def test_a_camera_that_moved_so_far_that_no_body_explains_it_is_named_with_when(seed):
    """It had been said to contradict all the rest."""
    data, description = of_a_described_arm(seed, np.radians(4.0))
    said = r"sensor 'right' of data set .* moved after sample 19: "
    with pytest.raises(DataError, match=said):
        calibrate_tree(data, description=description, effects=())


@pytest.mark.parametrize(("part", "last"), [(0.25, 13), (0.35, None), (2.9, None), (4.0, 13)])
def test_errors_of_a_sensor_part_at_a_sample_where_they_are_far_smaller_on_one_side(part, last):
    times = np.arange(30)
    errors = np.where(np.repeat(times, 2) > 13, part, 1.0)
    assert parted_sensor._parting(times, errors, np.repeat(times, 2)) == last


@pytest.mark.parametrize("seed", slow_rest(list(range(3, 15))))
def test_nothing_moves_in_a_sound_recording(seed):
    found = calibrate_tree(recorded(None, seed)).ladder.solution
    assert moved_meanwhile(found.problem, found.solution) is None


def target_of(seed, turn=0.0, poses=40):
    """A sensor of whole poses and a target, which is turned in its place in the middle."""
    _, _, flanges, seen = hand_eye_poses(np.random.default_rng(seed), poses)
    data = flange_dataset(flanges, seen)
    values, later = data.observations.values.copy(), slice(poses // 2, None)
    turned = values[later, 3:6]
    by = rotation_from_vector(np.array([0.0, 0.0, np.radians(turn)]))
    values[later, 3:6] = [rotation_vector_of(rotation_from_vector(one) @ by) for one in turned]
    return replace(data, observations=replace(data.observations, values=values))


def test_a_target_that_is_turned_in_its_place_is_named():
    """Its place stays: it had been a PASS, with half of the turn in the answer."""
    verdict = judge(calibrate_tree(target_of(2, turn=1.2)))
    assert verdict.status == "FAIL"
    told = re.match(
        r"marker 'target' moved by about \S+ mm and (\S+) deg after", verdict.reasons[0]
    )
    assert float(told[1]) == pytest.approx(1.2, rel=0.25)


@pytest.mark.parametrize("seed", slow_rest(list(range(40, 56))))
def test_a_target_that_stood_still_is_not_said_to_have_moved(seed):
    found = calibrate_tree(target_of(seed)).ladder.solution
    assert moved_meanwhile(found.problem, found.solution) is None


def bumped(seed, poses, part=1.0):
    """A camera that is moved by 6.4 mm and 1.3 deg, or a part of that, in the middle."""
    _, _, flanges, seen = hand_eye_poses(np.random.default_rng(seed), poses)
    by = transform(rotation_from_vector(part * np.array([0.02, 0.01, 0.0])), [0.005, 0.0, 0.004])
    by[:3, 3] *= part
    return flange_dataset(flanges, np.concatenate([seen[: poses // 2], by @ seen[poses // 2 :]]))


@pytest.mark.parametrize("poses", slow_rest([12, 14, 16, 19, 11], 2))
def test_a_camera_that_moved_is_named_by_a_dozen_poses_of_a_flange(poses):
    """It had been a PASS, and predictions were off by a centimetre."""
    verdict = judge(calibrate_tree(bumped(5, poses)))
    assert verdict.status == "FAIL"
    assert re.match(r"\w+ '\w+' moved by about \S+ mm and \S+ deg after", verdict.reasons[0])


@pytest.mark.parametrize("poses", slow_rest(list(range(8, 20)), 2))
def test_nothing_moves_in_a_few_sound_poses_of_a_flange(poses):
    for seed in range(60, 65):
        found = calibrate_tree(target_of(seed, poses=poses)).ladder.solution
        assert moved_meanwhile(found.problem, found.solution) is None


def test_chance_counts_few_degrees_of_freedom():
    """Of as much of the squares of noise by three more columns, as often as it is drawn."""
    rng, n, k = np.random.default_rng(4), 14, 3
    r = rng.normal(size=(200_000, n))
    share = np.sum(r[:, :k] ** 2, axis=1) / np.sum(r**2, axis=1)
    for asked in (0.3, 0.5, 0.7):
        told = ScoreSums.chance(
            SimpleNamespace(dof=n), SimpleNamespace(statistic=n * asked), [0] * k
        )
        assert told == pytest.approx(np.mean(share > asked), rel=0.1)
    many = ScoreSums.chance(SimpleNamespace(dof=1e6), SimpleNamespace(statistic=44.0), [0] * 6)
    assert many == pytest.approx(chi_square_tail(44.0, 6), rel=0.01)


def test_few_poses_are_not_asked():
    made = one_arm(3, joints=2, markers=3, poses=19)
    found = calibrate_tree(made.data).ladder.solution
    assert moved_meanwhile(found.problem, found.solution) is None


@pytest.mark.parametrize(
    ("ratio", "said"),
    [(LEAST_RATIO - 1e-6, ()), (LEAST_RATIO, ("warning",)), (NOTABLE - 1e-6, ("warning",)),
     (NOTABLE + 1e-6, ("failure",))],
)  # fmt: skip
def test_a_change_is_told_by_how_much_it_matters(monkeypatch, ratio, said):
    change = Change("something moved", ratio)
    monkeypatch.setattr(module, "likeliest_change", lambda *_: change)
    result = result_of(calibrate_tree(one_arm(3, joints=2, markers=3, poses=30).data))
    told = [one.severity for one in result.findings if "something moved" in one.text]
    assert tuple(told) == said


@pytest.mark.slow
def test_samples_that_saw_nothing_hide_no_change():
    data = recorded("marker")
    seen = data.observations
    bare = data.of_rows(~np.isin(seen.pose, [5, 20, POSES - 1]))
    found = calibrate_tree(bare, effects=())
    change = moved_meanwhile(found.ladder.solution.problem, found.solution)
    assert change is not None
    assert change.what.startswith("marker 'hand_tag0' slipped")


@pytest.mark.slow
def test_a_wrong_label_of_a_marker_that_was_hardly_seen_before_is_no_slip():
    data = recorded(None)
    table = data.observations
    early = (table.marker == 0) & (table.pose < 12)
    values = table.values.copy()
    wrong = np.flatnonzero(early & np.isin(table.pose, [3, 7]))
    values[wrong] = values[[np.flatnonzero((table.marker == 1) & (table.pose == p))[0]
                            for p in table.pose[wrong]]]  # fmt: skip
    few = replace(data, observations=replace(table, values=values))
    few = few.of_rows(~early | np.isin(np.arange(len(table)), wrong))
    found = calibrate_tree(few, effects=())
    assert moved_meanwhile(found.ladder.solution.problem, found.solution) is None


@pytest.mark.parametrize(("fifths", "at_all_times"), [((1, 3), True), ((0, 2, 4), False)])
def test_slips_that_begin_with_more_than_half_of_the_samples_are_a_change(fifths, at_all_times):
    """From the middle on two or three of five samples slip, before it none."""
    sample = np.arange(40)
    slipped = ((sample >= 20) & np.isin(sample % 5, fifths))[:, None]
    data = SimpleNamespace(visit=sample, sample=sample)
    problem = SimpleNamespace(observations=SimpleNamespace(data=data))
    kept = module._now_and_then(problem, SimpleNamespace(slipped=slipped))
    assert kept.any() == at_all_times
    assert not (kept & ~slipped).any()


@pytest.mark.parametrize(
    ("jump", "side", "told"), [(4e-3, 0.0, True), (2e-3, 0.0, False), (0.0, 0.01, False)]
)
def test_errors_of_a_joint_read_worse_than_others_are_its_jump_where_no_side_is(jump, side, told):
    rng, every = np.random.default_rng(7), np.arange(50)
    q = rng.uniform(-1.2, 1.2, 50)
    errors = 1.2e-3 * rng.normal(size=50) + jump * (every > 30)
    errors += side * np.sign(np.diff(q, prepend=q[0]))
    found = jump_taken_for_noise(errors, q, every)
    assert (found is not None) is told
    assert not told or (abs(found.last - 30) <= 2 and found.size == pytest.approx(jump, rel=0.3))


@pytest.mark.parametrize(("ratio", "kind"), [(1.49, FAILURE), (1.51, CAUSE)])
def test_what_moved_is_the_cause_of_all_else_where_it_explains_a_third(monkeypatch, ratio, kind):
    moved = Change("the encoder of 'j3' jumped", ratio)
    monkeypatch.setattr(tree_findings, "moved_meanwhile", lambda problem, solution: moved)
    found = tree_findings.tree_findings(calibrate_tree(one_arm(2, joints=3).data, effects=()))
    assert [one.severity for one in found if "jumped" in one.text] == [kind]


@pytest.mark.slow
def test_a_jump_in_a_smooth_recording_is_named_though_its_joints_noise_explains_it():
    rng, made = np.random.default_rng(4), one_arm(4, joints=6, markers=1)
    data, waves = made.data, np.arange(60)[:, None] / rng.uniform(8.0, 30.0, 6)
    q = 1.2 * np.sin(2.0 * np.pi * (waves + rng.uniform(size=6)))
    off = np.zeros_like(q)
    off[35:, 1] = 0.02
    how = {"joint_sigma": np.radians(0.01), "sigma": {"points": 2e-4}}
    seen = observed(made.tree, data.joints, data.markers, data.sensors, q + off, rng, **how)
    verdict = judge(calibrate_tree(replace(seen, readings=q)))
    assert verdict.reasons[0].startswith("the encoder of 'j2' jumped by about 1.2 deg after")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "said"),
    [(2, "jumped by about 3 deg after sample 32"), (6, "jumped by"), (7, "jumped by")],
)
def test_a_jump_is_named_though_its_joint_would_be_read_wrongly_in_most_poses(seed, said):
    made = one_arm(seed, joints=4, markers=2, joint_sigma=np.radians(0.012))
    off = np.radians(3.0) * (np.arange(60) > 32)[:, None] * (np.arange(4) == 1)
    data = replace(made.data, readings=made.data.readings + off)
    found = calibrate_tree(data, effects=())
    assert found.solution.slipped[:, 1].mean() > MOST_SLIPS
    assert judge(found).reasons[0].startswith(f"the encoder of 'j2' {said}")


def turned_camera(shift, poses=40):
    """An arm before two cameras, one turned halfway, with a detection in thirty far off."""
    arm = one_arm(1, 5, markers=8, poses=poses, sensor="camera", joint_sigma=np.radians(0.2))
    table, rng = arm.data.observations, np.random.default_rng(1)
    values = table.values.copy()
    values[(table.sensor == 0) & (table.pose >= poses // 2), 0] += shift
    wrong, turn = rng.random(len(values)) < 0.03, rng.uniform(0.0, 2.0 * np.pi, len(values))
    far = rng.uniform(15.0, 150.0, len(values)) * [np.cos(turn), np.sin(turn)]
    values[wrong, :2] += far.T[wrong]
    return replace(arm.data, observations=replace(table, values=values))


@pytest.mark.slow
def test_wrong_detections_here_and_there_do_not_hide_a_camera_that_turned():
    found = calibrate_tree(turned_camera(2.0), effects=())
    reasons = " ".join(judge(found).reasons)
    assert "sensor 'left' moved by about" in reasons
    assert "after sample 19" in reasons


@pytest.mark.parametrize(
    ("set_aside", "beyond", "lone"),
    [
        ([(0, 0), (7, 1)], 1.0, [True, True]),
        ([(pose, 0) for pose in range(8)], 1.0, [False] * 8),
        ([(3, marker) for marker in range(4)], 1.0, [False] * 4),
        ([(0, 1), *((pose, 0) for pose in range(8, 16))], 1.0, [True] + [False] * 8),
        ([(pose, 0) for pose in range(8)], 3.9, [False] * 8),
        ([(pose, 0) for pose in range(8)], 4.1, [True] + [False] * 7),
    ],
)
def test_many_outliers_of_a_marker_or_a_pose_are_no_lone_ones(set_aside, beyond, lone):
    # The first is further off than the others, which were knocked.
    pose, marker = np.divmod(np.arange(240), 6)
    table = SimpleNamespace(pose=pose, marker=marker, sensor=np.zeros(240, dtype=int))
    data: Any = SimpleNamespace(observations=table, sample=np.arange(40))
    rows = [6 * pose + marker for pose, marker in set_aside]
    outliers = np.zeros(240, dtype=bool)
    outliers[rows] = True
    far = np.where(outliers, 10.0, 1.0)
    far[rows[0]] = 10.0 * beyond
    found = lone_outliers(data, outliers, far)
    assert found[rows].tolist() == lone
    assert not found[~outliers].any()

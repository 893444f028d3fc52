"""What a recording of a body contradicts is named, and never passes."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_dataset import ANY_POSE
from nico_selfmodel.dataset.body.sensors import CAMERA, SensorInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.results.calibration_result import CAUSE, FAILURE, NOTE, WARNING
from nico_selfmodel.estimation.tree.contradictions.contradiction_words import as_printed
from nico_selfmodel.estimation.tree.contradictions.held_scores import HeldScore, severity_of
from nico_selfmodel.estimation.tree.contradictions.wrong_readings import poses_off
from nico_selfmodel.estimation.tree.known.lens_parts import (
    FOCAL,
    SIZE,
    LensPart,
    lens_findings,
    wrong_parts,
)
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_findings import distance_words
from nico_selfmodel.estimation.tree.tree_result import tree_result
from nico_selfmodel.estimation.tree.tree_setup import Description
from nico_selfmodel.geometry.rotation import rotation_from_vector

from ..slow_rest import slow_rest
from .simulated_trees import (
    LENS,
    assembled,
    looking_at,
    observed,
    one_arm,
    serial,
    tags,
    turned,
    two_arms,
)
from .test_boards_in_hand import with_boards
from .test_one_problem import KNOWN, flange_dataset, hand_eye_poses


def verdict(data):
    train, test = data.split(0.25, 0)
    return judge(calibrate_tree(train, test=test, effects=()))


def seen_with(data, lens):
    """The same recording whose first camera is said to have another lens."""
    first = next(i for i, s in enumerate(data.sensors) if s.kind == CAMERA)
    sensors = list(data.sensors)
    sensors[first] = replace(sensors[first], lens=lens)
    return replace(data, sensors=tuple(sensors))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ({}, ""),
        ({"fx": 630.0}, r"\(camera1\.fx 630 px would go to (59[89]|60[0-2])\): correct it"),
        ({"fx": 630.0, "fy": 630.0}, r"\(camera1\.fx and camera1\.fy 630 and 630 px would go to "),
        ({"cx": 345.0}, r"\(camera1\.cx 345 px would go to 3(1[7-9]|2[0-3])\): correct it"),
        ({"k1": 0.0}, r"\(camera1\.k1 0 would go to -0\.1.*\): a lens told without its distortion"),
    ],
)
def test_the_number_of_a_lens_that_is_wrong_fails_and_is_named(numbers, words):
    data = two_arms(3, poses=40, distances=KNOWN).data
    lens = dict(next(s for s in data.sensors if s.kind == CAMERA).lens)
    found = verdict(seen_with(data, {**lens, **numbers}))
    assert found.status == ("FAIL" if numbers else "PASS")
    if numbers:
        assert re.match(f"lenses contradict what was seen {words}", found.reasons[0])


def parts_of(Z, z):
    columns = {("left", name): np.ones(len(z)) for name in (FOCAL, "fx", "k1")}
    return wrong_parts(columns, Z, z, len(z))


@pytest.mark.parametrize(("apart", "others"), [(0.05, ["fx"]), (0.4, [])])
def test_numbers_of_a_lens_that_explain_as_much_are_not_told_apart(apart, others):
    rng = np.random.default_rng(0)
    Z, z = rng.normal(size=(200, 3)), rng.normal(size=200)
    Z[:, 1] = Z[:, 0] + apart * Z[:, 1]
    first, second = parts_of(Z, z - 2.0 * Z[:, 0] - 0.7 * Z[:, 2])
    assert {first.part, *(one.part for one in first.others)} == {FOCAL, *others}
    assert second.part == "k1"
    assert [first.value, second.value] == pytest.approx([2.0, 0.7], abs=0.25)
    assert not parts_of(Z, z)


@pytest.mark.parametrize(
    ("part", "gain", "doubted"),
    [(0, 15.0, None), (0, 15.3, True), (0, 25.9, True), (0, 26.3, False), (1, 25.9, None)],
)
def test_a_focal_length_is_doubted_once_in_ten_thousand_and_wrong_once_in_a_million(
    part, gain, doubted
):
    Z, z = np.eye(200, 3), np.zeros(200)
    z[part], z[3:] = np.sqrt(gain), np.sqrt((200.0 - gain) / 197.0)
    found = parts_of(Z, z)
    assert [one.doubted for one in found] == ([] if doubted is None else [doubted])
    for one in found:
        assert (one.part, one.value) == (FOCAL, pytest.approx(-np.sqrt(gain)))
        assert replace(one, scalars=100).severity == (WARNING if doubted else CAUSE)


@pytest.mark.parametrize(("value", "said"), [(-2.9, False), (-3.1, True)])
@pytest.mark.parametrize(("share", "severity"), [(0.029, WARNING), (0.031, CAUSE)])
def test_a_lens_fails_by_a_thirtieth_of_what_its_camera_saw(value, said, share, severity):
    part = LensPart("left", "cx", share * 1000, value, 1.0, 1000)
    found = lens_findings([part], {"left": LENS}, 0.0)
    assert [one.severity for one in found] == [severity] * said


def test_a_number_of_a_lens_that_two_causes_would_move_is_to_be_freed_once():
    moved = {"fy": 30.0, SIZE: 0.1}
    parts = [LensPart("left", part, 1000, by, 1e-3, 1000) for part, by in moved.items()]
    (found,) = lens_findings(parts, {"left": LENS}, 0.0)
    freed = "`--free left.fy --free left.fx --free left.cx --free left.cy` learns them"
    assert found.text.endswith(freed)


@pytest.mark.slow
def test_a_target_of_another_size_fails_by_its_factor():
    _, _, F, M = hand_eye_poses(np.random.default_rng(4), 40)
    right = flange_dataset(F, M)
    assert verdict(right).status == "PASS"
    larger = right.observations.values * [1.05, 1.05, 1.05, 1.0, 1.0, 1.0]
    wrong = verdict(replace(right, observations=replace(right.observations, values=larger)))
    assert wrong.status == "FAIL"
    assert "times as long as all else says" in wrong.reasons[0]
    assert 1.03 < float(wrong.reasons[0].split(" measured is ")[1].split()[0]) < 1.07


@pytest.mark.parametrize(("factor", "status"), [(1.0, "NOT_EVALUATED"), (0.97, "FAIL")])
@pytest.mark.parametrize("seed", slow_rest(list(range(6)), 2))
def test_a_target_of_another_size_fails_by_eight_poses_of_a_flange(seed, factor, status):
    """It had been taken for noise of the flange."""
    _, _, F, M = hand_eye_poses(np.random.default_rng(seed), 8)
    M[:, :3, 3] *= factor
    found = judge(calibrate_tree(flange_dataset(F, M), effects=()))
    assert found.status == status
    if factor < 1.0:
        told = re.search(r"squares are (\S+) % larger than was told: 25.8 mm", found.reasons[0])
        assert told, found.reasons
        assert float(told[1]) == pytest.approx(3.1, abs=0.3)


def tag_before_a_camera(seed, factor, count=1):
    """An arm with a tag whose poses are too long by a factor, and its description a little off."""
    rng = np.random.default_rng(seed)
    names = [f"j{i + 1}" for i in range(6)]
    chain, frames = serial(rng, names, "world", 0.5)
    infos, attached = tags(rng, "hand", names[-1], count)
    sensors = [SensorInfo("camera", "poses")]
    places = [looking_at(np.array([1.3, 0.2, 0.4]), [0.0, 0.0, 0.3])]
    tree = assembled(chain, frames, infos, attached, sensors, places, {})
    q, sigma = rng.uniform(-1.2, 1.2, size=(60, 6)), {"points": 5e-4, "turn": 2e-3}
    data = observed(tree, chain, infos, sensors, q, rng, joint_sigma=1e-3, sigma=sigma)
    values = data.observations.values * np.append(np.full(3, factor), np.ones(3))
    off = np.array([X @ turned(rng, 0.3, 0.7) for X in tree.X_PJ])
    data = replace(data, observations=replace(data.observations, values=values))
    return data, Description(replace(tree, X_PJ=off))


@pytest.mark.parametrize(("seed", "factor"), slow_rest([(1, 1.03), (1, 1.0), (2, 1.03), (2, 1.0)]))
def test_a_tag_that_is_printed_too_small_is_named_beside_a_description(seed, factor):
    data, description = tag_before_a_camera(seed, factor)
    found = tree_result(calibrate_tree(data, description=description, effects=()))
    words = [w for w in found.texts(FAILURE) if "times as long as all else says" in w]
    assert len(words) == (factor > 1.0)
    assert not any("times as long" in word for word in found.texts(WARNING))
    for word in words:
        assert float(word.split(" measured is ")[1].split()[0]) == pytest.approx(factor, abs=0.01)


@pytest.mark.parametrize(
    ("count", "what"), [(1, "the tag is, or the board's squares are"), (2, "tags are")]
)
def test_what_is_of_another_size_is_tags_or_a_board(count, what):
    data, _ = tag_before_a_camera(1, 1.0, count)
    said = as_printed(data, "camera", 1.05)
    assert said == f" ({what} 4.8 % smaller than was told: 23.8 mm if that was 25)"


@pytest.mark.slow
def test_what_turns_and_poses_may_be_instead_is_said():
    data = tag_before_a_camera(1, 1.0)[0].select(np.arange(60) < 30)
    R = rotation_from_vector(data.observations.values[:, 3:6])
    places = -np.einsum("rji,rj->ri", R, data.observations.values[:, :3])

    def told(place):
        values = np.hstack([place, -data.observations.values[:, 3:6]])
        other = replace(data, observations=replace(data.observations, values=values))
        return calibrate_tree(other, effects=())

    with pytest.raises(DataError, match=r"hand to the base, .* or invert what 'camera' tells"):
        told(places)
    with pytest.raises(DataError, match="fit them if inverse turns were taken beside places"):
        told(data.observations.values[:, :3])


@pytest.mark.slow
def test_a_wrong_size_is_as_sure_however_far_off_a_description_is_said_to_be():
    data, described = tag_before_a_camera(1, 1.03)
    few, many = (
        calibrate_tree(data, description=replace(described, shift_sigma=said), effects=())
        for said in (0.001, 0.03)
    )
    sure = few.held["camera"].beside_description
    assert many.held["camera"].beside_description == pytest.approx(sure, rel=0.02)
    assert sure > 20.0


@pytest.mark.slow
def test_lengths_that_rest_on_a_stated_size_alone_are_said_to():
    data, _ = tag_before_a_camera(1, 1.03)
    noted = tree_result(calibrate_tree(data, effects=())).texts(NOTE)
    assert any("the size that is stated of what sensor 'camera'" in word for word in noted)
    assert any("nothing else tells them" in word for word in noted)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.02, 1.0])
def test_a_board_with_larger_squares_than_told_contradicts_known_distances(factor):
    sim = two_arms(1, torso=0, poses=30, distances=KNOWN)
    data = with_boards(sim)
    markers = tuple(
        m if m.xyz is None else replace(m, xyz=tuple(factor * x for x in m.xyz))
        for m in data.markers
    )
    found = tree_result(calibrate_tree(replace(data, markers=markers), effects=()))
    named = [w for w in found.texts(FAILURE) if "of sensor 'ruler' contradict" in w]
    assert len(named) == (factor > 1.0)
    alone = any("nothing else tells them" in word for word in found.texts(NOTE))
    assert alone == (factor > 1.0)


@pytest.mark.parametrize(("chi_square", "severity"), [(10.7, ""), (11.0, WARNING)])
def test_a_description_is_contradicted_once_in_a_thousand_sound_ones(chi_square, severity):
    score = HeldScore(1.0, np.zeros(1), np.ones(1), 100, chi_square)
    assert severity_of(score) == severity


@pytest.mark.parametrize(
    ("chi_square", "value", "stated", "severity"),
    [
        (12.0, 0.05, True, WARNING),
        (12.3, 0.05, True, FAILURE),
        (30.0, -0.021, True, FAILURE),
        (30.0, 0.019, True, WARNING),
        (30.0, 0.05, False, WARNING),
    ],
)
def test_a_size_fails_by_a_fiftieth_that_one_in_two_thousand_sound_descriptions_contradicts(
    chi_square, value, stated, severity
):
    score = HeldScore(1.0, np.array([value]), np.full(1, 0.001), 100, chi_square, stated)
    assert severity_of(score) == severity


@pytest.mark.slow
def test_a_joint_that_is_read_wrongly_in_most_poses_fails_by_name():
    sim = one_arm(5, joints=4, markers=3, poses=60, sigma={"points": 3e-4})
    readings = sim.data.readings.copy()
    late = np.arange(len(readings)) % 2 == 0
    readings[late, 2] += np.radians(np.where(np.arange(late.sum()) % 4 < 2, 3.0, -5.0))
    wrong = verdict(replace(sim.data, readings=readings))
    assert wrong.status == "FAIL"
    joint = sim.data.joints[2].name
    assert any(f"{joint!r}" in text or joint in text for text in wrong.reasons)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [6, 7, 8])
def test_right_recordings_are_not_contradicted(seed):
    found = verdict(two_arms(seed, poses=40, distances=KNOWN).data)
    assert found.status == "PASS"
    assert not any("contradict" in text for text in found.warnings)


@pytest.mark.slow
def test_poses_whose_readings_are_of_other_poses_fail_with_their_samples():
    data = one_arm(5, joints=4, markers=3, poses=80, sigma={"points": 3e-4}).data
    assert verdict(data).status == "PASS"
    readings = data.readings.copy()
    readings[8:16] = readings[8:16][::-1]
    wrong = verdict(replace(data, readings=readings))
    assert wrong.status == "FAIL"
    (said,) = (text for text in wrong.reasons if "most of what was seen contradicts" in text)
    assert set(map(int, re.findall(r"\d+", said.split("samples")[1]))) <= {*range(8, 16)}


@pytest.mark.slow
def test_a_known_distance_that_is_wrong_is_named():
    data = two_arms(3, torso=0, poses=30, distances=KNOWN).data
    ruler = np.flatnonzero(data.observations.pose == ANY_POSE)
    values = data.observations.values.copy()
    values[ruler[1], 0] += 8e-3
    wrong = verdict(replace(data, observations=replace(data.observations, values=values)))
    (said,) = (text for text in wrong.warnings if "distances contradict the rest" in text)
    assert "left_tag2 and left_tag3" in said
    assert "left_tag0" not in said


def test_a_distance_of_two_links_that_has_no_sample_is_refused_with_its_markers():
    data = two_arms(3, torso=0, poses=4, distances=KNOWN).data
    markers = [replace(m, on="left5") if m.name == "left_tag1" else m for m in data.markers]
    with pytest.raises(DataError, match="left_tag0 on left6, left_tag1 on left5"):
        replace(data, markers=tuple(markers))


def test_distances_that_are_left_out_are_named_with_what_they_miss():
    data = two_arms(3, torso=0, poses=4, distances=KNOWN).data
    row = int(np.flatnonzero(data.observations.pose == ANY_POSE)[1])
    out = np.arange(len(data.observations)) == row
    left = SimpleNamespace(by_row=lambda: 0.0123 * out)
    solution = SimpleNamespace(outliers=out)
    (said,) = distance_words(SimpleNamespace(data=data, solution=solution, train=left))
    told = f"left_tag2 and left_tag3 (told {1e3 * data.observations.values[row, 0]:.1f} mm"
    assert f"{told}, off by 12.3 mm)" in said
    solution.outliers = ~out
    solution.outliers[data.observations.pose == ANY_POSE] = False
    assert not distance_words(SimpleNamespace(data=data, solution=solution, train=left))


@pytest.mark.parametrize(("poses", "many"), [(3, False), (4, True)])
def test_more_poses_off_than_one_in_two_hundred_explains_are_too_many(poses, many):
    data = one_arm(5, joints=4, markers=3, poses=80).data
    off = np.zeros(len(data.observations), dtype=bool)
    off[data.observations.pose < poses] = (
        data.observations.marker[data.observations.pose < poses] > 0
    )
    one_each = poses_off(data, data.observations.marker == 0)
    assert not one_each.found.any()
    found = poses_off(data, off)
    assert found.count == poses
    assert found.too_many == many
    two = data.observations.marker < 2
    pairs = replace(data, observations=data.observations.select(two))
    assert not poses_off(pairs, np.ones(two.sum(), dtype=bool)).count  # labels may be wrong by two

"""Each threshold of what is said of a body of any tree, from both sides."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.sensors import SensorInfo
from nico_selfmodel.errors import DataError, NotConvergedError
from nico_selfmodel.estimation.bending.bendable import GEAR
from nico_selfmodel.estimation.bending.implausible import (
    COUPLES,
    LIFTS,
    TILTS,
    gear_fault,
    implausible,
)
from nico_selfmodel.estimation.diagnosis.flatness import Flatness, flatness_by
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.model_verdict import judge_body_errors
from nico_selfmodel.estimation.results.calibration_result import CAUSE, WARNING, Errors
from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
from nico_selfmodel.estimation.tree.contradictions.contradiction_words import (
    _stood_still,
    misdescribed_words,
)
from nico_selfmodel.estimation.tree.contradictions.held_scores import HeldScore, severity_of
from nico_selfmodel.estimation.tree.contradictions.ran_away import check_that_it_stayed
from nico_selfmodel.estimation.tree.contradictions.sensor_noise import fitted_away, sensor_misfits
from nico_selfmodel.estimation.tree.contradictions.standing_still import (
    check_that_it_moved,
    dead_encoders,
    still_readings,
)
from nico_selfmodel.estimation.tree.contradictions.told_values import agreeing_start
from nico_selfmodel.estimation.tree.contradictions.wrong_readings import is_off, markers_elsewhere
from nico_selfmodel.estimation.tree.timing import off_at_once
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.estimation.tree.tree_setup import Wishes
from nico_selfmodel.model.arm.bending import BEARING, COUPLING, SAG
from nico_selfmodel.model.tree.body_model import BodyModel

from .simulated_trees import observed, one_arm
from .test_one_problem import flange_dataset, hand_eye_poses

SIGMA = 3e-4


@pytest.fixture(scope="module")
def slider():
    """An arm of which the second joint shifts, its tracker's sigma stated."""
    shifts = np.array([False, True, False, False])
    sim = one_arm(5, joints=4, markers=3, poses=50, sigma={"points": SIGMA}, shifts=shifts)
    data = sim.data
    sensors = tuple(replace(sensor, sigma=SIGMA) for sensor in data.sensors)
    data = replace(data, sensors=sensors)
    return calibrate_tree(data, effects=())


@pytest.fixture(scope="module")
def turning():
    """An arm before a sensor that tells a marker's turns."""
    sim, rng = one_arm(5, joints=3, poses=30), np.random.default_rng(2)
    sigma = {"poses": 4e-4, "points": 4e-4, "turn": 1e-3}
    seen = (*(sim.data.joints, sim.data.markers), (SensorInfo("tracker", "poses"),))
    how = {"sigma": sigma, "joint_sigma": np.radians(0.03)}
    return calibrate_tree(observed(sim.tree, *seen, sim.readings_true, rng, **how), effects=())


def said(calibration, **solution):
    """All that is said of a calibration whose solution is another one."""
    bent = replace(calibration, solution=replace(calibration.solution, **solution))
    verdict = judge(bent)
    return " ".join([*verdict.reasons, *verdict.warnings])


def with_noise(calibration, **noise):
    return said(calibration, noise=replace(calibration.solution.noise, **noise))


@pytest.mark.slow
@pytest.mark.parametrize(("times", "fails"), [(4.9, False), (5.1, True)])
def test_a_sensor_that_measures_five_times_worse_than_stated_fails(slider, times, fails):
    words = with_noise(slider, sensor=np.full(2, times * SIGMA))
    assert ("is off by" in words) is fails


@pytest.mark.parametrize(("times", "fails"), [(4.9, False), (5.1, True)])
def test_touches_missed_by_five_times_what_they_are_taken_for_fail(times, fails):
    rows = SimpleNamespace(kind="contact", sensor=0, first=0, scalars=slice(0, 6))
    held = {"noise_group": np.zeros(6, dtype=int), "sigma_held": np.array([True])}
    white = np.append(np.full(5, times), np.nan)
    noise = SimpleNamespace(sensor=np.array([1e-3]))
    solution = SimpleNamespace(
        variances_known=True, noise=noise, white_by_scalar=lambda seen: white
    )
    told = SimpleNamespace(
        data=SimpleNamespace(sensors=[SensorInfo("bump", "contact")]),
        solution=solution,
        train=SimpleNamespace(observations=SimpleNamespace(sensors=[rows], **held)),
    )
    words = " ".join(sensor_misfits(told))
    assert ("what sensor 'bump' measured is off by 5.1 mm, it is taken to be" in words) is fails
    assert bool(words) is fails


@pytest.mark.parametrize(
    ("part", "usual", "far", "joints", "named"),
    [
        ("rx", np.radians(1.0), np.radians(10.2), 4, True),
        ("rx", np.radians(1.0), np.radians(9.8), 4, False),
        ("rx", np.radians(3.0), np.radians(15.2), 4, True),
        ("rx", np.radians(3.0), np.radians(14.8), 4, False),
        ("y", 0.001, 0.0302, 4, True),
        ("y", 0.001, 0.0298, 4, False),
        ("rx", np.radians(1.0), np.radians(90.0), 3, False),
        ("rz", np.radians(1.0), np.radians(90.0), 4, False),
    ],
)
def test_a_joint_much_farther_from_its_description_than_others_is_named(
    part, usual, far, joints, named
):
    names = [f"j{i}" for i in range(joints)]
    parts = [f"{name}.{p}" for name in names for p in ("rx", "ry", "rz", "x", "y", "z")]
    values = np.array([usual * (p.partition(".")[2] == part) for p in parts])
    values[parts.index(f"j2.{part}")] = far
    index = {name: i for i, name in enumerate(parts)}
    told = SimpleNamespace(tree=SimpleNamespace(joints=names), values=values, description=1)
    told.parameters = SimpleNamespace(index=index)
    words = misdescribed_words(told)
    assert bool(words) is named
    assert not named or ("'j2' by" in words[0] and "'j1'" not in words[0])
    told.description = None
    assert not misdescribed_words(told)


@pytest.mark.parametrize(("times", "asked"), [(9.8, False), (10.2, True)])
def test_a_sensor_that_measures_ten_times_better_than_stated_is_doubted(slider, times, asked):
    words = with_noise(slider, sensor=np.full(2, SIGMA / times))
    assert ("is the unit of its sigma right?" in words) is asked


@pytest.mark.parametrize(("left", "told"), [(3.9, False), (4.1, True)])
def test_what_fitting_took_is_no_scatter_and_four_numbers_must_be_left_over(left, told):
    # Six numbers, of which three parameters take 3 / (1 + w^2), held by three rows w of others.
    w = np.sqrt(3.0 / (6.0 - left) - 1.0)
    whitened = np.vstack([w * np.eye(3), np.eye(6, 3), np.zeros((2, 3))])
    counts = np.ones(11, dtype=bool)
    found = fitted_away(whitened, counts, slice(3, 9))
    assert found == (pytest.approx(np.sqrt(6.0 / left)) if told else np.inf)


@pytest.mark.parametrize(("share", "fails"), [(0.049, False), (0.051, True)])
def test_noise_of_a_twentieth_of_what_a_sensor_saw_explains_nothing(slider, share, fails):
    measured = slider.train.observations.sensors[0].measured
    noise = share * np.sqrt(np.var(measured[:, :3], axis=0).sum())
    words = with_noise(slider, sensor=np.full(2, noise))
    assert ("the body does not explain it" in words) is fails


@pytest.mark.parametrize(("share", "blamed"), [(0.49, False), (0.51, True)])
def test_a_length_is_to_blame_where_it_explains_half_of_what_nothing_does(slider, share, blamed):
    measured = slider.train.observations.sensors[0].measured
    noise = 0.06 * np.sqrt(np.var(measured[:, :3], axis=0).sum())
    solution = slider.solution
    solution = replace(solution, noise=replace(solution.noise, sensor=np.full(2, noise)))
    bent = replace(slider, solution=solution)
    score = HeldScore(share * measured.size, np.array([0.2]), np.array([0.01]), measured.size)
    bent.__dict__["held"] = {"tracker": score}
    assert ("times as long as all else says" in " ".join(judge(bent).reasons)) is blamed


@pytest.mark.slow
@pytest.mark.parametrize(("degrees", "fails"), [(14.8, False), (15.2, True)])
def test_turns_that_are_off_by_fifteen_degrees_are_no_noise(turning, degrees, fails):
    sensor = np.repeat([4e-4, np.radians(degrees)], 2)
    words = with_noise(turning, sensor=sensor)
    assert ("the body does not explain it" in words) is fails


@pytest.mark.parametrize(
    ("step", "sigma", "gain", "named"),
    [
        (-0.05, 1e-3, 100.0, True),
        (-0.0105, 1e-3, 100.0, True),
        (-0.0095, 1e-3, 100.0, False),
        (0.05, 0.0098, 100.0, True),
        (0.05, 0.0102, 100.0, False),
        (0.05, 1e-3, 81.0, True),
        (0.05, 1e-3, 79.0, False),
    ],
)
def test_a_gear_is_off_by_a_percent_and_five_sigmas_and_explains_most(step, sigma, gain, named):
    """Of 100 that it and waves in the joint's angle explain."""
    assert is_off(step, sigma, gain, 100.0) is named


@pytest.mark.parametrize(("times", "named"), [(1.95, False), (2.05, True)])
def test_a_joint_twice_as_loud_as_others_is_named(slider, times, named):
    joint = np.full(4, 1e-3)
    joint[2] *= times
    words = with_noise(slider, joint=joint, loud=frozenset({2}))
    assert ("times as badly as others" in words) is named


@pytest.mark.parametrize(("share", "fails"), [(0.098, False), (0.102, True)])
def test_noise_of_a_tenth_of_what_a_joint_slid_is_none(slider, share, fails):
    joint = slider.solution.noise.joint.copy()
    joint[1] = share * np.ptp(slider.data.si_readings[:, 1])
    assert ("noise of joint 'j2' would have to be" in with_noise(slider, joint=joint)) is fails


@pytest.mark.parametrize(
    ("own", "of", "others", "named"),
    [
        (10, 40, 0, False),
        (11, 40, 0, True),
        (2, 3, 14, False),
        (3, 3, 3, True),
        (3, 3, 9, False),
        (2, 2, 0, False),
        (3, 3, 0, True),
    ],
)
def test_a_marker_is_at_two_places_by_a_quarter_of_its_sights_and_more_than_chance(
    own, of, others, named
):
    data = one_arm(1, poses=40, markers=3).data
    first = data.observations.marker == 0
    data = data.of_rows(np.append(np.flatnonzero(first)[:of], np.flatnonzero(~first)))
    outliers = np.zeros(len(data.observations), dtype=bool)
    outliers[:own] = True
    outliers[of + np.linspace(0, 79, others).astype(int)] = True
    found = markers_elsewhere(SimpleNamespace(data=data), outliers)
    assert found == ({data.markers[0].name: (own, of)} if named else {})


@pytest.mark.parametrize(("count", "named"), [(1, False), (2, True)])
def test_two_outliers_of_a_marker_name_it(slider, count, named):
    table = slider.data.observations
    outliers = np.zeros(len(table), dtype=bool)
    outliers[np.flatnonzero(table.marker == 1)[:count]] = True
    assert ("hand_tag1 (" in said(slider, outliers=outliers)) is named


@pytest.mark.parametrize(
    ("ratio", "poses", "named"),
    [(3.9, 50, False), (4.1, 50, True), (9.0, 19, False), (9.0, 20, True)],
)
def test_a_sensor_off_at_once_is_named_by_four_in_twenty_poses(
    slider, monkeypatch, ratio, poses, named
):
    monkeypatch.setattr(off_at_once, "at_once", lambda left, pose: (1.0, ratio, 3.0, poses))
    assert bool(off_at_once.sensors_off_at_once(slider)) is named


@pytest.mark.parametrize(
    ("joint", "travel", "still"),
    [(0, 0.9e-3, True), (0, 1.1e-3, False), (1, 0.9e-5, True), (1, 1.1e-5, False)],
)
def test_a_joint_that_hardly_moved_stands_still(slider, joint, travel, still):
    data = slider.data
    readings = data.readings.copy()
    per_unit = data.joints[joint].si_per_unit
    readings[:, joint] = np.linspace(0.0, travel, len(readings)) / per_unit
    found = still_readings(replace(data, readings=readings))
    assert (data.joints[joint].name in found) is still


@pytest.mark.parametrize(("share", "dead"), [(0.009, True), (0.011, False)])
def test_readings_that_change_far_less_than_others_hardly_change(share, dead):
    data = one_arm(1, joints=3, poses=30).data
    readings = np.tile(np.linspace(0.0, 1.0, 30)[:, None], 3) * [1.0, share, 1.0]
    words = dead_encoders(replace(data, readings=readings), data.joint_names)
    assert words.startswith("readings of j2 hardly change") is dead
    assert not dead_encoders(replace(data, readings=readings), ["j1"])


def first_poses(data: BodyDataset, count: int) -> BodyDataset:
    """A few poses, in which the tracker told one value of the first marker."""
    data = data.select(np.arange(len(data.sample)) < count)
    table = data.observations
    values = table.values.copy()
    values[table.marker == 0] = values[table.marker == 0][0]
    return replace(data, observations=replace(table, values=values))


def test_a_value_that_is_the_same_in_three_poses_is_no_accident(slider):
    check_that_it_moved(first_poses(slider.data, 2), np.ones(4, dtype=bool), described=True)
    with pytest.raises(DataError, match="the same to the last digit in all 3 poses"):
        check_that_it_moved(first_poses(slider.data, 3), np.ones(4, dtype=bool), described=True)


@pytest.mark.parametrize("largest", [0.0, 0.5])
@pytest.mark.parametrize(("times", "stays"), [(99.0, True), (101.0, False)])
def test_no_body_is_a_hundred_of_its_lengths_away(slider, largest, times, stays):
    parameters = TreeParameters(slider.tree)
    metres = np.array(parameters.layout.units) == "m"
    start = np.where(metres, 0.0, 0.1)
    start[np.flatnonzero(metres)[0]] = largest
    values = start.copy()
    values[np.flatnonzero(metres)[1]] = times * (largest or 0.1)  # of nothing known, a decimetre
    if stays:
        check_that_it_stayed(parameters, start, values)
    else:
        with pytest.raises(NotConvergedError, match="the adjustment ran away"):
            check_that_it_stayed(parameters, start, values)


@pytest.mark.parametrize(
    ("gain", "described", "severity"),
    [
        (23.5, 0.0, ""),
        (24.5, 0.0, WARNING),
        (99.0, 0.0, WARNING),
        (101.0, 0.0, CAUSE),
        (15.0, 10.3, ""),
        (15.0, 11.4, WARNING),
    ],
)
def test_what_is_held_is_contradicted_by_what_chance_hardly_does(gain, described, severity):
    """Once in a million, beside a description once in a thousand; by a tenth of the squares."""
    score = HeldScore(gain, np.ones(1), np.ones(1), 1000, described)
    assert severity_of(score) == severity


@pytest.mark.parametrize(
    ("value", "sigma", "said"),
    [(4.9e-3, 1e-3, False), (5.1e-3, 1e-3, True), (0.5, 0.099, True), (0.5, 0.101, False)],
)
def test_a_length_is_worth_a_word_from_half_a_per_cent_on(slider, value, sigma, said):
    still = replace(slider, solution=replace(slider.solution))
    vars(still)["held"] = {"tracker": HeldScore(1e6, np.array([value]), np.array([sigma]), 450)}
    assert ("times as long as all else says" in " ".join(judge(still).reasons)) is said


@pytest.mark.parametrize(
    ("scalars", "cost", "kept"),
    [(100, 29, True), (100, 31, False), (1000, 99, True), (1000, 101, False)],
)
def test_a_told_value_is_refused_by_a_cost_of_thirty_or_a_tenth_of_what_was_measured(
    scalars, cost, kept
):
    def begin(label, body, wishes):
        parameters = SimpleNamespace(names=("j1.x",), units=("m",), tree_of=lambda values: None)
        return SimpleNamespace(
            label=label,
            cost=float(cost if wishes.pins.pinned else 0.0),
            parameters=parameters,
            values=np.array([0.2]),
        )

    wishes = Wishes(FixedParameters.from_text(("j1.x=0.1",), ()))
    start = begin("robot", None, wishes)
    if kept:
        assert agreeing_start(start, None, wishes, scalars, begin) is start
    else:
        with pytest.raises(DataError, match=r"j1\.x is fixed at 0\.1 m, the data ask for 0\.2"):
            agreeing_start(start, None, wishes, scalars, begin)


@pytest.mark.parametrize(
    ("count", "poses", "status"),
    [(240, 1000, "PASS"), (260, 1000, "FAIL"), (6, 20, "PASS"), (7, 20, "FAIL")],
)
def test_poses_that_are_far_off_too_often_fail(slider, count, poses, status):
    """More than a quarter, and significantly more than the tenth that was so far off in training.

    The medians are alike.
    """
    told = {"n": 1000, "median": 1.0, "relative": 1.0, "relative_p90": 2.0}
    body = BodyModel("arm", slider.tree, np.ones(4), expected={"mm": told})
    relative = np.where(np.arange(poses) < count, 3.0, np.where(np.arange(poses) % 2, 0.9, 1.1))
    errors = Errors(compared=relative, compared_by="mm", relative_to=1e-3)
    assert judge_body_errors(body, errors).status == status


@pytest.mark.parametrize(("by_chance", "flat"), [(1.2e-3, True), (0.8e-3, False)])
def test_a_flat_mirror_is_called_bent_once_in_a_thousand(by_chance, flat):
    assert Flatness(20.0, 9, 30, by_chance).flat is flat


@pytest.mark.parametrize(("redundancy", "tested"), [(7, False), (8, True)])
def test_flatness_is_tested_by_eight_pixels_more_than_parameters(redundancy, tested):
    rng = np.random.default_rng(0)
    white, plane, cameras = rng.normal(size=30), rng.normal(size=(30, 3)), rng.normal(size=(30, 12))
    found = flatness_by(white, plane, cameras, 9, redundancy)
    assert (found is not None) is tested


@pytest.mark.parametrize(
    ("gear", "fault"), [(0.9895, True), (0.991, False), (1.009, False), (1.0105, True)]
)
def test_a_gear_that_is_told_and_a_hundredth_off_is_no_bend(gear, fault):
    fit = SimpleNamespace(
        parameters=SimpleNamespace(names=("j1.gear",)),
        values=np.array([gear]),
        groups={GEAR: ("j1.gear",)},
        sigma_of=lambda weights: 1e-3,
    )
    assert (gear_fault(fit) is not None) is fault


def bent(effect, number):
    """A fit of one effect of one joint, and the body it was fitted to."""
    bending = SimpleNamespace(
        effects=(effect,),
        coupling=np.array([number]),
        sag=np.array([number]),
        bearing_sag=np.zeros(1),
        names_of=lambda of: (f"j1.{of}",),
        with_effects=lambda *effects: None,
    )
    whole = SimpleNamespace(gears=np.ones(1), bending=bending)
    whole.with_bending = lambda bending: whole
    parameters = SimpleNamespace(names=(), with_values=lambda values: whole)
    fit = SimpleNamespace(
        parameters=parameters,
        values=np.zeros(0),
        groups={effect: (f"j1.{effect}",)},
        sigma_of=lambda weights: 1.0,
    )
    # A moment of 1 N m about the joint's own axis, in one pose.
    body = SimpleNamespace(
        moments=lambda bent: np.array([[[0.0, 0.0, 1.0]]]), turns=lambda bent: np.zeros((1, 1))
    )
    return fit, body


@pytest.mark.parametrize(
    ("effect", "number", "why"),
    [(COUPLING, 0.099, ""), (COUPLING, 0.101, COUPLES), (SAG, -1.9, ""), (SAG, -2.1, LIFTS)],
)
def test_what_couples_by_a_tenth_or_lifts_by_two_sigmas_is_no_bend(effect, number, why):
    assert implausible(*bent(effect, number)) == why


@pytest.mark.parametrize(("degrees", "why"), [(2.9, ""), (3.1, TILTS)])
def test_a_bearing_that_tilts_by_three_degrees_is_no_bend(degrees, why):
    fit, body = bent(SAG, 0.0)
    bending = fit.parameters.with_values(None).bending
    bending.effects, bending.bearing_sag = (BEARING,), np.array([np.radians(degrees)])
    # Moments about x that differ from their mean by 1 N m.
    body.moments = lambda bent: np.array([[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]])
    assert implausible(fit, body) == why


@pytest.fixture(scope="module")
def flange():
    _, _, F, M = hand_eye_poses(np.random.default_rng(4), 25)
    return calibrate_tree(flange_dataset(F, M), effects=())


@pytest.mark.parametrize(("place", "fails"), [(0.049, False), (0.051, True)])
def test_a_flange_that_is_five_centimetres_off_contradicts(flange, place, fails):
    joint = np.where(np.arange(6) < 3, 1e-3, place)
    assert (
        "poses of flange 'tcp' would have to be off" in with_noise(flange, joint=joint)
    ) is fails


@pytest.mark.parametrize(("row", "others", "said"), [(7, 1, False), (8, 1, True), (8, 8, False)])
def test_an_encoder_stands_in_between_from_eight_samples_in_a_row_where_no_other_does(
    row, others, said
):
    data = one_arm(3, joints=3, poses=30).data
    readings = data.readings.copy()
    readings[5 : 5 + row, 1] = readings[5, 1]
    readings[15 : 15 + others, 2] = readings[15, 2]
    words = dead_encoders(replace(data, readings=readings), data.joint_names)
    assert words.startswith("the encoder of 'j2' stands at ") is said
    assert not said or f"from sample 5 to {4 + row} while others move" in words
    assert not dead_encoders(replace(data, readings=readings), ["j1"])


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (12, "12 of 30 samples (0 to 11) contradict the rest, in 12 of which the encoder of j2 "),
        (30, "no body explains any of 30 samples, in 30 of which the encoder of j2 stands at "),
    ],
)
def test_an_encoder_that_stands_is_named_with_how_much_it_spoils(wrong, words):
    data = one_arm(3, joints=3, poses=30).data
    readings = data.readings.copy()
    readings[:wrong, 1] = readings[0, 1]
    readings[1:wrong:4, 2] = readings[1, 2]  # not alone in a row
    data = replace(data, readings=readings)
    outliers = data.observations.pose < wrong
    solution = SimpleNamespace(slipped=np.zeros((30, 1), bool), outliers=outliers)
    calibration = SimpleNamespace(data=data, solution=solution)
    (found,) = _stood_still(calibration, [])
    assert found.text.startswith(words)

"""What cannot tell a body, or contradicts what the user said of it, is refused with its cause."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_dataset import ObservationTable
from nico_selfmodel.dataset.body.sensors import SensorInfo
from nico_selfmodel.errors import ContradictedError, DataError, NotConvergedError
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.monitoring.body_health import check_body_health
from nico_selfmodel.estimation.monitoring.body_relearning import rezero_body
from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
from nico_selfmodel.estimation.tree.contradictions.against_the_rest import (
    errors_by_link,
    largest_error,
)
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_findings import tree_findings
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.estimation.tree.tree_result import body_model
from nico_selfmodel.estimation.tree.tree_setup import Description, Wishes

from .simulated_trees import one_arm


@pytest.fixture(scope="module")
def arm():
    return one_arm(3, joints=4, markers=2, poses=40).data


@pytest.fixture(scope="module")
def learned(arm):
    """What the data alone say."""
    return calibrate_tree(arm, effects=())


@pytest.fixture(scope="module")
def places(learned):
    """Where tags are said to be by the data alone."""
    return dict(zip(learned.parameters.names, learned.values.tolist(), strict=True))


@pytest.fixture(scope="module")
def place(places):
    return places["hand_tag0.x"]


def refusal(data, **told):
    with pytest.raises(DataError) as raised:
        calibrate_tree(data, effects=(), **told)
    return str(raised.value)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["fix", "prior"])
def test_a_told_value_that_contradicts_the_data_is_named_with_what_they_ask_for(arm, places, kind):
    place = places["hand_tag0.x"]
    pins = FixedParameters({"hand_tag0.x": place + 0.3, "hand_tag1.x": places["hand_tag1.x"]})
    wishes = Wishes(pins)
    if kind == "prior":
        wishes = Wishes(FixedParameters({}), {"hand_tag0.x": (place + 0.3, 1e-4)})
    said = refusal(arm, wishes=wishes)
    assert f"leave out --{kind} hand_tag0.x" in said
    assert "hand_tag1" not in said
    wanted = float(said.split("the data ask for ")[1].split(":")[0])
    assert wanted == pytest.approx(place, abs=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("off", [2e-4, 0.0])
def test_a_told_value_that_agrees_is_kept(arm, place, off):
    wishes = Wishes(FixedParameters({"hand_tag0.x": place + off}))
    found = calibrate_tree(arm, wishes=wishes, effects=())
    assert found.values[found.parameters.index["hand_tag0.x"]] == place + off


@pytest.mark.slow
def test_of_several_told_values_only_the_wrong_one_is_named():
    data = one_arm(4, joints=4, markers=3, poses=40, sensor="camera").data
    right = calibrate_tree(data, effects=())
    at = {n: float(right.values[right.parameters.index[n]]) for n in ("right.rx", "right.x")}
    pins = {"right.rx": at["right.rx"] + 0.2, "right.x": at["right.x"]}
    said = refusal(data, wishes=Wishes(FixedParameters(pins)))
    assert "leave out --fix right.rx" in said
    assert "right.x is" not in said


def test_a_joint_that_stood_still_is_named(arm):
    readings = arm.readings.copy()
    readings[:, 1] = 0.3
    assert refusal(replace(arm, readings=readings)).startswith("j2 stood still in all 40 samples")


def test_a_joint_that_shifts_and_stood_still_is_named():
    data = one_arm(3, joints=4, shifts=np.arange(4) == 2, poses=30).data
    readings = data.readings.copy()
    readings[:, 2] = 0.05
    assert refusal(replace(data, readings=readings)).startswith("j3 stood still in all 30 samples")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "joint", "words"),
    [(2, 3, "readings of joint 'j4' would be wrong in"), (3, 1, "joint noise would have to be ")],
)
def test_an_encoder_that_stands_still_while_its_joint_moves_is_the_cause(seed, joint, words):
    sim = one_arm(seed, joints=4, markers=2, poses=40, joint_sigma=np.radians(0.1))
    readings = sim.data.readings.copy()
    readings[:, joint] = 0.2
    data, described = replace(sim.data, readings=readings), Description(sim.tree)
    said = judge(calibrate_tree(data, description=described, effects=())).reasons
    cause = f"readings of j{joint + 1} never change: if it moved, its encoder stands still"
    assert any(one.startswith(words) and one.endswith(cause) for one in said), said


def test_markers_that_no_joint_moves_are_refused(arm):
    markers = tuple(replace(marker, on="world") for marker in arm.markers)
    assert "say by 'on' which link" in refusal(replace(arm, markers=markers))


def test_a_sensor_that_hangs_is_named(arm):
    table = arm.observations
    values = table.values.copy()
    values[table.marker == 1] = values[np.flatnonzero(table.marker == 1)[0]]
    said = refusal(replace(arm, observations=replace(table, values=values)))
    assert "what 'tracker' measured of 'hand_tag1' is the same to the last digit" in said


def test_errors_of_a_limb_whose_readings_are_wrong_are_the_largest():
    sim = one_arm(5, joints=3, markers=2, poses=20)
    parameters = TreeParameters(sim.tree)
    markers = tuple(replace(m, on=on) for m, on in zip(sim.data.markers, ("j2", "j3"), strict=True))
    values, table = sim.data.observations.values.copy(), sim.data.observations
    start = SimpleNamespace(parameters=parameters, values=parameters.start)
    data = replace(sim.data, markers=markers)
    values[table.marker == 0] += np.random.default_rng(0).normal(size=(20, 6))
    wrong = replace(data, observations=replace(table, values=values))
    before, after = (errors_by_link(SimpleNamespace(start=start), one) for one in (data, wrong))
    assert max(after, key=after.get) == 1
    assert after[1] > 10.0 * before[1]
    assert largest_error(SimpleNamespace(start=start), wrong) == after[1]


@pytest.mark.slow
def test_noise_with_which_a_body_runs_away_is_the_cause():
    data = one_arm(402, joints=4, markers=2, poses=40, sensor="camera").data
    shuffled = np.random.default_rng(409).permuted(data.readings, axis=0)
    with pytest.raises(
        NotConvergedError, match=r"ran away.*joint noise would have to be 65\.\d deg"
    ):
        calibrate_tree(replace(data, readings=shuffled), effects=())


@pytest.mark.slow
def test_a_recording_in_which_nothing_agrees_with_the_body_is_refused(arm):
    body = body_model(calibrate_tree(arm, effects=()))
    few = arm.select(np.arange(40) < 20)
    table, rng = few.observations, np.random.default_rng(0)
    values = table.values.copy()
    values[:, :3] = rng.uniform(0.0, 1.0, size=(len(values), 3))
    with pytest.raises(ContradictedError, match="all 40 observations of data set 'simulated'"):
        rezero_body(body, replace(few, observations=replace(table, values=values)))


@pytest.mark.slow
def test_a_recording_of_touches_alone_is_not_watched_and_says_so(arm):
    body = body_model(calibrate_tree(arm, effects=()))
    count = len(arm.sample)
    measured = np.hstack([np.full((count, 1), 0.1), np.full((count, 5), np.nan)])
    first, second = np.zeros(count, dtype=int), np.ones(count, dtype=int)
    touches = ObservationTable(np.arange(count), first, first, second, measured)
    ruler = (SensorInfo("ruler", "distance", sigma=1e-4),)
    with pytest.raises(DataError, match="nothing that a camera or tracker saw"):
        check_body_health(body, replace(arm, sensors=ruler, observations=touches))


@pytest.mark.parametrize(
    ("times", "doubted"), [(12.0, True), pytest.param(8.0, False, marks=pytest.mark.slow)]
)
def test_a_sensor_that_measures_far_better_than_it_is_said_to_is_doubted(
    arm, learned, times, doubted
):
    sigma = times * float(learned.solution.noise.sensor[0])
    told = tuple(replace(sensor, sigma=sigma) for sensor in arm.sensors)
    words = tree_findings(calibrate_tree(replace(arm, sensors=told), effects=()))
    assert any("is the unit of its sigma right?" in word.text for word in words) == doubted

"""Steps that are planned for joints, recorded through their bus, and what is learned from them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nico_selfmodel.errors import BusError
from nico_selfmodel.estimation.response.servo_calibration import calibrate_servos
from nico_selfmodel.planning.step_plan import SMALLEST, planned_steps
from nico_selfmodel.recording.step_recording import record_steps
from nico_selfmodel.servos.pic_servo.protocol.trajectory import TICK

from ..slow_rest import slow_rest
from .arms import JOINTS, MAKES, virtual_arm


@given(st.floats(-1.0, 1.0), st.floats(0.01, 3.0), st.integers(4, 30), st.integers(0, 99))
def test_steps_stay_within_the_limits_and_end_where_they_began(start, largest, count, seed):
    goals = planned_steps(start, -1.0, 1.0, largest, count, np.random.default_rng(seed))
    assert len(goals) == count + 1
    assert goals[-1] == start
    assert np.abs(goals).max() <= 1.0 + 1e-12
    assert np.abs(np.diff([start, *goals[:-1]])).max() <= largest * (1.0 + 1e-9)


def test_steps_are_short_and_long_where_there_is_room():
    goals = planned_steps(0.0, -1.0, 1.0, 0.5, 12, np.random.default_rng(0))
    ways = np.sort(np.abs(np.diff([0.0, *goals[:-1]])))
    assert ways == pytest.approx(np.geomspace(SMALLEST * 0.5, 0.5, 12))


def test_a_joint_beyond_its_limits_or_without_room_is_refused():
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="beyond its limits"):
        planned_steps(2.0, -1.0, 1.0, 0.5, 4, rng)
    with pytest.raises(ValueError, match="no room"):
        planned_steps(1.0, 1.0, 1.0, 0.5, 4, rng)


@pytest.mark.parametrize("make", slow_rest(MAKES))
def test_speeds_of_the_configuration_are_found_again_by_steps(make):
    made = virtual_arm(make=make)
    made.arm.connect()
    made.arm.enable()
    chosen, rng = JOINTS[2:4], np.random.default_rng(1)
    plan = {name: planned_steps(0.0, -1.0, 1.0, 0.5, 10, rng) for name in chosen}
    found = record_steps(made.arm, plan, rest=0.4, name="steps")
    assert (np.diff(found.time) > 0.0).all()
    assert np.ptp(found.encoders[:, 0][np.isfinite(found.encoders[:, 0])]) == 0.0
    learned = calibrate_servos(found).model
    assert [one.joint for one in learned.joints] == list(chosen)
    for one in learned.joints:
        assert one.speed == pytest.approx(math.radians(60), rel=0.03)
        assert one.acceleration == pytest.approx(math.radians(240), rel=0.15)
        assert 0.0 < one.delay < 0.2


@pytest.mark.parametrize("baud", [19200, 115200])
def test_the_delay_of_a_joint_is_not_that_of_telling_the_others_to_stay(baud):
    delays = []
    for enabled in (["right_elbow"], JOINTS):
        made = virtual_arm(baud=baud)
        made.arm.connect()
        made.arm.enable(enabled)
        goals = planned_steps(0.0, -1.0, 1.0, 0.5, 10, np.random.default_rng(1))
        found = record_steps(made.arm, {"right_elbow": goals}, rest=0.4, name="steps")
        delays.append(calibrate_servos(found).model.of("right_elbow").delay)
    # The packet that starts it, the reply that is read, and two ticks of the board.
    assert delays[0] == pytest.approx(delays[1], abs=2e-3)
    assert 0.0 < min(delays) < max(delays) < 20 * 10 / baud + 2 * TICK


def test_a_joint_that_never_arrives_ends_the_recording_and_the_arm_stands(monkeypatch):
    made = virtual_arm()
    made.arm.connect()
    made.arm.enable()
    monkeypatch.setattr("nico_selfmodel.recording.step_recording._PATIENCE", -9.0)
    with pytest.raises(BusError, match="right_elbow did not arrive"):
        record_steps(made.arm, {"right_elbow": [0.4]}, rest=0.2, name="steps")
    made.seconds_to_rest()
    assert not made.arm.cycle().moving.any()

"""Servos in a diagram that follow commands as it was learned."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.response.servo_response import ServoResponses
from nico_selfmodel.systems import RespondingServos

from ..simulated_steps import SERVOS

N = len(SERVOS)
MAP = ServoMap(
    tuple(servo.joint for servo in SERVOS),
    np.zeros(N),
    np.ones(N),
    ("rad", "deg", "counts", "rad"),
    np.array([np.nan, np.nan, 4096.0, np.nan]),
    np.array([1.0, -1.0, 1.0, -1.0]),
)


def _followed(times, commands, until, period=0.002):
    """Return when, and what encoders read, where commands jump at times [s]. (T,), (T, n)."""
    builder = DiagramBuilder()
    servos = builder.AddSystem(
        RespondingServos(ServoResponses("arm", SERVOS), MAP, commands[0], period=period)
    )
    held = PiecewisePolynomial.ZeroOrderHold(
        [*times, until + 1.0], np.array([*commands, commands[-1]]).T
    )
    source = builder.AddSystem(TrajectorySource(held))
    builder.Connect(source.get_output_port(), servos.get_input_port())
    log = LogVectorOutput(servos.get_output_port(), builder, 0.01)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(until)
    found = log.FindLog(simulator.get_context())
    return found.sample_times(), found.data().T


@pytest.mark.parametrize("way", [0.05, -0.6])
def test_a_step_is_followed_as_the_response_says(way):
    start = MAP.to_encoder(np.full(N, 0.1))
    time, read = _followed([0.0, 0.1], [start, MAP.to_encoder(np.full(N, 0.1 + way))], 1.6)
    for k, servo in enumerate(SERVOS):
        gone = MAP.to_radians(read)[:, k] - MAP.to_radians(start)[k]
        expected = servo.after(way, time - 0.1)
        fastest = np.abs(np.gradient(expected, time)).max()
        assert gone == pytest.approx(expected, abs=1.5 * 0.002 * fastest), servo.joint


def test_a_joint_that_is_called_back_on_its_way_turns_round_and_rests_there():
    start, there = np.zeros(N), MAP.to_encoder(np.full(N, 0.6))
    _, back = _followed([0.0, 0.1, 0.4], [start, there, start], 4.0)
    angles = MAP.to_radians(back)
    farthest = np.abs(angles).max(axis=0)
    assert farthest.min() > 0.05
    assert farthest.max() < 0.6
    assert angles[-1] == pytest.approx(0.0, abs=1e-4)


def test_commands_that_are_not_known_leave_joints_where_they_go():
    there = MAP.to_encoder(np.full(N, 0.2))
    unknown = np.full(N, np.nan)
    # A hold cannot carry nan from the start, so that it comes after the command.
    _, read = _followed([0.0, 0.1, 0.2], [np.zeros(N), there, unknown], 3.0)
    assert MAP.to_radians(read[-1]) == pytest.approx(0.2, abs=1e-4)


def test_joints_without_a_response_and_impossible_periods_are_refused():
    with pytest.raises(ValueError, match="wrist"):
        RespondingServos(ServoResponses("arm", SERVOS[:2]), MAP, np.zeros(N))
    with pytest.raises(ValueError, match="period"):
        RespondingServos(ServoResponses("arm", SERVOS), MAP, np.zeros(N), period=0.0)
    with pytest.raises(ValueError, match="shape"):
        RespondingServos(ServoResponses("arm", SERVOS), MAP, np.zeros(2))

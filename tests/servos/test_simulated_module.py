"""What the simulated board does that the driver does not use."""

import pytest

from nico_selfmodel.servos.pic_servo.protocol.gains import Gains
from nico_selfmodel.servos.pic_servo.protocol.trajectory import LoadTrajectory, TrajectoryFlag


def switch_on(servo):
    servo.set_gains(Gains())
    servo.arm_amplifier()
    servo.hold()


def test_a_relative_goal_counts_from_the_last(module):
    board, servo, port = module
    switch_on(servo)
    flags = TrajectoryFlag.SERVO | TrajectoryFlag.START_NOW
    servo.ask(LoadTrajectory(flags, 1000, 10**6, 10**4))
    port.sleep(1.0)
    servo.ask(LoadTrajectory(flags | TrajectoryFlag.REVERSE, 500))
    port.sleep(1.0)
    assert board.position == 1500


def test_the_register_wraps_at_32_bits(module):
    board, servo, _ = module
    servo.set_position(2**31 - 1)
    board.shaft += 1
    assert servo.poll().position == -(2**31)


@pytest.mark.parametrize("way", [1, -1])
def test_a_stop_in_the_mechanics_holds_the_shaft(module, way):
    board, servo, port = module
    board.mechanics.lower_stop, board.mechanics.upper_stop = -500.0, 500.0
    switch_on(servo)
    back = TrajectoryFlag.REVERSE if way < 0 else 0
    servo.ask(LoadTrajectory(TrajectoryFlag.START_NOW | back, pwm=200))
    port.sleep(0.5)
    assert servo.poll().position == 500 * way

"""What the simulated board does that the driver does not use."""

import pytest

from nico_selfmodel.servos.commands import PathPoints
from nico_selfmodel.servos.gains import Gains
from nico_selfmodel.servos.status import AuxiliaryFlag, StatusItem
from nico_selfmodel.servos.trajectory import LoadTrajectory, TrajectoryFlag


def switch_on(servo):
    servo.set_gains(Gains())
    servo.arm_amplifier()
    servo.hold()


def test_a_path_is_followed_point_by_point(module):
    _board, servo, port = module
    switch_on(servo)
    # Counts of a point times four, with the bits "backwards" and "slow".
    servo.ask(PathPoints((400 | 2, 800 | 2, 200 | 3)))
    assert servo.read(StatusItem.PATH_POINTS).path_points == 3
    assert servo.ask(PathPoints()).auxiliary & AuxiliaryFlag.PATH_MODE
    port.sleep(0.2)
    status = servo.poll()
    assert status.position == 250
    assert not status.auxiliary & AuxiliaryFlag.PATH_MODE


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

"""Boards that an earlier program left behind: set up anew, stopped whatever drives them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.servos import ArmController
from nico_selfmodel.servos.arm.shutdown import still_moving
from nico_selfmodel.servos.pic_servo.joint_bus import PicServoJointBus
from nico_selfmodel.servos.pic_servo.protocol.gains import Gains

from ..slow_rest import slow_rest
from .arms import COUNTS_PER_TURN, MAKES, configuration, drive, virtual_arm

ELBOW = 3
COUNTS_PER_RADIAN = COUNTS_PER_TURN / (2 * math.pi)


def next_program(made, gains=None, **options):
    """Return an arm of the same boards, as the program finds it that comes next."""
    again = virtual_arm(made.modules, **options)
    again.port.time = made.port.time
    if gains is not None:
        config = again.arm.config
        joints = tuple(replace(joint, gains=gains) for joint in config.joints)
        config = replace(config, joints=joints)
        again.arm = ArmController(PicServoJointBus(again.bus, config), config, trust_zero=True)
    return again


@pytest.mark.parametrize(("before", "after"), [(1, 5), (5, 1), (1, 1)])
def test_boards_that_hold_get_the_gains_of_the_configuration(before, after):
    made = next_program(virtual_arm(), Gains(rate_divisor=before))
    made.arm.connect()
    made.arm.enable()
    gains = Gains(kp=555, error_limit=3000, rate_divisor=after)
    again = next_program(made, gains)
    again.arm.connect()
    assert all(module.servo_on for module in again.modules)
    assert [module.gains for module in again.modules] == [gains] * 6
    again.arm.move({"right_elbow": 1.2})
    times, places = [], []
    while again.arm.moving:
        again.arm.heartbeat()
        again.arm.cycle()
        times.append(again.port.time)
        places.append(again.shafts()[ELBOW])
    speeds = np.abs(np.diff(places) / np.diff(times)) / COUNTS_PER_RADIAN
    assert np.median(speeds) == pytest.approx(math.radians(60), rel=0.05)
    assert speeds.max() < 1.2 * math.radians(60)


def test_boards_that_hold_get_the_output_of_the_configuration(virtual):
    virtual.modules[ELBOW].output = 0
    next_program(virtual).arm.connect()
    assert virtual.modules[ELBOW].output == virtual.arm.config.joints[ELBOW].output_mode


@pytest.mark.parametrize("divisor", [1, 5])
def test_a_board_is_stopped_whatever_acceleration_and_divisor_an_earlier_program_left(divisor):
    made = next_program(virtual_arm(), Gains(rate_divisor=divisor))
    made.arm.connect()
    made.arm.enable()
    elbow = made.modules[ELBOW]
    drive(elbow, velocity=1_000_000, acceleration=70_000)
    made.port.sleep(0.3)
    drive(elbow, velocity=1_000_001, acceleration=1)
    again = next_program(made)
    begin = again.port.time
    again.arm.connect()
    assert again.port.time - begin < 2.0
    assert elbow.profile.velocity == 0
    assert elbow.servo_on
    at = again.shafts()
    again.port.sleep(1.0)
    assert again.shafts() == at


def test_all_boards_brake_before_the_first_is_waited_for(virtual):
    for module in virtual.modules:
        drive(module, velocity=1_000_000, acceleration=70_000)
    virtual.port.sleep(0.3)
    again = next_program(virtual)
    begin, at = again.port.time, again.shafts()
    again.arm.connect()
    assert again.port.time - begin < 1.0
    way = np.abs(np.subtract(again.shafts(), at)) / COUNTS_PER_RADIAN
    assert way.max() < 0.5


def test_a_board_in_pwm_mode_is_stopped_by_connecting(virtual):
    elbow = virtual.modules[ELBOW]
    virtual.arm.release(["right_elbow"])
    elbow.amplifier = True
    drive(elbow, pwm=64)
    virtual.port.sleep(0.2)
    again = next_program(virtual)
    at = again.shafts()[ELBOW]
    assert at != 0.0
    again.arm.connect()
    again.arm.stop()
    at = again.shafts()[ELBOW]
    again.port.sleep(1.0)
    assert again.shafts()[ELBOW] == at
    assert not elbow.amplifier
    assert again.arm.cycle().enabled.tolist() == [True] * 3 + [False] + [True] * 2
    assert still_moving(again.arm.bus, again.arm.axes) == []


def test_a_joint_that_moves_though_it_is_off_is_said_to_move(virtual):
    virtual.arm.release(["right_elbow"])
    elbow, sleep = virtual.modules[ELBOW], virtual.port.sleep

    def fall(seconds):
        elbow.shaft += 20_000.0 * seconds
        sleep(seconds)

    virtual.port.sleep = fall
    virtual.arm.cycle()
    fall(0.1)
    assert virtual.arm.cycle().moving.tolist() == [False] * 3 + [True] + [False] * 2
    assert not virtual.arm.moving  # nobody waits for it to arrive
    assert still_moving(virtual.arm.bus, virtual.arm.axes) == ["right_elbow"]


def test_what_a_smooth_stop_does_not_bring_to_rest_is_stopped_abruptly(virtual):
    elbow = virtual.modules[ELBOW]
    virtual.arm.stop()
    drive(elbow, velocity=1_000_000, acceleration=70_000)
    virtual.port.sleep(0.3)
    drive(elbow, velocity=1_000_001, acceleration=1)
    virtual.arm.stop()
    assert still_moving(virtual.arm.bus, virtual.arm.axes) == []
    assert elbow.profile.velocity == 0


@pytest.mark.parametrize("make", slow_rest(MAKES[1:]))
def test_a_servo_is_stopped_by_the_acceleration_of_the_configuration(make):
    made = virtual_arm(make=make)
    made.arm.connect()
    made.arm.enable()
    made.arm.move({"right_elbow": 1.4})
    for _ in range(40):
        made.arm.heartbeat()
        made.arm.cycle()
    motor = made.arm.axis("right_elbow").motor
    motor.told = replace(motor.told, acceleration=1)  # as an earlier program may have left it
    motor.write_goal()
    again = virtual_arm(made.modules, make=make)
    again.port.time = made.port.time
    again.arm.connect()
    assert again.seconds_to_rest() < 0.5
    assert configuration(make=make).joints[ELBOW].max_acceleration > 1.0

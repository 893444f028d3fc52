"""What could make an arm jump or fall: earlier programs, half-written zeros, lost boards."""

import numpy as np
import pytest

from nico_selfmodel.errors import BusError, ServoFault
from nico_selfmodel.servos.arm.shutdown import stop_what_answers
from nico_selfmodel.servos.arm.zeroing import zero_here
from nico_selfmodel.servos.pic_servo.joint_bus import PicServoJointBus
from nico_selfmodel.servos.pic_servo.line.board import ZERO_MARK
from nico_selfmodel.servos.pic_servo.simulated.module import SimulatedModule

from .arms import JOINTS, virtual_arm


def cycles(made, count):
    for _ in range(count):
        made.arm.heartbeat()
        made.arm.cycle()


def next_program(made, **options):
    """Return an arm of the same boards, as the program finds it that comes next."""
    again = virtual_arm(made.modules, **options)
    again.port.time = made.port.time
    return again


def test_a_board_that_an_earlier_program_left_in_its_group_neither_starts_nor_holds(virtual):
    virtual.arm.move({"right_elbow": 1.0})
    cycles(virtual, 4)  # and then the program is killed, and somebody presses the emergency stop
    virtual.port.sleep(2.0)
    for power in (False, True):
        for module in virtual.modules:
            module.motor_power = power
        virtual.port.sleep(0.1)
        virtual.line.advance(virtual.port.time)
    virtual.modules[3].shaft += 9000.0
    again = next_program(virtual)
    again.arm.connect()
    before = again.shafts()
    again.arm.enable(["right_wrist"])
    again.arm.move({"right_wrist": 0.1})
    again.cycle_until_there()
    again.arm.stop()
    assert np.flatnonzero(np.subtract(again.shafts(), before)).tolist() == [5]
    assert [module.servo_on for module in again.modules] == [False] * 5 + [True]


@pytest.mark.parametrize("part", [slice(2, 4), slice(0, 2)], ids=["another arm", "a part of it"])
def test_two_arms_on_one_chain_never_start_each_other(part):
    boards = [SimulatedModule() for _ in range(4)]
    one = virtual_arm(boards, joints=("a", "b", "c", "d"))
    one.arm.connect()
    one.arm.enable()
    one.arm.move({"a": 1.0, "d": 1.0})
    cycles(one, 4)
    one.arm.stop()  # the goal that its board holds lies ahead of it
    one.port.sleep(0.5)
    other = next_program(one, joints=("a", "b", "c", "d"))
    config = other.arm.config
    half = type(config)("other", config.joints[part])
    other.arm.__init__(PicServoJointBus(other.bus, half), half, trust_zero=True)
    other.arm.connect()
    before = other.shafts()
    other.arm.enable()
    other.arm.move({half.joint_names[0]: 0.1})
    other.cycle_until_there()
    assert np.flatnonzero(np.subtract(other.shafts(), before)).tolist() == [part.start]


class KilledError(Exception):
    pass


@pytest.mark.parametrize("after", [1, 2])
def test_a_zero_that_was_only_half_written_is_not_known(after):
    """A program that dies between mark and position leaves a board far from every limit."""
    made = virtual_arm(trust_zero=False)
    made.arm.connect()
    module = made.arm.axis("right_elbow").motor.board
    original, count = module.set_position, 0

    def set_position(position):
        nonlocal count
        count += 1
        if count == after + 1:
            raise KilledError
        return original(position)

    def ask(command, **options):
        if after == 1 and type(command).__name__ == "SaveHome":
            raise KilledError
        return type(module).ask(module, command, **options)

    module.set_position, module.ask = set_position, ask
    if after == 2:
        count = 1  # the mark is saved, the position is still the mark
    with pytest.raises(KilledError):
        zero_here(made.arm, "right_elbow")
    assert abs(made.modules[3].position - ZERO_MARK) < 50
    again = next_program(made, trust_zero=False)
    assert "right_elbow" in again.arm.connect()
    again = next_program(made, trust_zero=True)
    again.arm.connect()
    again.arm.enable()
    before = again.shafts()
    with pytest.raises(ServoFault, match=r"right_elbow .module 4. reads .* its zero is lost; home"):
        again.arm.move({"right_elbow": 0.1})
    with pytest.raises(ServoFault, match="its zero is lost"):
        again.arm.command(np.zeros(6))
    assert again.shafts() == before


def test_a_lost_joint_that_still_holds_is_enabled_again_without_letting_go(virtual):
    elbow = virtual.modules[3]
    elbow.silent = True
    with pytest.raises(BusError, match="is lost"):
        virtual.arm.cycle()
    elbow.silent = False
    torque = []
    original = elbow.execute
    elbow.execute = lambda command: (original(command), torque.append(elbow.servo_on))[0]
    virtual.arm.enable()
    assert torque
    assert all(torque)
    virtual.arm.move({"right_elbow": 0.2})
    virtual.cycle_until_there()


@pytest.mark.parametrize("release", [False, True])
def test_the_boards_that_answer_are_stopped_though_another_is_missing(virtual, release):
    virtual.arm.move(dict.fromkeys(JOINTS, 1.5))
    cycles(virtual, 4)
    virtual.modules[2].silent = True
    again = next_program(virtual)
    with pytest.raises(BusError, match=r"missing: right_upper_arm_twist"):
        again.arm.connect()
    done, failures = stop_what_answers(again.arm.axes, release=release)
    assert done == [name for name in JOINTS if name != "right_upper_arm_twist"]
    assert len(failures) == 1
    assert "right_upper_arm_twist" in failures[0]
    held = [module.servo_on for module in again.modules]
    assert held == ([False, False, True, False, False, False] if release else [True] * 6)
    assert again.seconds_to_rest() < 0.5


def test_stopping_what_answers_switches_no_servo_on():
    made = virtual_arm()
    made.arm.connect()
    again = next_program(made)
    assert stop_what_answers(again.arm.axes, release=False) == (list(JOINTS), [])
    assert not any(module.amplifier or module.servo_on for module in made.modules)


def test_boards_that_lost_their_power_are_told_again_how_fast_to_go(virtual):
    virtual.arm.move({"right_elbow": 0.3})
    virtual.cycle_until_there()
    for module in virtual.modules:
        module.power_cycle()
    with pytest.raises(BusError, match="is lost"):
        virtual.arm.cycle()
    virtual.arm.connect()
    virtual.arm.enable()
    before = virtual.shafts()
    virtual.arm.move({"right_elbow": 0.3})
    virtual.cycle_until_there()
    assert np.flatnonzero(np.subtract(virtual.shafts(), before)).tolist() == [3]

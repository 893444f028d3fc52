"""One board: what its commands do, in counts and seconds."""

import math

import pytest

from nico_selfmodel.errors import ServoFault
from nico_selfmodel.servos.pic_servo.line.board import PicServo
from nico_selfmodel.servos.pic_servo.line.bus import Bus
from nico_selfmodel.servos.pic_servo.line.chain import (
    join_group,
    scan,
    start_together,
    stop_together,
)
from nico_selfmodel.servos.pic_servo.protocol.commands import (
    HomingMode,
    OutputMode,
    StopMode,
    StopMotor,
)
from nico_selfmodel.servos.pic_servo.protocol.gains import Gains
from nico_selfmodel.servos.pic_servo.protocol.status import AuxiliaryFlag, StatusFlag, StatusItem
from nico_selfmodel.servos.pic_servo.protocol.trajectory import (
    LoadTrajectory,
    TrajectoryFlag,
    acceleration_units,
    velocity_units,
)
from nico_selfmodel.servos.pic_servo.simulated.line import PicServoLine
from nico_selfmodel.servos.pic_servo.simulated.module import SimulatedModule
from nico_selfmodel.servos.simulated.port import SimulatedPort

MOVE_DONE = StatusFlag.MOVE_DONE


def switch_on(servo):
    servo.set_output(OutputMode.THREE_PHASE)
    servo.set_gains(Gains())
    servo.arm_amplifier()
    return servo.hold()


def move_at(servo, velocity, acceleration):
    """Move at a velocity [counts/s, counts/s^2] until told otherwise."""
    flags = TrajectoryFlag.SERVO | TrajectoryFlag.VELOCITY_MODE | TrajectoryFlag.START_NOW
    back = TrajectoryFlag.REVERSE if velocity < 0.0 else 0
    speed, change = velocity_units(abs(velocity)), acceleration_units(acceleration)
    return servo.ask(LoadTrajectory(flags | back, velocity=speed, acceleration=change))


def wait_until_done(servo, port):
    begin = port.time
    while not servo.poll().flags & MOVE_DONE:
        assert port.time - begin < 30.0
    return port.time - begin


def test_a_board_says_what_it_is(module):
    _, servo, _ = module
    assert str(servo.identify()) == "PIC-SERVO version 10"


def test_a_board_that_is_off_says_move_done_and_position_error(module):
    _, servo, _ = module
    flags = servo.poll().flags
    assert flags == MOVE_DONE | StatusFlag.POWER_ON | StatusFlag.POSITION_ERROR


def test_switching_on_holds_where_it_stands(module):
    board, servo, _ = module
    board.shaft = 1234.0
    status = switch_on(servo)
    assert status.position == 1234
    assert status.auxiliary == AuxiliaryFlag.SERVO_ON
    assert status.flags == MOVE_DONE | StatusFlag.POWER_ON
    assert board.shaft == 1234.0


@pytest.mark.parametrize("goal", [10_000, -10_000, 300, 1])
@pytest.mark.parametrize("divisor", [1, 4])
def test_a_trapezoid_takes_the_time_of_its_units(module, goal, divisor):
    board, servo, port = module
    servo.set_gains(Gains(rate_divisor=divisor))
    switch_on(servo) if divisor == 1 else (servo.arm_amplifier(), servo.hold())
    speed, acceleration = 10_000.0, 20_000.0
    servo.move_to(goal, speed, acceleration)
    took = wait_until_done(servo, port)
    distance = abs(goal)
    if distance < speed**2 / acceleration:
        expected = 2.0 * math.sqrt(distance / acceleration)
    else:
        expected = distance / speed + speed / acceleration
    assert took == pytest.approx(expected, rel=0.01, abs=0.03)
    assert servo.poll().position == goal == board.position


def test_a_goal_may_change_on_the_way_and_is_not_passed(module):
    board, servo, port = module
    switch_on(servo)
    servo.move_to(50_000, 20_000.0, 40_000.0)
    port.sleep(1.0)
    servo.move_to(40_000)
    largest = 0
    while not (status := servo.poll()).flags & MOVE_DONE:
        largest = max(largest, status.position)
    assert status.position == 40_000 >= largest
    servo.move_to(0)
    port.sleep(0.5)
    servo.move_to(40_000)  # turns round
    wait_until_done(servo, port)
    assert board.position == 40_000


def test_before_version_10_a_goal_on_the_way_counts_from_the_last():
    board = SimulatedModule(version=5)
    port = SimulatedPort(PicServoLine([board]))
    scan(Bus(port), [1])
    servo = PicServo(Bus(port), 1)
    switch_on(servo)
    servo.move_to(10_000, 20_000.0, 40_000.0)
    servo.move_to(10_000)
    wait_until_done(servo, port)
    assert board.position == 20_000


def test_a_velocity_is_reached_and_held_until_a_smooth_stop(module):
    board, servo, port = module
    switch_on(servo)
    status = move_at(servo, -5000.0, 10_000.0)
    assert not status.flags & MOVE_DONE
    port.sleep(0.6)
    assert servo.poll().flags & MOVE_DONE  # the velocity is reached
    begin = servo.poll().position
    port.sleep(1.0)
    assert servo.poll().position - begin == pytest.approx(-5000, rel=0.02)
    before = servo.stop_smoothly().position
    port.sleep(1.0)
    # v^2 / 2a
    assert before - servo.poll().position == pytest.approx(1250, rel=0.05)
    assert board.profile.velocity == 0


def test_an_abrupt_stop_stops_at_once_and_holds(module):
    board, servo, port = module
    switch_on(servo)
    move_at(servo, 5000.0, 10_000.0)
    port.sleep(1.0)
    servo.hold()
    at = board.position
    port.sleep(0.5)
    assert board.position == at
    assert board.servo_on


def test_a_pwm_drives_both_ways_and_release_ends_it(module):
    board, servo, port = module
    switch_on(servo)
    servo.ask(LoadTrajectory(TrajectoryFlag.START_NOW, pwm=100))
    port.sleep(0.2)
    forward = servo.poll().position
    assert forward > 0
    servo.ask(LoadTrajectory(TrajectoryFlag.START_NOW | TrajectoryFlag.REVERSE, pwm=200))
    port.sleep(0.4)
    assert servo.release().position < forward
    at = board.shaft
    port.sleep(0.5)
    assert board.shaft == at
    assert not board.amplifier


def test_stop_here_goes_there_without_a_profile(module):
    _board, servo, _ = module
    switch_on(servo)
    servo.ask(StopMotor(StopMode.AMPLIFIER | StopMode.HERE, 37))
    assert servo.poll().position == 37


def test_a_group_starts_in_one_tick_and_stops_with_one_packet():
    modules = [SimulatedModule() for _ in range(3)]
    line = PicServoLine(modules)
    port = SimulatedPort(line)
    bus = Bus(port)
    scan(bus, [1, 2, 3])
    servos = [PicServo(bus, address) for address in (1, 2, 3)]
    for servo in servos:
        servo.watch()
    for servo in servos[:2]:
        switch_on(servo)
        join_group(servo, 0x80)
        servo.move_to(10_000, 5000.0, 20_000.0, start=False)
    port.sleep(0.2)
    assert [m.shaft for m in modules] == [0, 0, 0]
    start_together(bus, 0x80)
    for _ in range(20):
        port.sleep(0.02)
        assert modules[0].shaft == modules[1].shaft
    assert modules[0].shaft > 500
    stop_together(bus, 0x80)
    port.sleep(0.5)
    at = [m.shaft for m in modules]
    port.sleep(0.5)
    assert [m.shaft for m in modules] == at
    assert at[0] == at[1] < 10_000
    assert at[2] == 0
    assert not modules[2].amplifier  # it is not in the group


def test_a_blocked_joint_exceeds_its_position_error_and_lets_go(module):
    board, servo, port = module
    switch_on(servo)
    board.mechanics.stuck = True
    servo.move_to(20_000, 10_000.0, 20_000.0)
    port.sleep(0.3)
    assert servo.poll().position_error > 100
    port.sleep(2.0)
    status = servo.poll()
    assert status.flags & StatusFlag.POSITION_ERROR
    assert not status.auxiliary & AuxiliaryFlag.SERVO_ON
    assert status.position == 0
    servo.hold()
    assert servo.poll().flags & StatusFlag.POSITION_ERROR  # it stays until it is cleared
    assert not servo.clear_faults().flags & StatusFlag.POSITION_ERROR


def test_an_over_current_stays_until_it_is_cleared(module):
    board, servo, _ = module
    switch_on(servo)
    board.overload()
    assert servo.poll().flags & StatusFlag.OVERCURRENT
    servo.clear_faults()
    assert not servo.hold().flags & StatusFlag.OVERCURRENT


def test_without_motor_power_nothing_moves(module):
    board, servo, port = module
    switch_on(servo)
    servo.move_to(50_000, 10_000.0, 20_000.0)
    port.sleep(0.5)
    board.motor_power = False
    port.sleep(0.01)
    at = board.shaft
    status = servo.poll()
    assert not status.flags & StatusFlag.POWER_ON
    assert not status.auxiliary & AuxiliaryFlag.SERVO_ON
    servo.move_to(50_000, 10_000.0, 20_000.0)
    port.sleep(0.5)
    assert board.shaft == at


def test_limit_inputs_show_their_level(module):
    board, servo, _ = module
    board.mechanics.upper_switch, board.mechanics.lower_switch = 100.0, -100.0
    assert not servo.poll().flags & (StatusFlag.LIMIT_1 | StatusFlag.LIMIT_2)
    board.shaft = 150.0
    assert servo.poll().flags & StatusFlag.LIMIT_1
    board.shaft = -150.0
    assert servo.poll().flags & StatusFlag.LIMIT_2


@pytest.mark.parametrize(("event", "where"), [(HomingMode.LIMIT_1, 3000), (HomingMode.INDEX, 2000)])
def test_the_position_of_the_event_is_captured_and_the_motor_stops(module, event, where):
    board, servo, port = module
    board.mechanics.upper_switch = 3000.0
    switch_on(servo)
    assert servo.capture_home(event | HomingMode.SMOOTH).flags & StatusFlag.HOMING
    move_at(servo, 2000.0, 10_000.0)
    port.sleep(3.0)
    status = servo.read(StatusItem.HOME | StatusItem.POSITION)
    assert not status.flags & StatusFlag.HOMING
    assert status.home == pytest.approx(where, abs=2)
    assert where < status.position < where + 400
    assert board.profile.velocity == 0


def test_setting_the_position_moves_nothing_even_under_servo(module):
    board, servo, port = module
    board.shaft = 700.0
    switch_on(servo)
    servo.set_position(-5000)
    port.sleep(0.2)
    status = servo.poll()
    assert (status.position, status.position_error) == (-5000, 0)
    assert board.shaft == 700.0


def test_a_zero_is_marked_until_the_power_goes(module):
    board, servo, _ = module
    board.shaft = 321.0
    assert not servo.knows_its_zero()
    servo.zero_at(1000)
    assert servo.poll().position == 1000
    assert servo.knows_its_zero()
    board.power_cycle()
    scan(servo.bus, [1])
    servo.watch()
    assert servo.poll().position == 0
    assert not servo.knows_its_zero()


@pytest.mark.parametrize(("lost", "sent"), [(True, 3), (False, 3)])
def test_a_lost_command_or_reply_leaves_the_zero_right(module, lost, sent):
    board, servo, _ = module
    board.shaft = 50.0
    original, commands = board.execute, []

    def unreliable(command):
        commands.append(type(command).__name__)
        if "ReadStatus" not in commands[-1] and commands.count(commands[-1]) == 1:
            if not lost:  # carried out, the reply gets lost
                original(command)
            return None
        return original(command)

    board.execute = unreliable
    servo.zero_at(1000)
    assert board.position == 1000
    assert servo.knows_its_zero()
    assert commands.count("ResetPosition") <= sent


def test_a_board_that_does_not_take_a_position_is_a_fault(module):
    board, servo, _ = module
    board._do_ResetPosition = lambda command: None
    with pytest.raises(ServoFault, match="module 1 does not take position 700, it stays at 0"):
        servo.set_position(700)


def test_gains_beyond_the_chip_are_refused_before_they_are_sent(module):
    board, servo, _ = module
    with pytest.raises(ValueError, match="kp must be 0 to 32767"):
        servo.set_gains(Gains(kp=40_000))
    assert board.gains == Gains()

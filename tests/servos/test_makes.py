"""Every make of motors under the one controller: what is commanded, what befalls it."""

import math

import numpy as np
import pytest

from nico_selfmodel.errors import BusError, ServoFault
from nico_selfmodel.servos import ServoConfig
from nico_selfmodel.servos.makes import PIC_SERVO
from nico_selfmodel.servos.pic_servo.protocol.commands import BAUD_CODES
from nico_selfmodel.servos.pic_servo.protocol.packets import LAST_ADDRESS
from nico_selfmodel.servos.ports import PortLostError
from nico_selfmodel.servos.register_servo.register_motor import Goal

from ..slow_rest import slow_rest
from .arms import JOINTS, MAKES, configuration, virtual_arm

ELBOW = 3
"""The joint that something befalls."""
NAMED = r"right_elbow \((module|id) 4\)"


@pytest.fixture(params=slow_rest(MAKES, plain=2))
def virtual(request):
    """Return an arm of each make in virtual time: connected, enabled, its zero trusted."""
    made = virtual_arm(make=request.param)
    made.arm.connect()
    made.arm.enable()
    return made


@pytest.fixture(params=slow_rest(MAKES[1:]))
def servos(request):
    """Return an arm of servos with registers."""
    made = virtual_arm(make=request.param)
    made.arm.connect()
    made.arm.enable()
    return made


def count(made):
    """Return the radians of one count."""
    return 2.0 * math.pi / made.arm.config.joints[0].counts_per_turn


def go_on(made, cycles):
    for _ in range(cycles):
        made.arm.heartbeat()
        made.arm.cycle()


@pytest.mark.parametrize("make", MAKES)
def test_making_and_connecting_moves_and_enables_nothing(make):
    made = virtual_arm(make=make)
    before = made.shafts()
    assert made.port.time == 0.0
    made.arm.connect()
    made.port.sleep(1.0)
    assert made.shafts() == before
    assert not any(module.servo_on for module in made.modules)
    assert not any(getattr(module, "amplifier", False) for module in made.modules)
    assert made.arm.state().valid.all()
    assert not made.arm.state().enabled.any()


def test_a_move_ends_where_it_was_sent_whichever_way_a_motor_is_wired(virtual):
    targets = {"right_elbow": 0.9, "right_wrist": -0.4, "right_shoulder_pitch": 0.2}
    expected = virtual.arm.move(targets)
    assert virtual.cycle_until_there() == pytest.approx(expected, abs=0.25)
    state = virtual.arm.cycle()
    wanted = [targets.get(name, 0.0) for name in JOINTS]
    assert state.q == pytest.approx(wanted, abs=count(virtual))


@pytest.mark.parametrize("virtual", slow_rest(MAKES), indirect=True)
def test_a_motor_is_never_faster_than_it_was_told(virtual):
    virtual.arm.move({"right_elbow": 1.0, "right_wrist": 0.05}, speed=0.3)
    places = []
    while virtual.arm.moving:
        virtual.arm.heartbeat()
        places.append((virtual.port.time, *virtual.arm.cycle().q[[3, 5]]))
    times, elbow, wrist = np.array(places).T
    inner = slice(len(times) // 4, 3 * len(times) // 4)
    speed = np.polyfit(times[inner], elbow[inner], 1)[0]
    assert 0.25 < speed < 0.305
    assert wrist[len(times) // 2] < 0.045  # it arrives with the elbow, as far as its steps allow


def test_a_stream_of_commands_is_followed(virtual):
    for step in range(60):
        target = 0.4 * math.sin(0.1 * step)
        virtual.arm.command(np.full(6, target))
        virtual.arm.cycle()
    virtual.cycle_until_there()
    assert virtual.arm.cycle().q == pytest.approx(np.full(6, target), abs=count(virtual))


@pytest.mark.parametrize("heartbeat", slow_rest([0.1, 0.3, 0.6]))
@pytest.mark.parametrize("make", slow_rest(MAKES, plain=2))
def test_a_host_that_dies_leaves_an_arm_that_stops_in_time(make, heartbeat):
    made = virtual_arm(make=make, heartbeat=heartbeat)
    made.arm.connect()
    made.arm.enable()
    for cycles in (0, 1, 3, 8, 20):
        made.arm.move(dict.fromkeys(JOINTS, 1.5 if cycles % 2 else -1.5))
        go_on(made, cycles)
        # Not one byte more.
        assert made.seconds_to_rest() <= heartbeat + 0.5
        made.arm.stop()
        made.arm.move(dict.fromkeys(JOINTS, 0.0))
        made.cycle_until_there()
        assert made.arm.cycle().q == pytest.approx(np.zeros(6), abs=2 * count(made))


def test_a_host_whose_program_hangs_is_stopped_by_its_bus_thread(virtual):
    virtual.arm.move({"right_elbow": 1.5})
    begin = virtual.port.time
    while virtual.arm.moving:
        virtual.arm.cycle()  # reads, but nobody says that the program lives
    assert virtual.port.time - begin + virtual.seconds_to_rest() < 0.3 + 0.5
    assert virtual.arm.cycle().q[ELBOW] < 0.9
    virtual.arm.move({"right_elbow": 1.0})  # and it can be moved again
    virtual.cycle_until_there()
    assert virtual.arm.cycle().q[ELBOW] == pytest.approx(1.0, abs=count(virtual))


def test_a_host_that_is_slower_than_its_heartbeat_gets_there_all_the_same(virtual):
    virtual.arm.move(dict.fromkeys(JOINTS, 0.8))
    cycles = 0
    while virtual.arm.moving:
        virtual.arm.heartbeat()
        virtual.arm.cycle()
        virtual.port.sleep(0.5)
        cycles += 1
        assert cycles < 60
    assert virtual.arm.cycle().q == pytest.approx(np.full(6, 0.8), abs=count(virtual))


def test_a_silent_motor_is_named_and_the_others_stop(virtual):
    virtual.arm.move(dict.fromkeys(JOINTS, 1.5))
    go_on(virtual, 6)
    virtual.modules[ELBOW].silent = True
    begin = virtual.port.time
    words = rf"{NAMED} is lost: .* other joints were stopped and hold"
    with pytest.raises(BusError, match=words) as caught:
        virtual.cycle_until_there()
    assert virtual.port.time - begin + virtual.seconds_to_rest() < 0.3 + 0.5 + 0.5
    assert list(caught.value.partial.valid) == [k != ELBOW for k in range(6)]
    assert all(module.servo_on for module in virtual.modules)


def test_a_cable_that_is_pulled_is_an_error_and_the_arm_stops(virtual):
    virtual.arm.move(dict.fromkeys(JOINTS, 1.5))
    go_on(virtual, 5)
    virtual.port.unplugged = True
    with pytest.raises(PortLostError, match=r"plug the adapter in again.*stops by itself"):
        virtual.arm.cycle()
    assert virtual.seconds_to_rest() <= 0.8
    virtual.arm.close()
    virtual.port.unplugged = False
    at = virtual.shafts()
    never_homed = virtual.arm.connect()
    assert never_homed == (() if virtual.arm.config.make.keeps_zero else JOINTS)  # only trusted
    assert virtual.arm.cycle().enabled.all()  # they hold, nothing was reset
    virtual.port.sleep(0.5)
    assert virtual.shafts() == pytest.approx(at, abs=1.0)
    virtual.arm.move({"right_elbow": 0.0})
    virtual.cycle_until_there()


def test_an_overload_stops_the_others_and_is_cleared_by_enabling(virtual):
    virtual.arm.move(dict.fromkeys(JOINTS, 1.2))
    go_on(virtual, 3)
    virtual.modules[ELBOW].overload()
    with pytest.raises(ServoFault, match=rf"{NAMED}: (over-current|overload)") as caught:
        virtual.cycle_until_there()
    assert "The other joints were stopped" in str(caught.value)
    assert virtual.seconds_to_rest() < 0.5
    state = virtual.arm.cycle()
    assert state.trouble[ELBOW] is not None
    assert list(state.enabled) == [k != ELBOW for k in range(6)]
    virtual.arm.enable(["right_elbow"])
    virtual.arm.move(dict.fromkeys(JOINTS, 0.3))
    virtual.cycle_until_there()
    assert virtual.arm.cycle().q == pytest.approx(np.full(6, 0.3), abs=count(virtual))


@pytest.mark.parametrize("speed", slow_rest([60.0, 5.0, 20.0]))
@pytest.mark.parametrize("virtual", slow_rest(MAKES, plain=2), indirect=True)
def test_a_joint_that_jams_is_a_fault(virtual, speed):
    travel = math.radians(5.0 + 0.7 * speed)
    seconds = virtual.arm.move({"right_elbow": travel}, speed=math.radians(speed))
    begin = virtual.port.time
    while virtual.port.time < begin + 0.4 * seconds:
        go_on(virtual, 1)
    virtual.modules[ELBOW].mechanics.stuck = True
    jammed = virtual.port.time
    with pytest.raises(ServoFault, match=rf"{NAMED}: (blocked|position error)"):
        virtual.cycle_until_there()
    assert virtual.port.time - jammed + virtual.seconds_to_rest() < 1.5
    assert not virtual.arm.state().moving.any()


def test_stop_brakes_every_joint_and_release_lets_go(virtual):
    virtual.arm.move(dict.fromkeys(JOINTS, 1.5))
    go_on(virtual, 20)
    virtual.arm.stop()
    assert virtual.seconds_to_rest() < 0.3
    assert all(module.servo_on for module in virtual.modules)
    assert np.abs(virtual.arm.cycle().q).max() < 1.4
    virtual.arm.release(["right_elbow"])
    assert [module.servo_on for module in virtual.modules] == [k != ELBOW for k in range(6)]
    with pytest.raises(ServoFault, match=rf"{NAMED} is not enabled"):
        virtual.arm.move({"right_elbow": 0.0})


def test_connecting_to_a_moving_arm_stops_it_and_keeps_it_on(virtual):
    make = virtual.arm.config.make.name
    virtual.arm.move(dict.fromkeys(JOINTS, 1.5))
    go_on(virtual, 12)
    again = virtual_arm(virtual.modules, make=make)
    again.port.time = virtual.port.time
    again.arm.connect()
    assert again.seconds_to_rest() < 0.4
    assert again.arm.cycle().enabled.all()
    again.arm.move(dict.fromkeys(JOINTS, 0.0))
    again.cycle_until_there()


def test_two_motors_with_one_id_are_called_that(servos):
    servos.modules[ELBOW].address = 2
    with pytest.raises(BusError, match=r"id 2 answers.*: two servos have this id"):
        servos.arm.connect()


def test_servos_that_are_missing_are_named_by_joint_and_id(servos):
    servos.modules[ELBOW].silent = True
    with pytest.raises(BusError, match=rf"5 of 6 servos answer; missing: {NAMED}"):
        servos.arm.connect()
    for module in servos.modules:
        module.silent = True
    with pytest.raises(BusError, match=r"no servo answers on simulated at 1000000 baud"):
        servos.arm.connect()


def test_a_servo_of_another_kind_is_refused(servos):
    register = 0 if servos.arm.config.make.name == "dynamixel" else 3
    servos.modules[ELBOW].table[register : register + 2] = (350).to_bytes(2, "little")
    with pytest.raises(BusError, match=rf"{NAMED} is a servo of model 350"):
        servos.arm.connect()


def test_limits_beyond_the_servos_own_are_refused_before_anything_moves(servos):
    if servos.arm.config.make.name == "dynamixel":
        servos.modules[ELBOW].table[48:52] = (2500).to_bytes(4, "little")
    else:
        servos.modules[ELBOW].table[11:13] = (2500).to_bytes(2, "little")
    with pytest.raises(BusError, match=rf"{NAMED} may go from 1024 to 3072 .* only from 0 to 2500"):
        servos.arm.connect()


def test_enabling_moves_nothing_wherever_the_servo_was_sent_last(servos):
    servos.arm.release()
    for module in servos.modules:
        module.shaft += 300.0  # somebody pushes it
    before = servos.shafts()
    servos.arm.enable()
    servos.port.sleep(0.5)
    assert servos.shafts() == before


def test_what_a_servo_missed_is_told_again(servos):
    """What several are told at once nobody confirms."""
    original, lost = servos.bus.sync_write, []

    def lose(register, data):
        lost.append(data)
        data = {address: block for address, block in data.items() if address != 4}
        original(register, data)
        servos.bus.sync_write = original

    servos.bus.sync_write = lose
    servos.arm.move({"right_elbow": 0.4, "right_wrist": 0.4})
    servos.cycle_until_there()
    assert 4 in lost[0]
    assert servos.bus.counts[4].refused == 1
    assert servos.arm.cycle().q[[3, 5]] == pytest.approx([0.4, 0.4], abs=count(servos))


def test_a_host_that_hangs_now_and_then_does_not_blame_the_servo(servos):
    """The watchdog of a Dynamixel ends between a look and a goal, which is then refused."""
    original, hung = servos.bus.sync_write, []

    def late(register, data):
        if len(hung) < 2:
            hung.append(data)
            servos.port.sleep(0.7)
        original(register, data)

    servos.bus.sync_write = late
    servos.arm.move({"right_elbow": 0.4})
    servos.cycle_until_there()
    assert hung
    assert servos.arm.cycle().q[3] == pytest.approx(0.4, abs=count(servos))


@pytest.mark.parametrize("make", MAKES[1:])
def test_a_host_that_hangs_while_it_enables_an_arm_enables_it(make):
    """Longer than the heartbeat, before anything that it writes to the elbow."""
    made = virtual_arm(make=make)
    made.arm.connect()
    original, written = made.bus.write, []

    def late(address, register, data):
        if address == 4:
            written.append(register)
            made.port.sleep(0.7)
        return original(address, register, data)

    made.bus.write = late
    made.arm.enable()
    made.bus.write = original
    assert len(written) >= 3
    made.arm.move({"right_elbow": 0.2})
    made.cycle_until_there()
    assert made.arm.cycle().q[3] == pytest.approx(0.2, abs=count(made))


def test_a_servo_that_takes_no_goals_is_a_fault(servos):
    elbow = servos.modules[ELBOW]
    original = elbow.write
    elbow.write = lambda register, data: None if len(data) > 4 else original(register, data)
    servos.arm.move({"right_elbow": 0.4})
    with pytest.raises(ServoFault, match=rf"{NAMED}: it does not take its goals"):
        servos.cycle_until_there()


def test_a_servo_whose_power_went_is_a_fault_and_not_moved(servos):
    elbow = servos.modules[ELBOW]
    go_on(servos, 2)
    elbow.power_cycle()
    elbow.deaf_until = 0.0
    elbow.shaft += 50.0
    with pytest.raises(ServoFault, match=rf"{NAMED}: it"):
        go_on(servos, 3)
    assert not elbow.servo_on


def test_the_zero_is_kept_by_the_servo_and_moved_by_its_homing_offset(servos):
    from nico_selfmodel.servos.arm.zeroing import zero_here

    servos.arm.release()
    servos.modules[ELBOW].shaft += 200.0
    zero_here(servos.arm, "right_elbow")
    assert servos.arm.cycle().q[ELBOW] == pytest.approx(0.0, abs=1e-9)
    servos.modules[ELBOW].power_cycle()
    servos.modules[ELBOW].deaf_until = 0.0
    assert servos.arm.connect() == ()
    assert servos.arm.cycle().q[ELBOW] == pytest.approx(0.0, abs=1e-9)
    servos.modules[ELBOW].shaft += 2500.0
    with pytest.raises(ServoFault, match=r"homing offset of .* at most"):
        zero_here(servos.arm, "right_elbow")


def test_an_offset_that_is_not_the_configurations_makes_the_zero_unknown(servos):
    from dataclasses import replace

    config = servos.arm.config
    joints = tuple(replace(joint, homing_offset=0) for joint in config.joints)
    again = virtual_arm(servos.modules, make=config.make.name, trust_zero=False)
    for motor, joint in zip(again.arm.bus.motors, joints, strict=True):
        motor.joint = joint
    again.port.time = servos.port.time
    assert again.arm.connect() == ()
    servos.modules[ELBOW].offset = 5
    if config.make.name == "dynamixel":
        servos.modules[ELBOW].table[20] = 5
    else:
        servos.modules[ELBOW].table[31] = 5
    assert again.arm.connect() == ("right_elbow",)


@pytest.mark.slow
def test_a_dynamixel_stops_by_itself_when_it_hears_nothing_and_takes_goals_again():
    made = virtual_arm(make="dynamixel", heartbeat=0.2)
    made.arm.connect()
    made.arm.enable()
    made.arm.move(dict.fromkeys(JOINTS, 1.5))
    go_on(made, 40)
    before = np.array(made.shafts())
    made.port.sleep(0.5)
    assert [module.table[98] for module in made.modules] == [0xFF] * 6
    assert np.abs(np.array(made.shafts()) - before).max() < 0.2 * 683 + 5
    made.cycle_until_there()
    assert made.arm.cycle().q == pytest.approx(np.full(6, 1.5), abs=count(made))
    made.arm.close()
    assert [module.table[98] for module in made.modules] == [0] * 6


@pytest.mark.parametrize("acceleration", [0, 5])
def test_a_servo_that_another_program_left_moving_is_stopped_where_it_is(servos, acceleration):
    """With an acceleration of 0 it goes, and stops, as fast as it can."""
    elbow, motor = servos.modules[ELBOW], servos.arm.bus.motors[ELBOW]
    elbow.write(motor.goal_register, motor.encode(Goal(3000, 300, acceleration)))
    if servos.arm.config.make.name == "dynamixel":
        elbow.write(motor.goal_register, motor.encode(Goal(3000, 20, acceleration)))
        elbow.write(98, b"\x00")
    servos.port.sleep(1.0)
    at = servos.shafts()[ELBOW]
    assert 2080 < at < 2900
    servos.arm.connect()
    assert servos.seconds_to_rest() < 1.2
    assert servos.shafts()[ELBOW] - at < (30 if acceleration == 0 else 120)
    assert elbow.servo_on


def test_the_numbers_of_boards_are_those_of_their_protocol():
    assert sorted(PIC_SERVO.bauds) == sorted(BAUD_CODES)
    assert PIC_SERVO.addresses == (1, LAST_ADDRESS)


def test_motors_of_two_makes_cannot_share_a_bus():
    one, other = (configuration(("a", "b"), make=make).joints for make in MAKES[1:])
    with pytest.raises(ValueError, match="makes dynamixel and feetech cannot share a bus"):
        ServoConfig("arm", (one[0], other[1]))


def test_speeds_are_rounded_down_to_what_a_motor_has_and_arrivals_up(servos):
    limits, make = servos.arm.limits, servos.arm.config.make
    speeds = limits.motor_speed(0.5)
    assert (speeds <= 0.5 * limits.counts_per_radian + 1e-9).all()
    assert speeds % make.velocity_step == pytest.approx(
        np.zeros(6), abs=1e-6
    ) or speeds % make.velocity_step == pytest.approx(np.full(6, make.velocity_step), abs=1e-6)
    assert (speeds > 0.5 * limits.counts_per_radian - make.velocity_step - 1e-9).all()
    with pytest.raises(ValueError, match="speed must be at least"):
        limits.motor_speed(0.5 * make.velocity_step / limits.counts_per_radian[0])
    joint = servos.arm.config.joints[0]
    assert joint.faster(1.5 * make.velocity_step) == pytest.approx(2.0 * make.velocity_step)


def test_a_line_of_one_megabaud_leaves_time_for_far_more_than_fifty_cycles_a_second(servos):
    servos.arm.move(dict.fromkeys(JOINTS, 0.8))
    cycles, begin = 0, servos.port.time
    while servos.arm.moving:
        go_on(servos, 1)
        cycles += 1
    assert cycles / (servos.port.time - begin) > 200.0

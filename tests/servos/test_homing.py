"""Finding the zero again after the power was off."""

import math
from dataclasses import replace

import pytest

from nico_selfmodel.errors import BusError, ServoFault
from nico_selfmodel.servos import ArmController
from nico_selfmodel.servos.arm.servo_config import HomePlan
from nico_selfmodel.servos.arm.zeroing import zero_here
from nico_selfmodel.servos.pic_servo import homing
from nico_selfmodel.servos.pic_servo.homing import find_home
from nico_selfmodel.servos.pic_servo.joint_bus import PicServoJointBus
from nico_selfmodel.servos.pic_servo.line.bus import Bus
from nico_selfmodel.servos.pic_servo.simulated.line import PicServoLine
from nico_selfmodel.servos.pic_servo.simulated.module import SimulatedModule
from nico_selfmodel.servos.simulated.port import SimulatedPort

from .arms import COUNTS_PER_TURN, VirtualArm, configuration, virtual_arm

COUNTS_PER_RADIAN = COUNTS_PER_TURN / (2 * math.pi)


def homing_arm(plan, sign=1):
    """Return an arm of one joint with a way to find home, powered up 0.2 rad from there."""
    config = configuration(("elbow",))
    joint = replace(config.joints[0], home=plan, sign=sign)
    board = SimulatedModule(shaft=-8000)
    line = PicServoLine([board])
    port = SimulatedPort(line)
    bus = Bus(port)
    config = replace(config, joints=(joint,))
    arm = ArmController(PicServoJointBus(bus, config), config)
    arm.connect()
    arm.enable()
    return VirtualArm(line, port, bus, arm)


def test_a_joint_that_stands_at_its_home_is_zeroed_without_moving():
    made = virtual_arm(trust_zero=False)
    made.arm.connect()
    for name in made.arm.joints:
        zero_here(made.arm, name)
    assert made.arm.rezero_due == ()
    assert made.shafts() == [0.0] * 6
    zero_here(made.arm, "right_elbow", 0.5)
    assert made.arm.cycle().q[3] == pytest.approx(0.5, abs=1e-4)
    assert made.arm.cycle().q[2] == 0.0
    made.arm.enable()
    made.arm.move({"right_elbow": 0.0})
    made.cycle_until_there()
    assert made.modules[3].shaft == pytest.approx(0.5 * COUNTS_PER_RADIAN, abs=1)


def test_the_zero_outlives_this_program_but_not_the_power():
    made = virtual_arm(trust_zero=False)
    made.arm.connect()
    for name in made.arm.joints:
        zero_here(made.arm, name)
    again = virtual_arm(made.modules, trust_zero=False)
    assert again.arm.connect() == ()
    for module in made.modules:
        module.power_cycle()
    assert len(virtual_arm(made.modules, trust_zero=False).arm.connect()) == 6


@pytest.mark.parametrize("sign", [1, -1])
def test_a_switch_gives_the_zero(sign):
    plan = HomePlan("limit_1", at=0.3, speed=sign * 0.2, travel=2.0)
    made = homing_arm(plan, sign)
    made.modules[0].mechanics.upper_switch = 1000.0
    find_home(made.arm, "elbow")
    assert made.arm.rezero_due == ()
    # Where the switch is, the encoder now reads `at`.
    state = made.arm.cycle()
    beyond = (made.modules[0].shaft - 1000.0) / COUNTS_PER_RADIAN * sign
    assert state.q[0] == pytest.approx(0.3 + beyond, abs=3 / COUNTS_PER_RADIAN)
    assert 0.0 < abs(beyond) < 0.05
    made.arm.move({"elbow": 0.3})
    made.cycle_until_there()
    assert made.modules[0].shaft == pytest.approx(1000.0, abs=3)


def test_a_switch_that_does_not_show_is_a_fault_and_the_joint_stands():
    made = homing_arm(HomePlan("limit_1", at=0.0, speed=0.5, travel=0.6))
    with pytest.raises(ServoFault, match=r"elbow .module 1.: no limit_1 within 34.3"):
        find_home(made.arm, "elbow")
    assert made.seconds_to_rest() < 0.3
    assert made.modules[0].shaft + 8000 <= 0.6 * COUNTS_PER_RADIAN + 1
    assert made.arm.rezero_due == ("elbow",)
    assert made.modules[0].homing == 0  # the board would brake there in a later motion


@pytest.mark.parametrize("speed", [0.1, 0.5])
def test_a_hard_stop_right_behind_the_switch_does_not_keep_a_joint_from_homing(speed):
    made = homing_arm(HomePlan("limit_1", at=0.3, speed=speed, travel=2.0))
    made.modules[0].mechanics.upper_switch, made.modules[0].mechanics.upper_stop = 1000.0, 1003.0
    find_home(made.arm, "elbow")
    assert made.arm.rezero_due == ()
    assert made.arm.cycle().q[0] == pytest.approx(0.3, abs=5 / COUNTS_PER_RADIAN)
    for _ in range(40):
        made.arm.heartbeat()
        assert made.arm.cycle().valid.all()


@pytest.mark.parametrize("speed", [0.05, 0.5])
def test_a_hard_stop_before_the_switch_is_a_fault_and_does_not_leave_the_search_armed(speed):
    made = homing_arm(HomePlan("limit_1", at=0.3, speed=speed, travel=2.0))
    made.modules[0].mechanics.upper_stop = -7000.0
    begin = made.port.time
    words = r"elbow .module 1.: (blocked|position error).*It was looking for limit_1"
    with pytest.raises(ServoFault, match=words):
        find_home(made.arm, "elbow")
    assert made.port.time - begin < 1000.0 / (speed * COUNTS_PER_RADIAN) + 1.5
    assert made.modules[0].homing == 0
    assert made.arm.rezero_due == ("elbow",)


def test_a_joint_that_does_not_come_to_rest_at_its_mark_is_a_fault_in_time():
    made = homing_arm(HomePlan("limit_1", at=0.3, speed=0.2, travel=2.0))
    board = made.modules[0]
    board.mechanics.upper_switch = 1000.0
    original, begin = board.status, made.port.time

    def creep():
        status = original()
        swing = 0 if board.homing else round(3000.0 * made.port.time)
        return replace(status, position=status.position + swing)

    board.status = creep
    with pytest.raises(ServoFault, match=r"it found limit_1, but does not come to rest within 2 s"):
        find_home(made.arm, "elbow")
    assert made.port.time - begin < 10.0
    assert made.arm.rezero_due == ("elbow",)


def test_a_fault_after_the_mark_is_told_and_sets_no_zero():
    made = homing_arm(HomePlan("limit_1", at=0.3, speed=0.2, travel=2.0))
    board = made.modules[0]
    board.mechanics.upper_switch = 1000.0
    capture = board._capture_home

    def captured():
        capture()
        board.overload()

    board._capture_home = captured
    with pytest.raises((ServoFault, BusError), match="over-current"):
        find_home(made.arm, "elbow")
    assert made.arm.rezero_due == ("elbow",)
    assert not board.servo_on


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_a_search_that_is_interrupted_stops_and_does_not_stay_armed(error):
    made = homing_arm(HomePlan("limit_1", at=0.0, speed=0.5, travel=6.0))

    def interrupt(arm):
        if made.port.time > 3.0:
            raise error

    with pytest.raises(error):
        find_home(made.arm, "elbow", interrupt)
    assert made.seconds_to_rest() < 0.3
    assert made.modules[0].homing == 0
    assert made.modules[0].servo_on


def test_a_search_that_is_interrupted_before_it_moves_does_not_stay_armed(monkeypatch):
    made = homing_arm(HomePlan("limit_1", at=0.0, speed=0.5, travel=6.0))
    armed = []

    def interrupt():
        armed.append(made.modules[0].homing)
        raise KeyboardInterrupt

    monkeypatch.setattr(made.arm.axis("elbow"), "refresh", interrupt)
    with pytest.raises(KeyboardInterrupt):
        find_home(made.arm, "elbow")
    assert armed != [0]
    assert made.modules[0].homing == 0


def test_a_host_that_dies_while_homing_leaves_a_joint_that_stops(monkeypatch):
    made = homing_arm(HomePlan("limit_1", at=0.0, speed=0.5, travel=6.0))
    monkeypatch.setattr(homing, "_give_up", lambda *_: None)  # who is dead does not tidy up

    class HostDiedError(Exception):
        pass

    def die(arm):
        if made.port.time > 3.0:
            raise HostDiedError

    with pytest.raises(HostDiedError):
        find_home(made.arm, "elbow", die)
    assert made.modules[0].profile.velocity != 0
    assert made.seconds_to_rest() <= 0.3 + 0.5
    assert made.modules[0].homing != 0
    again = virtual_arm(made.modules, joints=("elbow",))
    again.arm.connect()
    assert again.modules[0].homing == 0  # it would brake there, and its zero would not be known


def test_homing_is_refused_where_it_makes_no_sense():
    made = homing_arm(HomePlan())
    with pytest.raises(ValueError, match="no mark to look for"):
        find_home(made.arm, "elbow")
    made.arm.trust_zero = True
    made.arm.move({"elbow": 1.0})
    with pytest.raises(ServoFault, match="moves: wait until it stands"):
        zero_here(made.arm, "elbow")
    marked = homing_arm(HomePlan("limit_1", at=0.0, speed=0.5, travel=6.0))
    marked.arm.release()
    with pytest.raises(ServoFault, match="not enabled"):
        find_home(marked.arm, "elbow")

"""An arm by the names of its joints: motions, limits, faults, and what stops it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import BusError, ServoFault
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.servos.pic_servo.simulated.module import SimulatedModule
from nico_selfmodel.servos.simulated.line import WireFaults

from ..slow_rest import slow_rest
from .arms import COUNTS_PER_TURN, JOINTS, virtual_arm

COUNTS_PER_RADIAN = COUNTS_PER_TURN / (2 * math.pi)


def sent_by(made):
    """Return the list to which every command that a module carries out is added."""
    commands = []
    for module in made.modules:
        original = module.execute

        def execute(command, module=module, original=original):
            commands.append((module.address, command))
            return original(command)

        module.execute = execute
    return commands


def test_an_arm_must_be_connected_first():
    made = virtual_arm()
    for action in (made.arm.enable, made.arm.cycle, made.arm.stop, made.arm.release):
        with pytest.raises(BusError, match="connect first"):
            action()
    assert not made.arm.state().valid.any()
    assert made.arm.state().to_mapping()["joints"]["right_elbow"]["reading_counts"] is None


def test_boards_that_are_wired_the_other_way_round_turn_the_other_way(virtual):
    virtual.arm.move({"right_elbow": 0.9})
    virtual.cycle_until_there()
    assert virtual.modules[3].position == -round(0.9 * COUNTS_PER_RADIAN)
    assert virtual.modules[4].position == 0


def test_joints_of_one_move_arrive_together(virtual):
    virtual.arm.move({"right_elbow": 1.2, "right_wrist": 0.1})
    done = {}
    while virtual.arm.moving:
        virtual.arm.heartbeat()
        state = virtual.arm.cycle()
        for name, moving in zip(state.joints, state.moving, strict=True):
            if not moving and name not in done:
                done[name] = virtual.port.time
    assert done["right_elbow"] == pytest.approx(done["right_wrist"], abs=0.15)


def test_a_slower_move_keeps_its_speed(virtual):
    virtual.arm.move({"right_elbow": 1.0}, speed=0.25)
    positions = []
    while virtual.arm.moving:
        virtual.arm.heartbeat()
        positions.append((virtual.port.time, virtual.arm.cycle().q[3]))
    times, q = np.array(positions).T
    speeds = np.diff(q) / np.diff(times)
    assert np.median(speeds) == pytest.approx(0.25, rel=0.05)
    assert speeds.max() < 0.3


def test_the_self_model_gives_the_angles():
    one = np.ones(1)
    servos = ServoMap(
        ("right_elbow",), 0.2 * one, 1.25 * one, ("counts",), COUNTS_PER_TURN * one, -one
    )
    made = virtual_arm(servos=servos)
    made.arm.connect()
    made.arm.enable()
    low, high = made.arm.limits.positions[3]
    assert (low, high) == pytest.approx(((-np.pi / 2 - 0.2) / 1.25, (np.pi / 2 - 0.2) / 1.25))
    assert made.arm.limits.speeds[3] == pytest.approx(math.radians(60) / 1.25)
    made.arm.move({"right_elbow": 0.5})
    made.cycle_until_there()
    state = made.arm.cycle()
    assert state.q[3] == pytest.approx(0.5, abs=1e-4)
    assert state.readings[3] == pytest.approx(servos.to_encoder([0.5])[0], abs=1)


@pytest.mark.parametrize(
    ("targets", "words"),
    [
        ({"right_elbow": float("nan")}, ("right_elbow", "finite", "nan")),
        ({"right_elbow": float("inf")}, ("right_elbow", "finite")),
        ({"right_elbow": 1.6}, ("right_elbow cannot go to 91.7 deg", "-90.0 to 90.0 deg")),
        ({"right_elbow": 1.0, "right_wrist": -2.0}, ("right_wrist cannot go to -114.6 deg",)),
        ({"left_knee": 0.0}, ("left_knee", "right_elbow")),
    ],
)
def test_a_bad_target_is_refused_and_nothing_moves(virtual, targets, words):
    commands = sent_by(virtual)
    with pytest.raises(ValueError, match=words[0]) as caught:
        virtual.arm.move(targets)
    assert all(word in str(caught.value) for word in words)
    assert commands == []
    with pytest.raises(ValueError, match="finite"):
        virtual.arm.command([0, 0, 0, float("nan"), 0, 0])
    with pytest.raises(ValueError, match=r"shape \(6,\), got \(5,\)"):
        virtual.arm.command(np.zeros(5))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"speed": 1.2}, "speed must be at most 1.05 rad/s"),
        ({"speed": 0.0}, "speed must be a positive number"),
        ({"speed": float("nan")}, "speed must be a positive number"),
        ({"acceleration": 5.0}, "acceleration must be at most 4.19"),
        ({"acceleration": 1.0}, "too little to stop in time from 1.05 rad/s"),
    ],
)
def test_a_speed_beyond_its_limit_is_refused(virtual, options, words):
    with pytest.raises(ValueError, match=words):
        virtual.arm.move({"right_elbow": 0.1}, **options)


def test_the_limits_themselves_can_be_reached(virtual):
    low, high = virtual.arm.limits.positions[5]
    for target in (low, high):
        virtual.arm.move({"right_wrist": target})
        virtual.cycle_until_there()


def test_poses_are_refused_until_the_zero_is_known():
    made = virtual_arm(trust_zero=False)
    assert made.arm.connect() == JOINTS
    made.arm.enable()
    for action in (
        lambda: made.arm.move({"right_elbow": 0.1}),
        lambda: made.arm.command([0.0] * 6),
    ):
        with pytest.raises(ServoFault, match=r"rezero is due: .*right_elbow"):
            action()
    assert np.isnan(made.arm.state().q).all()
    assert made.arm.state().valid.all()  # the readings are good
    made.arm.trust_zero = True
    made.arm.move({"right_elbow": 0.1})
    made.cycle_until_there()


def test_a_joint_that_is_not_enabled_does_not_move():
    made = virtual_arm()
    made.arm.connect()
    made.arm.enable(["right_wrist"])
    with pytest.raises(ServoFault, match=r"right_elbow .module 4. is not enabled"):
        made.arm.move({"right_elbow": 0.1})
    made.arm.move({"right_wrist": 0.1})
    made.cycle_until_there()
    assert [module.amplifier for module in made.modules] == [False] * 5 + [True]


def test_enabling_sends_mode_and_gains_before_the_amplifier_is_on():
    made = virtual_arm()
    made.arm.connect()
    commands = sent_by(made)
    made.arm.enable(["right_elbow"])
    names = [type(command).__name__ for address, command in commands if address == 4]
    assert names[:4] == ["IoControl", "SetGain", "StopMotor", "StopMotor"]
    assert {address for address, _ in commands} == {4}


def test_a_failed_enable_switches_off_what_it_switched_on():
    made = virtual_arm()
    made.arm.connect()
    made.modules[3].silent = True
    with pytest.raises(BusError, match="module 4"):
        made.arm.enable()
    assert not any(module.amplifier for module in made.modules)
    assert not made.arm.state().enabled.any()


def test_stop_brakes_every_joint_and_holds(virtual):
    virtual.arm.move(dict.fromkeys(JOINTS, 1.5))
    for _ in range(5):
        virtual.arm.heartbeat()
        virtual.arm.cycle()
    virtual.arm.stop()
    assert virtual.seconds_to_rest() < 0.3
    assert all(0.1 < abs(s) < 1.2 * COUNTS_PER_RADIAN for s in virtual.shafts())
    assert all(module.servo_on for module in virtual.modules)
    assert not virtual.arm.cycle().moving.any()


def test_release_lets_go_of_what_it_names(virtual):
    virtual.arm.release(["right_elbow"])
    assert [module.amplifier for module in virtual.modules] == [True] * 3 + [False] + [True] * 2
    virtual.modules[3].shaft += 5000.0  # somebody pushes it
    state = virtual.arm.cycle()
    assert not state.enabled[3]
    assert state.readings[3] == -5000.0


def test_no_goal_ever_lies_further_ahead_than_the_heartbeat(virtual):
    commands = sent_by(virtual)
    virtual.arm.move(dict.fromkeys(JOINTS, 1.5))
    speed, braking = math.radians(60), math.radians(60) ** 2 / math.radians(240) / 2
    reach = (speed * 0.3 + braking) * COUNTS_PER_RADIAN
    furthest = 0.0
    while virtual.arm.moving:
        before = [module.position for module in virtual.modules]
        virtual.arm.heartbeat()
        virtual.arm.cycle()
        for address, command in commands:
            if type(command).__name__ == "LoadTrajectory" and command.position is not None:
                furthest = max(furthest, abs(command.position - before[address - 1]))
        commands.clear()
    assert 0.5 * reach < furthest <= reach + 1


def blocked(module):
    module.mechanics.stuck = True


def overloaded(module):
    module.overload()


def without_power(module):
    module.motor_power = False


@pytest.mark.parametrize(
    ("trouble", "words"),
    [
        (blocked, "position error above 4000 counts: the joint is blocked"),
        (overloaded, "over-current: something blocks the joint"),
        (without_power, "no motor power: emergency stop?"),
    ],
)
def test_a_fault_stops_the_others_and_says_what_to_do(virtual, trouble, words):
    virtual.arm.move(dict.fromkeys(JOINTS, 1.2))
    virtual.arm.cycle()
    trouble(virtual.modules[3])
    with pytest.raises(ServoFault, match=rf"right_elbow .module 4.: ({words})") as caught:
        virtual.cycle_until_there()
    assert "enable" in str(caught.value)
    assert "The other joints were stopped" in str(caught.value)
    assert virtual.seconds_to_rest() < 0.5
    state = virtual.arm.cycle()
    assert state.trouble[3] is not None
    assert list(state.enabled) == [True] * 3 + [False] + [True] * 2
    virtual.modules[3].mechanics.stuck, virtual.modules[3].motor_power = False, True
    virtual.arm.enable(["right_elbow"])
    virtual.arm.move(dict.fromkeys(JOINTS, 0.3))
    virtual.cycle_until_there()
    assert virtual.arm.cycle().q == pytest.approx(np.full(6, 0.3), abs=1e-4)


def test_a_servo_that_went_off_is_noticed_where_the_joint_stands(virtual):
    virtual.modules[3].profile.switch_off()
    with pytest.raises(ServoFault, match=r"right_elbow .module 4.: position error"):
        virtual.arm.cycle()


def test_every_axis_is_stopped_though_two_cannot_be(virtual):
    virtual.arm.move(dict.fromkeys(JOINTS, 1.5))
    virtual.arm.cycle()
    virtual.modules[0].silent = virtual.modules[4].silent = True
    with pytest.raises(BusError, match=r"module 1.*module 5"):
        virtual.arm.stop()
    assert virtual.seconds_to_rest() < 0.5
    with pytest.raises(BusError, match=r"module 1.*module 5"):
        virtual.arm.release()
    assert not any(module.amplifier for module in virtual.modules)


def test_a_board_that_lost_its_power_is_missed_and_not_reset(virtual):
    virtual.modules[5].power_cycle()
    with pytest.raises(BusError, match=r"right_wrist \(module 6\) is lost"):
        virtual.arm.cycle()
    assert [module.address for module in virtual.modules] == [1, 2, 3, 4, 5, 0]
    assert all(module.servo_on for module in virtual.modules[:5])


def test_a_joint_that_missed_the_common_start_moves_all_the_same(virtual):
    rng = np.random.default_rng(0)
    original = virtual.bus.send

    def lose(address, command):
        virtual.line.faults = WireFaults(rng, drop=1.0)
        original(address, command)
        virtual.line.faults = None

    virtual.bus.send = lose
    virtual.arm.move({"right_elbow": 1.2, "right_wrist": 0.002})
    virtual.cycle_until_there()
    assert virtual.arm.cycle().q[[3, 5]] == pytest.approx([1.2, 0.002], abs=1e-4)


def test_a_jump_of_the_position_is_believed_only_when_it_is_seen_twice(virtual):
    module = virtual.modules[3]
    original, lies = module.status, [7000]

    def lie():
        status = original()
        return replace(status, position=lies.pop()) if lies else status

    module.status = lie
    assert virtual.arm.cycle().readings[3] == 0.0
    assert virtual.bus.counts[4].implausible == 1


def test_positions_that_never_agree_are_an_error(virtual):
    module = virtual.modules[3]
    original, count = module.status, [0]

    def lie():
        count[0] += 1
        return replace(original(), position=100_000 * count[0])

    module.status = lie
    with pytest.raises(BusError, match="contradict each other"):
        virtual.arm.cycle()


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda m: m.clear(), "no module answers on simulated: are the boards switched on"),
        (lambda m: m.pop(), r"5 of 6 modules answer; missing: right_wrist \(module 6\)"),
        (
            lambda m: m.__setitem__(1, SimulatedModule(device_type=2)),
            "module 2 is a PIC-IO version 10, but right_shoulder_roll needs a PIC-SERVO",
        ),
        (
            lambda m: m.__setitem__(1, SimulatedModule(version=5)),
            "PIC-SERVO version 5: goals that move on need version 10",
        ),
        (
            lambda m: m.__setitem__(1, SimulatedModule(version=21)),
            "PIC-SERVO version 21: what its output modes mean is known of versions 10 to 20",
        ),
    ],
)
def test_a_wrong_set_of_boards_is_explained(spoil, words):
    modules = [SimulatedModule() for _ in range(6)]
    spoil(modules)
    made = virtual_arm(modules or [SimulatedModule(device_type=9)])
    if not modules:
        made.line.broken_after = 0
    with pytest.raises(BusError, match=words):
        made.arm.connect()


@pytest.mark.parametrize("earlier", [9600, 19200, 57600, 115200])
def test_boards_are_found_at_another_rate_and_brought_to_the_right_one(earlier):
    made = virtual_arm(baud=57600)
    if earlier == 9600:  # never used by us
        for module in made.modules:
            module.baud = earlier
        with pytest.raises(BusError, match="no module answers"):
            made.arm.connect()
        return
    if earlier != 19200:
        virtual_rate = virtual_arm(made.modules, baud=earlier)
        virtual_rate.arm.connect()
    made.arm.connect()
    assert {module.baud for module in made.modules} == {57600}
    assert made.bus.rate == 57600


def test_closing_stops_what_moves_and_goes_on_holding(virtual):
    virtual.arm.move({"right_elbow": 1.5})
    virtual.arm.cycle()
    with virtual.arm:
        pass
    assert virtual.seconds_to_rest() < 0.3
    assert all(module.servo_on for module in virtual.modules)


def test_an_outside_plant_moves_the_shafts():
    """A plant that lags behind its servos: what the encoders say is what the plant says."""
    made = virtual_arm()
    counts = np.zeros(6)
    asked = []

    def plant(time, commanded):
        nonlocal counts
        asked.append(time)
        held = ~np.isnan(commanded)
        counts = np.where(held, counts + 0.2 * (np.where(held, commanded, 0.0) - counts), counts)
        return np.round(counts)

    made.line.plant = plant
    for module in made.modules:
        module.external = True
    made.arm.connect()
    made.arm.enable()
    made.arm.move({"right_elbow": 0.5}, speed=0.3)
    made.cycle_until_there()
    for _ in range(20):
        made.arm.cycle()
    assert made.arm.cycle().q[3] == pytest.approx(0.5, abs=3 / COUNTS_PER_RADIAN)
    assert min(np.diff(asked)) >= made.line.plant_period - 1e-9


def test_most_cycles_of_a_moving_arm_only_read_and_the_motion_takes_no_longer():
    """At 19200 baud a goal in every cycle would cost the wire 107 bytes instead of 85."""
    made = virtual_arm(baud=19200)
    made.arm.connect()
    made.arm.enable()
    sent, begin, cycles = sent_by(made), made.port.time, 0
    expected = made.arm.move(dict.fromkeys(JOINTS, 1.4), speed=0.5)
    sent.clear()
    while made.arm.moving:
        made.arm.heartbeat()
        made.arm.cycle()
        cycles += 1
    goals = sum(type(command).__name__ == "LoadTrajectory" for _, command in sent)
    assert goals < 0.4 * 6 * cycles
    assert made.port.time - begin == pytest.approx(expected, abs=0.25)
    assert cycles / (made.port.time - begin) > 20.0


def test_a_joint_with_a_fault_stays_off_when_the_others_are_stopped(virtual):
    virtual.arm.move(dict.fromkeys(JOINTS, 0.5))
    virtual.port.sleep(0.2)
    virtual.modules[2].overload()
    with pytest.raises(ServoFault, match="over-current"):
        virtual.cycle_until_there()
    virtual.port.sleep(0.5)
    assert [module.servo_on for module in virtual.modules] == [True, True, False, True, True, True]


def test_a_joint_that_holds_with_a_fault_can_be_connected_and_enabled_again(virtual):
    elbow = virtual.modules[3]
    elbow.overload()
    virtual.arm.axis("right_elbow").motor.board.hold()  # as an earlier program may have left it
    assert virtual.arm.connect() is not None
    state = virtual.arm.cycle()
    assert state.enabled.tolist() == [True, True, True, False, True, True]
    virtual.arm.enable()
    virtual.arm.move({"right_elbow": 0.2})
    virtual.cycle_until_there()
    assert virtual.arm.cycle().enabled.all()


@pytest.mark.parametrize("seed", slow_rest(range(8)))
def test_a_host_that_dies_after_any_motions_leaves_an_arm_that_stops_in_time(seed):
    """Also where a fast motion was just replaced by a slow one, ahead of the joint or behind it."""
    rng = np.random.default_rng((3, seed))
    heartbeat = float(rng.choice([0.1, 0.3]))
    made = virtual_arm(heartbeat=heartbeat, baud=int(rng.choice([19200, 115200])))
    made.arm.connect()
    made.arm.enable()
    for _ in range(6):
        for _ in range(rng.integers(1, 4)):
            speed = float(np.exp(rng.uniform(np.log(0.01), np.log(1.0))))
            targets = {name: float(rng.uniform(-1.5, 1.5)) for name in JOINTS}
            made.arm.move(targets, speed=speed)
            for _ in range(rng.integers(0, 12)):
                made.arm.heartbeat()
                made.arm.cycle()
        assert made.seconds_to_rest() <= heartbeat + 0.5
        assert max(map(abs, made.shafts())) <= 1.58 * COUNTS_PER_RADIAN
        made.arm.connect()


def test_a_fast_joint_that_is_to_go_on_slowly_never_turns_round(virtual):
    virtual.arm.move({"right_wrist": 1.5})
    for _ in range(8):
        virtual.arm.heartbeat()
        virtual.arm.cycle()
    shafts = [virtual.shafts()[5]]
    virtual.arm.move({"right_wrist": 1.5}, speed=0.05)
    for _ in range(20):
        virtual.arm.heartbeat()
        virtual.arm.cycle()
        shafts.append(virtual.shafts()[5])
    way = -np.diff(shafts)  # it is wired the other way round
    assert way.min() > -10.0
    assert way[-5:] == pytest.approx(way[-1], rel=0.1)

"""A joint that is blocked is noticed at any speed, and one that is healthy is never blamed."""

import math

import numpy as np
import pytest

from nico_selfmodel.errors import ServoFault
from nico_selfmodel.servos.bus_settings import BusSettings

from ..slow_rest import slow_rest
from .arms import JOINTS, virtual_arm
from .mechanics import DEGREE, Mechanics

LONGEST = 1.5
"""From the jam until every joint stands [s]."""
NOTICED = 0.35
"""A joint that is blocked nearer to its goal than this need not be noticed [deg]."""


def arm_of(**options):
    """Return an arm in virtual time that is connected and enabled."""
    made = virtual_arm(**options)
    made.arm.connect()
    made.arm.enable()
    return made


def jam(made, joint, when, speed, targets, *, of_travel=False):
    """Move, jam a joint at a share of the planned time or way, and wait for what comes of it.

    Returns:
        How far the joint still had to go [deg], the error and the time from the jam until every
        joint stands [s]; None for both where nobody noticed.
    """
    seconds = made.arm.move(targets, speed=math.radians(speed))
    begin, goal, start = made.port.time, made.arm.axes[joint].goals.goal, made.shafts()[joint]
    jammed, left = None, math.nan

    def due():
        if of_travel:
            return abs(made.shafts()[joint] - start) >= when * abs(goal - start)
        return made.port.time >= begin + when * seconds

    try:
        while made.port.time < begin + seconds + 3.0:
            if jammed is None and due():
                left = abs(goal - made.shafts()[joint]) / DEGREE
                made.modules[joint].mechanics.stuck, jammed = True, made.port.time
            made.arm.heartbeat()
            made.arm.cycle()
    except ServoFault as error:
        return left, error, made.port.time - jammed + made.seconds_to_rest()
    return left, None, None


def check_jam(made, joint, when, speed, targets, **options):
    left, error, seconds = jam(made, joint, when, speed, targets, **options)
    if left <= NOTICED:
        return
    assert error is not None, f"{speed:.1f} deg/s, at {when:.2f}: {left:.2f} deg left, not noticed"
    assert str(error).startswith(f"{JOINTS[joint]} (module {joint + 1}): ")
    assert "other joints were stopped" in str(error)
    assert seconds < LONGEST
    state = made.arm.cycle()
    assert state.trouble[joint] is not None
    assert not state.valid[joint]
    assert state.enabled.tolist() == [k != joint for k in range(len(JOINTS))]
    assert not state.moving.any()


@pytest.mark.parametrize("speed", slow_rest([60.0, 2.0, 6.0, 10.0, 20.0, 30.0]))
@pytest.mark.parametrize(("joint", "when"), [(3, 0.5), (0, 0.0), (5, 0.9)])
def test_a_joint_that_jams_is_a_fault_at_any_speed(speed, joint, when):
    travel = math.radians(5.0 + 0.5 * speed)
    check_jam(arm_of(baud=115200), joint, when, speed, {JOINTS[joint]: travel})


@pytest.mark.slow
@pytest.mark.parametrize("speed", [2.0, 5.0, 10.0, 20.0, 30.0, 45.0, 60.0])
@pytest.mark.parametrize("when", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("joint", range(6))
def test_each_joint_that_jams_among_others_that_move_is_a_fault(joint, when, speed):
    travel = math.radians(20.0)
    targets = {name: travel * (-1.0) ** k for k, name in enumerate(JOINTS)}
    check_jam(arm_of(baud=115200), joint, when, speed, targets, of_travel=True)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(60))
def test_any_joint_that_jams_at_any_time_is_a_fault(seed):
    rng = np.random.default_rng((28, seed))
    made = arm_of(
        baud=int(rng.choice([19200, 115200])),
        heartbeat=float(rng.choice([0.1, 0.3, 0.6])),
        settings=BusSettings(latency=float(rng.choice([1e-3, 16e-3]))),
    )
    speed = float(np.exp(rng.uniform(np.log(2.0), np.log(60.0))))
    travel = rng.uniform(2.0, 5.0 + speed)
    others = rng.random(len(JOINTS)) < rng.choice([0.0, 0.5, 1.0])
    joint = int(rng.integers(len(JOINTS)))
    targets = {
        name: math.radians(travel) * (-1.0) ** k
        for k, name in enumerate(JOINTS)
        if k == joint or others[k]
    }
    check_jam(made, joint, float(rng.uniform(0.0, 1.0)), speed, targets)


def cycles(made, seconds):
    until = made.port.time + seconds
    while made.port.time < until:
        made.arm.heartbeat()
        made.arm.cycle()


def swing(made, amplitude, frequency, seconds, speed=None, jammed_from=math.inf):
    """Stream goals that swing; return when it ended."""
    begin = made.port.time
    while (t := made.port.time - begin) < seconds:
        made.modules[3].mechanics.stuck = t > jammed_from
        made.arm.command(np.full(6, amplitude * math.sin(frequency * t)), speed=speed)
        made.arm.cycle()


def test_a_joint_that_jams_while_a_stream_of_goals_pulls_it_is_a_fault(virtual):
    begin = virtual.port.time
    with pytest.raises(ServoFault, match=r"right_elbow .module 4.: blocked"):
        swing(virtual, 0.1, 0.7, 20.0, speed=0.2, jammed_from=4.0)
    assert virtual.port.time - begin < 4.0 + LONGEST


def test_a_joint_that_jams_while_its_goals_go_to_and_fro_is_a_fault(virtual):
    with pytest.raises(ServoFault, match=r"right_elbow .module 4.: blocked"):
        swing(virtual, 0.05, 6.0, 5.0, jammed_from=0.0)


def test_a_joint_that_jams_counts_as_moving_until_it_is_a_fault(virtual):
    """Else whoever waits for the end of a motion takes a joint that is blocked for one there."""
    virtual.arm.move({"right_elbow": math.radians(20.0)}, speed=math.radians(20.0))
    cycles(virtual, 0.8)
    virtual.modules[3].mechanics.stuck = True
    with pytest.raises(ServoFault, match=r"right_elbow .module 4.: blocked"):
        virtual.cycle_until_there()


def with_mechanics(made, seed=0, **options):
    """Hang healthy mechanics on an arm."""
    plant = Mechanics(len(made.modules), np.random.default_rng(seed), **options)
    made.line.plant = plant
    for module in made.modules:
        module.external = True
    return plant


@pytest.mark.slow
def test_a_joint_that_is_too_weak_to_arrive_in_time_is_a_fault():
    made = virtual_arm(baud=115200)
    share = np.full(6, np.nan)
    with_mechanics(made, share=share)
    made.arm.connect()
    made.arm.enable()
    share[3] = 0.7
    seconds = made.arm.move({"right_elbow": 1.2}, speed=math.radians(10.0))
    begin = made.port.time
    with pytest.raises(ServoFault, match=r"right_elbow .module 4.: .* over 0.5 s ago"):
        made.cycle_until_there(40.0)
    assert made.port.time - begin == pytest.approx(1.02 * seconds + 0.5, abs=0.2)


@pytest.mark.slow
def test_a_joint_that_stays_behind_by_its_load_gets_on_at_any_speed():
    """A goal reckoned from where such a joint stands would lie behind it."""
    made = virtual_arm(baud=115200)
    with_mechanics(made, load=900.0)
    made.arm.connect()
    made.arm.enable()
    expected = made.arm.move(dict.fromkeys(JOINTS, 0.2), speed=math.radians(2.0))
    assert made.cycle_until_there() == pytest.approx(expected, abs=0.25)
    assert made.arm.cycle().q == pytest.approx(np.full(6, 0.2), abs=900.0 / DEGREE * np.pi / 180)


HEALTHY = {
    "exact": {},
    "noise": {"noise": 3.0},
    "load": {"load": 300.0},
    "lag": {"lag": 0.08},
    "friction": {"friction": 0.29 * DEGREE},
    "all": {"noise": 2.0, "load": 200.0, "lag": 0.05, "friction": 0.25 * DEGREE},
}


def any_motion(made, rng):
    """Do one of the things that programs do with an arm."""
    chosen = rng.choice(JOINTS, rng.integers(1, 7), replace=False)
    speed = math.radians(float(np.exp(rng.uniform(np.log(1.0), np.log(60.0)))))
    reach = math.radians(float(np.exp(rng.uniform(np.log(0.05), np.log(60.0)))))
    q = np.nan_to_num(made.arm.state().q)
    goals = np.clip(q + rng.uniform(-reach, reach, 6), -1.4, 1.4)
    targets = {name: goals[JOINTS.index(name)] for name in chosen}
    what = rng.choice(["wait", "supersede", "stop", "stream", "still"], p=[0.4, 0.2, 0.1, 0.2, 0.1])
    if what == "still":
        cycles(made, 2.0)
    elif what == "stream":
        begin, way = made.port.time, rng.uniform(-0.3, 0.3, 6)
        while (t := made.port.time - begin) < 3.0:
            made.arm.command(np.clip(q + way * math.sin(rng.uniform(0.5, 4.0) * t), -1.5, 1.5))
            made.arm.cycle()
    else:
        seconds = made.arm.move(targets, speed=speed)
        cycles(made, min(6.0, seconds + 1.5 if what == "wait" else rng.uniform(0.0, seconds)))
        if what == "stop":
            made.arm.stop(smoothly=bool(rng.random() < 0.5))


def soak(kind, seed, seconds, **options):
    made = virtual_arm(**options)
    with_mechanics(made, seed, **HEALTHY[kind])
    made.arm.connect()
    made.arm.enable()
    rng = np.random.default_rng((5, seed))
    while made.port.time < seconds:
        any_motion(made, rng)
    return made


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["exact", "all"])
def test_a_healthy_joint_is_never_blamed(kind):
    assert soak(kind, 0, 8.0, baud=115200).arm.state().valid.all()


@pytest.mark.slow
@pytest.mark.parametrize("kind", HEALTHY)
@pytest.mark.parametrize("seed", range(1, 5))
def test_a_healthy_joint_is_never_blamed_for_long(kind, seed):
    baud, heartbeat = (19200, 0.3) if seed % 2 else (115200, 0.1)
    assert soak(kind, seed, 300.0, baud=baud, heartbeat=heartbeat).arm.state().valid.all()


def test_a_joint_whose_host_is_slow_is_not_blamed(virtual):
    """It stops whenever its goals end; that is not its fault."""
    seconds = virtual.arm.move(dict.fromkeys(JOINTS, 0.9), speed=0.3)
    begin = virtual.port.time
    while virtual.arm.moving:
        virtual.arm.heartbeat()
        virtual.arm.cycle()
        virtual.port.sleep(0.6)
    assert virtual.port.time - begin > seconds + 1.0


@pytest.mark.slow
@pytest.mark.parametrize("counts", [1, 5, 30, 160])
def test_a_move_too_short_for_friction_to_let_through_is_not_a_fault(counts):
    made = virtual_arm(baud=115200)
    with_mechanics(made, friction=0.29 * DEGREE)
    made.arm.connect()
    made.arm.enable()
    for way in (1.0, -1.0, 1.0):
        made.arm.move(dict.fromkeys(JOINTS, way * counts / DEGREE * math.pi / 180.0))
        cycles(made, 2.5)
    assert made.arm.state().valid.all()

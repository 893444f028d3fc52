"""The thread that keeps an arm going."""

import threading
import time

import numpy as np
import pytest

from nico_selfmodel.errors import BusError, RobotError, ServoFault
from nico_selfmodel.servos import ArmController, ArmLoop
from nico_selfmodel.servos.ports import PortLostError

from .arms import JOINTS, SOON, configuration, stopped, wait_for


def test_a_loop_reads_and_moves_while_others_do_something_else(loop):
    first = loop.state()
    assert first.valid.all()
    target = np.array([0.1, -0.1, 0.05, 0.2, 0.0, -0.05])
    wait_for(lambda: loop.command(target) or (not loop.state().moving.any() and _at(loop, target)))
    assert loop.cycles > 5


def _at(loop, target):
    return np.allclose(loop.state().q, target, atol=1e-3)


def test_handing_over_a_command_takes_no_time(loop):
    q, times = np.zeros(6), []
    for _ in range(50):
        begin = time.perf_counter()
        loop.command(q)
        loop.state()
        times.append(time.perf_counter() - begin)
        time.sleep(0.002)
    assert np.median(times) < 1e-3


def test_a_program_that_hangs_stops_the_arm(loop, bus):
    loop.move({"right_elbow": 1.2})
    begin = time.monotonic()
    stopped(bus)
    assert time.monotonic() - begin < 0.3 + 0.5 + 1.0
    assert abs(bus.shafts()[3]) < 0.9 * 1.2 * 31831
    assert loop.state().valid.all()


def test_bad_commands_are_refused_before_they_are_handed_over(loop):
    with pytest.raises(ValueError, match=r"shape \(6,\)"):
        loop.command(np.zeros(3))
    with pytest.raises(ValueError, match="right_elbow cannot go to"):
        loop.command([0, 0, 0, 9, 0, 0])
    with pytest.raises(ValueError, match="finite"):
        loop.move({"right_elbow": float("nan")})
    loop.check()


def test_a_stop_has_the_last_word_over_a_command_that_was_just_handed_over(loop, bus):
    for target in (1.0, -1.0, 1.0):
        loop.command(np.full(6, target))
        loop.stop()
        assert stopped(bus) < 0.3
        assert not loop.state().moving.any()
    assert np.abs(bus.shafts()).max() < 1000.0


def test_who_waits_for_a_stop_hears_at_once_that_a_command_ended_the_thread(loop, bus):
    loop.call(lambda arm: arm.release(["right_elbow"]))
    begin = time.monotonic()
    loop.command(np.zeros(6))
    with pytest.raises(RobotError):
        loop.stop()
    assert time.monotonic() - begin < SOON
    with pytest.raises(ServoFault, match=r"right_elbow .* is not enabled"):
        loop.check()
    assert stopped(bus) < 0.3


def test_a_pulled_cable_is_raised_with_its_cause_within_a_second(loop, bus):
    loop.move({"right_elbow": 1.2})
    bus.unplug()
    begin = time.monotonic()
    with pytest.raises(PortLostError, match="plug the adapter in again") as caught:
        wait_for(lambda: loop.heartbeat() or loop.state() is None)
    assert time.monotonic() - begin < 1.0
    assert isinstance(caught.value.__cause__, PortLostError)
    with pytest.raises(PortLostError):
        loop.command(np.zeros(6))
    loop.close()  # cleanly
    assert not any(thread.name == "arm loop" for thread in threading.enumerate())


def test_a_lost_module_is_raised_and_named(loop, bus):
    loop.move(dict.fromkeys(JOINTS, 1.0))
    with bus.lock:
        bus.modules[2].silent = True
    with pytest.raises(BusError, match=r"right_upper_arm_twist \(module 3\) is lost"):
        wait_for(lambda: loop.heartbeat() or loop.state() is None)
    assert stopped(bus) < 0.8


@pytest.mark.slow
@pytest.mark.parametrize("speed", [2.0, 10.0])
def test_a_joint_that_jams_is_raised_and_named_and_all_joints_stop(loop, bus, speed):
    loop.move(dict.fromkeys(JOINTS, 0.6), speed=np.radians(speed))
    until = time.monotonic() + 0.7
    wait_for(lambda: loop.heartbeat() or time.monotonic() > until)
    with bus.lock:
        bus.modules[2].mechanics.stuck = True
    begin = time.monotonic()
    with pytest.raises(ServoFault, match=r"right_upper_arm_twist \(module 3\): blocked"):
        wait_for(lambda: loop.heartbeat() or loop.state() is None)
    assert time.monotonic() - begin + stopped(bus) < 1.5


def test_what_a_caller_does_wrong_does_not_end_the_loop(loop):
    loop.call(lambda arm: arm.release(["right_elbow"]))
    with pytest.raises(ServoFault, match="not enabled"):
        loop.move({"right_elbow": 0.1})
    loop.check()
    loop.close()
    with pytest.raises(BusError, match="has ended"):
        loop.move({"right_wrist": 0.1})


def test_a_loop_that_is_not_connected_says_so(bus):
    arm = ArmController.open(bus.name, configuration(baud=115200))
    loop = ArmLoop(arm)
    with pytest.raises(BusError, match="connect first"):
        loop.start()
    loop.close()


def test_whoever_started_or_stopped_a_motion_is_told_so_by_the_next_state(loop):
    for _ in range(5):
        loop.move({"right_elbow": 0.5}, speed=0.2)
        assert loop.state().moving[3]
        loop.stop()
        assert not loop.state().moving.any()

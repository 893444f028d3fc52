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


class Sluggish:
    """A driver whose cycle does not end before it is let go on, once it was told to hang."""

    def __init__(self, arm):
        self._arm = arm
        self.hangs, self.begun, self.goes_on = (threading.Event() for _ in range(3))

    def __getattr__(self, name):
        return getattr(self._arm, name)

    def cycle(self):
        if self.hangs.is_set():
            self.begun.set()
            self.goes_on.wait(SOON)
        self._arm.heartbeat()
        return self._arm.cycle()


@pytest.fixture
def sluggish(bus, monkeypatch):
    """Return a loop whose driver hangs in a cycle for longer than it is waited for."""
    monkeypatch.setattr("nico_selfmodel.servos.arm_loop._PATIENCE", 0.1)
    with ArmController.open(bus.name, configuration(baud=115200), trust_zero=True) as arm:
        arm.connect()
        arm.enable()
        loop = ArmLoop(Sluggish(arm), 0.02)
        loop.start(SOON)
        loop.arm.hangs.set()
        assert loop.arm.begun.wait(SOON)
        yield loop
        loop.arm.goes_on.set()
        loop.close()


def run_on(loop):
    """Let the driver go on, and do a few cycles."""
    loop.arm.goes_on.set()
    cycles = loop.cycles
    wait_for(lambda: loop.cycles > cycles + 3)


def test_what_was_told_to_come_too_late_is_not_done_later(sluggish, bus):
    with pytest.raises(BusError, match=r"within 0\.1 s: .*nothing was sent, try again"):
        sluggish.move({"right_elbow": 1.0})
    run_on(sluggish)
    assert not sluggish.state().moving.any()
    assert max(map(abs, bus.shafts())) == 0


def test_a_stop_that_comes_late_is_a_stop_all_the_same(sluggish):
    done = []
    with pytest.raises(BusError, match="may still be done"):
        sluggish.call(lambda arm: done.append(arm.stop()), however_late=True)
    with pytest.raises(BusError, match="may still be done"):
        sluggish.stop()
    run_on(sluggish)
    assert done == [None]


def test_what_was_begun_in_time_is_told_as_such(loop, monkeypatch):
    monkeypatch.setattr("nico_selfmodel.servos.arm_loop._PATIENCE", 1.0)
    told = threading.Event()
    with pytest.raises(BusError, match="may still be done, see where the joints stand"):
        loop.call(lambda arm: told.wait(SOON))
    told.set()


def test_an_end_that_comes_before_a_job_that_was_given_up_is_no_failure(sluggish):
    with pytest.raises(BusError, match="nothing was sent"):
        sluggish.move({"right_elbow": 1.0})
    sluggish.arm.goes_on.set()
    sluggish.close()
    assert not any(thread.name == "arm loop" for thread in threading.enumerate())

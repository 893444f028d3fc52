"""What a servo driver costs a diagram while its bus thread is busy."""

import math
import time

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import EventStatus, LeafSystem

from nico_selfmodel.servos import JointServo, ServoConfig, SimulatedBus
from nico_selfmodel.servos.arm_state import ArmState
from nico_selfmodel.systems.hardware.servo_driver import ServoDriver

pytestmark = pytest.mark.benchmark
PERIOD = 0.01
UPDATES = 300


class FixedArm(LeafSystem):
    """The peer: the same two events with nothing behind them, what Drake itself asks for."""

    def __init__(self, n):
        super().__init__()
        self._rows = np.zeros(len(ArmState.ROWS) * n)
        self._command = self.DeclareVectorInputPort("encoders_commanded", n)
        self.DeclareDiscreteState(self._rows)
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, 0.0, self._copy)
        self.DeclarePeriodicPublishEvent(PERIOD, 0.0, self._look)

    def _copy(self, context, update):
        update.set_value(self._rows)
        return EventStatus.Succeeded()

    def _look(self, context):
        assert self._command.HasValue(context)
        self._command.Eval(context)
        return EventStatus.Succeeded()


def ready(system):
    simulator = Simulator(system)
    system.get_input_port().FixValue(
        simulator.get_mutable_context(), np.full(6, 1.5 * 2e5 / math.tau)
    )
    simulator.Initialize()
    return simulator


def timed_update(simulator, k):
    start = time.perf_counter()
    simulator.AdvanceTo(PERIOD * k)  # one update, and one command handed over
    return time.perf_counter() - start


def test_an_update_takes_little_more_than_two_events_that_do_nothing(benchmark):
    turn = math.radians
    joints = [
        JointServo(f"joint_{k}", k, 2e5, turn(-90), turn(90), turn(60), turn(240))
        for k in range(1, 7)
    ]
    config = ServoConfig("six", tuple(joints), baud=115200)
    with (
        SimulatedBus(6, latency=1e-3) as bus,
        ServoDriver(bus.name, config, trust_zero=True, speed=0.1, period=PERIOD) as driver,
    ):
        driver.enable()
        simulator, peer = ready(driver), ready(FixedArm(6))
        times, cycles = [], driver.cycles
        begin = time.monotonic()
        for k in range(1, UPDATES + 1):
            # Whoever is first finds cold caches, as in a diagram that waits in between.
            pair = [timed_update(each, k) for each in (simulator, peer)[:: 1 if k % 2 else -1]]
            times.append(pair[0])
            time.sleep(max(0.0, begin + PERIOD * k - time.monotonic()))
        busy = driver.cycles - cycles
        assert driver.state().moving.all()
        end = simulator.get_context().get_time()
        benchmark.pedantic(lambda: simulator.AdvanceTo(end), rounds=3)
    ours, theirs = np.median(times[::2]), np.median(times[1::2])
    benchmark.extra_info.update(median_ms=1e3 * ours, ratio_to_bare_events=ours / theirs)
    print(f"\nupdate {1e3 * ours:.3f} ms median, {ours / theirs:.1f} times two bare events")
    assert busy >= 0.2 * UPDATES  # the thread did have the interpreter meanwhile
    assert ours <= 2.0 * theirs

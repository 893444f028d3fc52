"""What a servo driver costs a diagram while its bus thread is busy."""

import math
import time

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from nico_selfmodel.servos import JointServo, ServoConfig, SimulatedBus
from nico_selfmodel.systems import ServoDriver

pytestmark = pytest.mark.benchmark
BOUND = 0.3e-3
"""Of the median update [s]."""
UPDATES = 300


def test_an_update_takes_little_of_the_diagrams_time(benchmark):
    turn = math.radians
    joints = [
        JointServo(f"joint_{k}", k, 2e5, turn(-90), turn(90), turn(60), turn(240))
        for k in range(1, 7)
    ]
    config = ServoConfig("six", tuple(joints), baud=115200)
    with (
        SimulatedBus(6, latency=1e-3) as bus,
        ServoDriver(bus.name, config, trust_zero=True, speed=0.1, period=0.01) as driver,
    ):
        driver.enable()
        simulator = Simulator(driver)
        context = simulator.get_mutable_context()
        driver.get_input_port().FixValue(context, np.full(6, 1.5))
        simulator.Initialize()
        times, cycles = [], driver.cycles
        begin = time.monotonic()
        for k in range(1, UPDATES + 1):
            start = time.perf_counter()
            simulator.AdvanceTo(0.01 * k)  # one update, and one command handed over
            times.append(time.perf_counter() - start)
            time.sleep(max(0.0, begin + 0.01 * k - time.monotonic()))
        rate = (driver.cycles - cycles) / (time.monotonic() - begin)
        assert driver.state().moving.all()
        end = simulator.get_context().get_time()
        benchmark.pedantic(lambda: simulator.AdvanceTo(end), rounds=3)
    median = float(np.median(times))
    benchmark.extra_info.update(median_ms=1e3 * median, bus_hz=rate)
    print(f"\nupdate {1e3 * median:.3f} ms median, bus thread at {rate:.0f} cycles a second")
    assert rate > 20.0
    assert median <= BOUND

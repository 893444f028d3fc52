"""Servos as a system: ports, heartbeat, and what the bus fails with, through simulated bytes."""

import threading
import time

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from nico_selfmodel.errors import BusError, RobotError, ServoFault
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.servos import SimulatedBus
from nico_selfmodel.servos.ports import PortLostError
from nico_selfmodel.systems.hardware.servo_driver import ServoDriver

from ..servos.arms import JOINTS, addressed_modules, configuration

SOON = 5.0
COUNTS_PER_RADIAN = 200_000 / (2.0 * np.pi)
TARGET = np.array([0.2, -0.2, 0.1, 0.3, 0.0, -0.1])


@pytest.fixture
def bus():
    with SimulatedBus(addressed_modules(115200)) as simulated:
        yield simulated


@pytest.fixture
def driver(bus):
    made = ServoDriver(bus.name, configuration(baud=115200), trust_zero=True)
    with made:
        yield made


def running(driver, q=None):
    """Return a simulator of a driver alone, in real time, that is commanded to angles [rad]."""
    simulator = Simulator(driver)
    if q is not None:
        command = driver.servos.to_encoder(q)
        driver.get_input_port().FixValue(simulator.get_mutable_context(), command)
    simulator.set_target_realtime_rate(1.0)
    simulator.Initialize()
    return simulator


def advance(simulator, seconds=SOON, until=None):
    """Let time pass, until something holds if that is given."""
    context = simulator.get_context()
    end = context.get_time() + seconds
    while context.get_time() < end:
        simulator.AdvanceTo(context.get_time() + 0.05)
        if until is not None and until(context):
            return
    assert until is None, "it never happened"


def port(driver, name, context):
    value = driver.GetOutputPort(name).Eval(context)
    return value if name == "status" else np.array(value)


def shafts(bus):
    """Return where the shafts are, as readings [rad]."""
    signs = np.where(np.arange(1, 7) % 2, 1, -1)
    return signs * np.array(bus.shafts()) / COUNTS_PER_RADIAN


def test_the_ports_are_those_of_its_table(bus):
    driver = ServoDriver(bus.name, configuration())
    inputs = [driver.get_input_port(i).get_name() for i in range(driver.num_input_ports())]
    outputs = [driver.get_output_port(i).get_name() for i in range(driver.num_output_ports())]
    assert inputs == ["encoders_commanded"]
    expected = ["q_measured", "encoders", "valid", "age", "moving", "read_at", "status"]
    assert outputs == expected
    assert all(f"`{name}`" in ServoDriver.__doc__ for name in [*inputs, *outputs])


def test_making_a_driver_opens_nothing_and_opening_one_switches_nothing_on(bus, tmp_path):
    ServoDriver(str(tmp_path / "nothing"), configuration())
    driver = ServoDriver(bus.name, configuration(baud=115200))
    assert not driver.is_open
    with driver:
        assert driver.is_open
        simulator = running(driver)
        advance(simulator, 0.2)
        context = simulator.get_context()
        assert port(driver, "status", context) == ("off, not homed",) * 6
        assert np.isnan(port(driver, "q_measured", context)).all()
        assert np.array_equal(port(driver, "encoders", context), np.zeros(6))
        assert port(driver, "valid", context).all()
        assert (port(driver, "age", context) < 0.3).all()
    assert not any(module.amplifier for module in bus.modules)
    assert not any(thread.name == "arm loop" for thread in threading.enumerate())


def test_a_command_moves_the_arm_and_the_ports_tell(driver, bus):
    driver.enable()
    simulator = running(driver, TARGET)
    advance(simulator, until=lambda c: port(driver, "moving", c).any())
    assert "moving" in port(driver, "status", simulator.get_context())
    advance(simulator, until=lambda c: not port(driver, "moving", c).any())
    context = simulator.get_context()
    assert port(driver, "q_measured", context) == pytest.approx(TARGET, abs=1e-4)
    assert port(driver, "encoders", context) == pytest.approx(TARGET * COUNTS_PER_RADIAN, abs=2)
    assert shafts(bus) == pytest.approx(TARGET, abs=1e-4)
    assert port(driver, "status", context) == ("holding",) * 6


def test_a_self_model_maps_what_is_commanded_and_measured(bus):
    one = np.ones(1)
    learned = ServoMap(("right_elbow",), 0.1 * one, 1.6 * one, ("counts",), 2e5 * one, one)
    config = configuration(baud=115200)
    with ServoDriver(bus.name, config, learned, trust_zero=True) as driver:
        driver.enable()
        simulator = running(driver, [0.0, 0.0, 0.0, 0.2, 0.0, 0.0])
        advance(simulator, until=lambda c: abs(port(driver, "q_measured", c)[3] - 0.2) < 1e-4)
    assert shafts(bus)[3] == pytest.approx(0.1 + 1.6 * 0.2, abs=1e-4)


def test_joints_at_nan_are_not_commanded(driver, bus):
    driver.enable()
    command = np.full(6, np.nan)
    command[3] = 0.2
    simulator = running(driver, command)
    advance(simulator, until=lambda c: abs(port(driver, "q_measured", c)[3] - 0.2) < 1e-3)
    assert np.array_equal(np.delete(shafts(bus), 3), np.zeros(5))


def test_a_driver_that_is_not_open_says_so(bus):
    driver = ServoDriver(bus.name, configuration())
    with pytest.raises(RobotError, match="not open: call open first"):
        Simulator(driver).Initialize()
    with pytest.raises(RobotError, match="not open"):
        driver.enable()
    driver.close()


def test_commands_that_cannot_be_carried_out_are_raised_from_the_diagram(driver, bus):
    simulator = running(driver, TARGET)
    with pytest.raises(ServoFault, match="not enabled: enable it"):
        advance(simulator)
    driver.close()
    driver.open()
    driver.enable()
    with pytest.raises(ValueError, match="right_elbow cannot go to"):
        running(driver, [0, 0, 0, 9, 0, 0])
    assert np.array_equal(shafts(bus), np.zeros(6))


def test_poses_are_refused_before_the_zero_is_known(bus):
    with ServoDriver(bus.name, configuration(baud=115200)) as driver:
        driver.enable()
        simulator = running(driver, TARGET)
        with pytest.raises(ServoFault, match="rezero is due"):
            advance(simulator)
    assert np.array_equal(shafts(bus), np.zeros(6))


def test_a_pulled_cable_is_raised_with_its_cause_within_a_second(driver, bus):
    driver.enable()
    simulator = running(driver, np.full(6, 1.2))
    advance(simulator, until=lambda c: port(driver, "moving", c).any())
    bus.unplug()
    begin = time.monotonic()
    with pytest.raises(PortLostError, match="plug the adapter in again") as caught:
        advance(simulator)
    assert time.monotonic() - begin < 1.0
    assert isinstance(caught.value.__cause__, PortLostError)
    driver.close()  # cleanly
    assert not driver.is_open


def test_a_silent_board_is_named_and_the_others_stop(driver, bus):
    driver.enable()
    simulator = running(driver, np.full(6, 1.2))
    advance(simulator, until=lambda c: port(driver, "moving", c).all())
    with bus.lock:
        bus.modules[2].silent = True
    with pytest.raises(BusError, match=r"right_upper_arm_twist \(module 3\) is lost"):
        advance(simulator)
    time.sleep(0.8)
    before = shafts(bus)
    time.sleep(0.1)
    assert np.array_equal(shafts(bus), before)
    assert (np.abs(np.delete(before, 2)) < 1.1).all()


@pytest.mark.slow
def test_a_diagram_that_stands_still_stops_the_arm_and_one_that_goes_on_moves_it(driver, bus):
    driver.enable()
    simulator = running(driver, np.full(6, 0.9))
    advance(simulator, until=lambda c: port(driver, "moving", c).all())
    time.sleep(0.3 + 0.5)
    before = shafts(bus)
    time.sleep(0.1)
    assert np.array_equal(shafts(bus), before)
    assert (before < 0.85).all()
    advance(simulator, until=lambda c: np.abs(port(driver, "q_measured", c) - 0.9).max() < 1e-3)


def test_closing_stops_the_arm_and_another_may_open_the_port(bus):
    with ServoDriver(bus.name, configuration(baud=115200), trust_zero=True, speed=0.3) as driver:
        driver.enable()
        simulator = running(driver, np.full(6, 1.2))
        advance(simulator, until=lambda c: port(driver, "moving", c).all())
        with pytest.raises(RobotError, match="open already"):
            driver.open()
    time.sleep(0.3)
    before = shafts(bus)
    time.sleep(0.1)
    assert np.array_equal(shafts(bus), before)
    assert (before < 0.6).all()
    with ServoDriver(bus.name, configuration(baud=115200), trust_zero=True) as other:
        assert other.state().enabled.all()
        other.stop()


def test_a_port_that_does_not_exist_and_a_self_model_of_others_are_refused(bus, tmp_path):
    absent = ServoDriver(str(tmp_path / "ttyNothing"), configuration())
    with pytest.raises(PortLostError, match="ttyNothing does not exist"):
        absent.open()
    one = np.ones(1)
    stranger = ServoMap(("neck",), 0 * one, one, ("rad",), np.nan * one, one)
    with pytest.raises(ValueError, match="other joints: neck"):
        ServoDriver(bus.name, configuration(), stranger)
    with pytest.raises(ValueError, match="period must be positive"):
        ServoDriver(bus.name, configuration(), period=0.0)
    with pytest.raises(ValueError, match="speed must be at most"):
        ServoDriver(bus.name, configuration(), speed=5.0)
    six = ServoDriver(bus.name, configuration((*JOINTS, "neck"), baud=115200))
    with pytest.raises(BusError, match=r"missing: .*neck"):
        six.open()
    assert not six.is_open


def test_a_driver_works_in_a_diagram_of_ones_own(driver, bus):
    driver.enable()
    builder = DiagramBuilder()
    builder.AddSystem(driver)
    source = builder.AddSystem(ConstantVectorSource(0.5 * COUNTS_PER_RADIAN * TARGET))
    builder.Connect(source.get_output_port(), driver.GetInputPort("encoders_commanded"))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.set_target_realtime_rate(1.0)

    def there(context):
        own = driver.GetMyContextFromRoot(context)
        return np.abs(port(driver, "q_measured", own) - 0.5 * TARGET).max() < 1e-3

    advance(simulator, until=there)

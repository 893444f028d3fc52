"""Servos of other makes as a system: the same ports, the same faults."""

import numpy as np
import pytest

from nico_selfmodel.errors import BusError
from nico_selfmodel.servos import SimulatedBus
from nico_selfmodel.servos.makes import DYNAMIXEL
from nico_selfmodel.servos.ports import PortLostError
from nico_selfmodel.systems.hardware.servo_driver import ServoDriver
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.stations.nico_behind_bus import NicoBehindBus
from nico_selfmodel.systems.stations.nico_station import NicoStation

from ..servos.arms import configuration
from .test_servo_driver import TARGET, advance, port, running

SDKS = {"dynamixel": "dynamixel_sdk", "feetech": "scservo_sdk"}


@pytest.fixture(params=SDKS)
def bus(request):
    pytest.importorskip(SDKS[request.param])
    with SimulatedBus(6, make=request.param) as simulated:
        yield simulated


@pytest.fixture
def driver(bus, request):
    make = request.node.callspec.params["bus"]
    with ServoDriver(bus.name, configuration(make=make)) as made:
        made.enable()
        yield made


def test_a_command_moves_the_arm_and_the_ports_tell(driver, bus):
    simulator = running(driver, TARGET)
    advance(simulator, until=lambda c: port(driver, "moving", c).any())
    advance(simulator, until=lambda c: not port(driver, "moving", c).any())
    context = simulator.get_context()
    assert port(driver, "q_measured", context) == pytest.approx(TARGET, abs=2e-3)
    assert port(driver, "encoders", context) == pytest.approx(TARGET * 4096 / (2 * np.pi), abs=1)
    signs = np.where(np.arange(1, 7) % 2, 1, -1)
    shafts = signs * (np.array(bus.shafts()) - 2048) * 2 * np.pi / 4096
    assert shafts == pytest.approx(TARGET, abs=2e-3)
    assert port(driver, "status", context) == ("holding",) * 6


def test_a_pulled_cable_and_a_silent_servo_are_raised_from_the_diagram(driver, bus):
    simulator = running(driver, np.full(6, 1.2))
    advance(simulator, until=lambda c: port(driver, "moving", c).all())
    with bus.lock:
        bus.modules[2].silent = True
    with pytest.raises(BusError, match=r"right_upper_arm_twist \(id 3\) is lost"):
        advance(simulator)
    with bus.lock:
        bus.modules[2].silent = False
    driver.close()
    driver.open()
    bus.unplug()
    with pytest.raises(PortLostError, match="plug the adapter in again"):
        advance(running(driver))


@pytest.mark.slow
def test_a_station_whose_encoders_are_not_those_of_its_motors_is_refused():
    with (
        NicoStation("thesis", quality=ImageQuality(1)) as station,
        pytest.raises(ValueError, match=r"Dynamixel servos .* have 4096 counts a turn"),
    ):
        NicoBehindBus(station, make=DYNAMIXEL)

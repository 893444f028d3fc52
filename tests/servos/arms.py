"""Simulated arms: on a line in virtual time, where nothing waits, or as boards for a terminal."""

import math
import time
from contextlib import contextmanager
from dataclasses import dataclass

import pytest

from nico_selfmodel.servos import ArmController, ArmLoop, JointServo, ServoConfig
from nico_selfmodel.servos.bus_settings import BusSettings
from nico_selfmodel.servos.drivers import simulated_line
from nico_selfmodel.servos.dynamixel.joint_bus import DynamixelJointBus
from nico_selfmodel.servos.dynamixel.sdk import DynamixelSdk
from nico_selfmodel.servos.feetech.joint_bus import FeetechJointBus
from nico_selfmodel.servos.feetech.sdk import FeetechSdk
from nico_selfmodel.servos.makes import make_named
from nico_selfmodel.servos.pic_servo.joint_bus import PicServoJointBus
from nico_selfmodel.servos.pic_servo.line.bus import Bus
from nico_selfmodel.servos.pic_servo.protocol.trajectory import LoadTrajectory, TrajectoryFlag
from nico_selfmodel.servos.pic_servo.simulated.module import SimulatedModule
from nico_selfmodel.servos.register_servo.register_bus import RegisterBus
from nico_selfmodel.servos.simulated.line import SimulatedLine
from nico_selfmodel.servos.simulated.port import SimulatedPort

JOINTS = (
    *("right_shoulder_pitch", "right_shoulder_roll", "right_upper_arm_twist"),
    *("right_elbow", "right_forearm_twist", "right_wrist"),
)
COUNTS_PER_TURN = 200_000
MAKES = ("pic-servo", "dynamixel", "feetech")
SOON = 5.0
"""What takes longer than this never happens [s]."""


def configuration(joints=JOINTS, make="pic-servo", **options):
    """Return servos that turn by 90 deg either way, every second one wired the other way round."""
    kind = make_named(make)
    if kind.keeps_zero:
        options.setdefault("baud", 1_000_000)
    return ServoConfig(
        "arm",
        tuple(
            JointServo(
                name,
                address=k,
                counts_per_turn=kind.counts_per_turn or COUNTS_PER_TURN,
                lower=-math.pi / 2,
                upper=math.pi / 2,
                make=kind,
                max_velocity=math.radians(60),
                max_acceleration=math.radians(240),
                sign=1 if k % 2 else -1,
            )
            for k, name in enumerate(joints, 1)
        ),
        **options,
    )


@dataclass
class VirtualArm:
    """An arm on a line in virtual time, with everything within reach."""

    line: SimulatedLine
    port: SimulatedPort
    bus: Bus | RegisterBus
    arm: ArmController

    @property
    def modules(self):
        return self.line.modules

    def shafts(self):
        """Return where the shafts stand now."""
        self.line.advance(self.port.time)
        return [module.shaft for module in self.modules]

    def cycle_until_there(self, longest=20.0):
        """Let the arm move to its goals; return how long it took."""
        begin = self.port.time
        while self.arm.moving:
            self.arm.heartbeat()
            self.arm.cycle()
            assert self.port.time - begin < longest
        return self.port.time - begin

    def seconds_to_rest(self):
        """Leave the line alone and return when the last shaft stopped, from now."""
        begin, still_since, before = self.port.time, self.port.time, self.shafts()
        while self.port.time - still_since < 0.2:
            self.port.sleep(0.005)
            if (after := self.shafts()) != before:
                before, still_since = after, self.port.time
        return still_since - begin


def virtual_arm(
    modules=None, *, make="pic-servo", trust_zero=True, settings=None, servos=None, **options
):
    """Return an arm that is not connected yet."""
    config = configuration(make=make, **options)
    line = simulated_line(make)(modules or len(config.joints))
    port = SimulatedPort(line)
    bus, joint_bus = bus_of(make, port, config, settings or BusSettings())
    arm = ArmController(joint_bus, config, servos, trust_zero=trust_zero)
    return VirtualArm(line, port, bus, arm)


def bus_of(make, port, config, settings):
    """Return a bus of a make on a port, and its joints."""
    if make == "pic-servo":
        bus = Bus(port, settings)
        return bus, PicServoJointBus(bus, config)
    port.rate = config.baud
    if make == "dynamixel":
        pytest.importorskip("dynamixel_sdk")
        bus = RegisterBus(port, DynamixelSdk(), settings)
        return bus, DynamixelJointBus(bus, config)
    pytest.importorskip("scservo_sdk")
    bus = RegisterBus(port, FeetechSdk(), settings)
    return bus, FeetechJointBus(bus, config)


def addressed_modules(baud=19200):
    """Return six boards that an earlier program gave their addresses."""
    modules = [SimulatedModule() for _ in JOINTS]
    for address, module in enumerate(modules, 1):
        module.address, module.was_addressed, module.baud = address, True, baud
    return modules


def drive(module, velocity=None, acceleration=None, **options):
    """Let another program drive a board, by velocity or by PWM."""
    mode = 0 if velocity is None else TrajectoryFlag.SERVO | TrajectoryFlag.VELOCITY_MODE
    flags = mode | TrajectoryFlag.START_NOW
    module.execute(LoadTrajectory(flags, velocity=velocity, acceleration=acceleration, **options))


def wait_for(condition, seconds=SOON):
    """Wait until a condition holds; fail if it never does."""
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "it never happened"
        time.sleep(0.005)


def stopped(bus):
    """Wait until the simulated arm stands, and return how long that took [s]."""
    begin = last = time.monotonic()
    before = bus.shafts()
    while time.monotonic() - last < 0.15:
        time.sleep(0.005)
        if (after := bus.shafts()) != before:
            before, last = after, time.monotonic()
        assert last - begin < SOON
    return last - begin


@contextmanager
def loop_on(bus):
    """Give a loop of an arm that is connected and enabled."""
    arm = ArmController.open(bus.name, configuration(baud=115200), trust_zero=True)
    arm.connect()
    arm.enable()
    with ArmLoop(arm, period=0.02) as running:
        yield running

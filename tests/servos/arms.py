"""Simulated arms: on a line in virtual time, where nothing waits, or as boards for a terminal."""

import math
from dataclasses import dataclass

from nico_selfmodel.servos import (
    ArmController,
    Bus,
    BusSettings,
    JointServo,
    ServoConfig,
    SimulatedLine,
    SimulatedModule,
    SimulatedPort,
)

JOINTS = (
    *("right_shoulder_pitch", "right_shoulder_roll", "right_upper_arm_twist"),
    *("right_elbow", "right_forearm_twist", "right_wrist"),
)
COUNTS_PER_TURN = 200_000


def configuration(joints=JOINTS, **options):
    """Return servos that turn by 90 deg either way, every second one wired the other way round."""
    return ServoConfig(
        "arm",
        tuple(
            JointServo(
                name,
                address=k,
                counts_per_turn=COUNTS_PER_TURN,
                lower=-math.pi / 2,
                upper=math.pi / 2,
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
    bus: Bus
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


def virtual_arm(modules=None, *, trust_zero=True, settings=None, servos=None, **options):
    """Return an arm that is not connected yet."""
    config = configuration(**options)
    line = SimulatedLine(modules or [SimulatedModule() for _ in config.joints])
    port = SimulatedPort(line)
    bus = Bus(port, settings or BusSettings())
    arm = ArmController(bus, config, servos, trust_zero=trust_zero)
    return VirtualArm(line, port, bus, arm)


def addressed_modules(baud=19200):
    """Return six boards that an earlier program gave their addresses."""
    modules = [SimulatedModule() for _ in JOINTS]
    for address, module in enumerate(modules, 1):
        module.address, module.was_addressed, module.baud = address, True, baud
    return modules

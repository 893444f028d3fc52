"""The wire to the motors: makes of motors, controller of an arm, hand, and simulated buses.

From the wire up: each make has its bytes, a bus that owns the port, and motors on it, together a
`JointBus`; an `ArmController` drives joints of any make by name in radians, with an `ArmLoop` as
its thread and a `MotorServer` for other processes. A `SimulatedBus` speaks the same bytes behind a
pseudo-terminal. Importing opens nothing, making an object sends nothing, connecting moves nothing.
"""

from nico_selfmodel.servos.arm.controller import ArmController
from nico_selfmodel.servos.arm.motor import JointBus, Motor, Reading
from nico_selfmodel.servos.arm.servo_config import JointServo, ServoConfig
from nico_selfmodel.servos.arm.servo_config_file import load_servo_config
from nico_selfmodel.servos.arm_loop import ArmLoop
from nico_selfmodel.servos.server.motor_server import MotorServer
from nico_selfmodel.servos.simulated.bus import SimulatedBus

__all__ = [
    "ArmController",
    "ArmLoop",
    "JointBus",
    "JointServo",
    "Motor",
    "MotorServer",
    "Reading",
    "ServoConfig",
    "SimulatedBus",
    "load_servo_config",
]

"""The wire to the motors: protocol, bus, controller of an arm, hand, and a simulated bus.

From the wire up: `packets`, `commands` and `status` are the bytes; a `Bus` owns the port; a
`PicServo` is one board; an `ArmController` drives joints by name in radians, with an `ArmLoop` as
its thread and a `MotorServer` for other processes. A `SimulatedBus` speaks the same bytes behind a
pseudo-terminal. Importing opens nothing, making an object sends nothing, connecting moves nothing.
"""

from nico_selfmodel.servos.arm.controller import ArmController
from nico_selfmodel.servos.arm.servo_config import JointServo, ServoConfig
from nico_selfmodel.servos.arm.servo_config_file import load_servo_config
from nico_selfmodel.servos.arm_loop import ArmLoop
from nico_selfmodel.servos.server.motor_server import MotorServer
from nico_selfmodel.servos.simulated.bus import SimulatedBus

__all__ = [
    "ArmController",
    "ArmLoop",
    "JointServo",
    "MotorServer",
    "ServoConfig",
    "SimulatedBus",
    "load_servo_config",
]

"""The wire to the motors: protocol, bus, controller of an arm, hand, and a simulated bus.

From the wire up: `packets`, `commands` and `status` are the bytes; a `Bus` owns the port; a
`PicServo` is one board; an `ArmController` drives joints by name in radians, with an `ArmLoop` as
its thread and a `MotorServer` for other processes. A `SimulatedBus` speaks the same bytes behind a
pseudo-terminal. Importing opens nothing, making an object sends nothing, connecting moves nothing.
"""

from nico_selfmodel.servos.arm_loop import ArmLoop
from nico_selfmodel.servos.arm_state import ArmState
from nico_selfmodel.servos.bus import Bus, BusSettings
from nico_selfmodel.servos.chain import FoundModule, scan
from nico_selfmodel.servos.commands import BAUD_CODES
from nico_selfmodel.servos.controller import ArmController
from nico_selfmodel.servos.hand import FINGERS, Hand
from nico_selfmodel.servos.homing import find_home, zero_here
from nico_selfmodel.servos.motor_server import MotorServer
from nico_selfmodel.servos.servo_config import JointServo, ServoConfig
from nico_selfmodel.servos.servo_config_file import load_servo_config
from nico_selfmodel.servos.shutdown import stop_what_answers
from nico_selfmodel.servos.simulated_bus import SimulatedBus
from nico_selfmodel.servos.simulated_hand import SimulatedHand

__all__ = [
    "BAUD_CODES",
    "FINGERS",
    "ArmController",
    "ArmLoop",
    "ArmState",
    "Bus",
    "BusSettings",
    "FoundModule",
    "Hand",
    "JointServo",
    "MotorServer",
    "ServoConfig",
    "SimulatedBus",
    "SimulatedHand",
    "find_home",
    "load_servo_config",
    "scan",
    "stop_what_answers",
    "zero_here",
]

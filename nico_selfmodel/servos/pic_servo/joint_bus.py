"""The PIC-SERVO boards of an arm, as the arm's controller sees them."""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import replace

from nico_selfmodel.servos.arm.motor import Motor, Reading
from nico_selfmodel.servos.arm.servo_config import LONGEST_STOP, JointServo, ServoConfig
from nico_selfmodel.servos.bus_settings import BusSettings
from nico_selfmodel.servos.found_motor import FoundMotor, Scan
from nico_selfmodel.servos.link_counts import LinkCounts
from nico_selfmodel.servos.makes import PIC_SERVO
from nico_selfmodel.servos.pic_servo.connection import find_modules
from nico_selfmodel.servos.pic_servo.line.board import PicServo
from nico_selfmodel.servos.pic_servo.line.bus import Bus
from nico_selfmodel.servos.pic_servo.line.chain import (
    group_of,
    join_group,
    release_together,
    scan,
    start_together,
    stop_together,
)
from nico_selfmodel.servos.pic_servo.protocol.commands import StopMode, StopMotor
from nico_selfmodel.servos.pic_servo.protocol.packets import EVERYONE
from nico_selfmodel.servos.pic_servo.protocol.status import (
    AuxiliaryFlag,
    Status,
    StatusFlag,
    StatusItem,
)
from nico_selfmodel.servos.pic_servo.simulated.line import PicServoLine


class PicServoMotor:
    """The board of a joint. Modules that are enabled are in the group of their arm.

    As of every `Motor`, each method raises `BusError` where it does not answer.
    """

    answers = True

    def __init__(self, joint: JointServo, board: PicServo, group: int) -> None:
        """Stand for a board; sends nothing.

        Args:
            group: Of the modules of the arm that are enabled.
        """
        self.joint, self.board, self.group = joint, board, group
        self.loaded = False
        """Whether it has a motion that was not started."""
        self.member = False
        """Whether it is known to obey the packets to the group."""
        self.flags = StatusFlag(0)
        """Of its last reply."""

    @property
    def doubtful(self) -> bool:
        """Whether a reading counts only if a second one agrees."""
        return self.board.bus.noisy

    @property
    def counts(self) -> LinkCounts:
        """How well the wire to it works."""
        return self.board.bus.counts[self.board.address]

    def halt(self) -> None:
        """Begin to brake with the acceleration of the configuration, or let go of a raw PWM.

        The board's own acceleration is whatever an earlier program left, so that a smooth stop
        might take minutes.
        """
        status = self.board.watch()
        if status.flags & StatusFlag.HOMING:
            # Who armed it is gone: at its mark it would brake, and lose what says that it is homed.
            self.board.capture_home(0)
        if not _servo_on(status) or not status.flags & StatusFlag.POWER_ON:
            # No status tells a board whose PWM drives the motor from one that is off.
            self.release()
            return
        joint = self.joint
        self.board.rate_divisor = joint.gains.rate_divisor
        self.board.brake(joint.largest_acceleration)

    def take_over(self) -> bool:
        """Stop it, and set it up as the configuration says where it holds.

        Returns:
            Whether it holds without a fault.
        """
        self.halt()
        status = self._wait_for_standstill()
        # A joint with a fault has to be enabled anew, and for that to be connected first.
        holds = _servo_on(status) and self._fault(status) is None
        if holds:
            # What the earlier program set is not known, nor are speeds whose divisor is another.
            self.board.set_output(self.joint.output_mode)
            self.board.set_gains(self.joint.gains)
        # One that an earlier program left in the group would start or hold with the others.
        self._join(member=holds)
        return holds

    def _wait_for_standstill(self) -> Status:
        """Return the state of a board that was told to brake, once it stands."""
        port, status = self.board.bus.port, self.board.poll()
        until = port.now() + LONGEST_STOP
        while _servo_on(status) and not _stands(status):
            # With the divisor of another configuration it brakes too slowly.
            status = self.board.poll() if port.now() < until else self.board.hold()
        return status

    def switch_on(self) -> None:
        """Switch the servo on where the joint stands, and let it obey the packets to its group."""
        self.board.set_output(self.joint.output_mode)
        self.board.set_gains(self.joint.gains)
        self.board.arm_amplifier()
        self.board.hold()
        self.board.clear_faults()
        self._join(member=True)

    def poll(self) -> Reading:
        """Return what the board says now."""
        return self._reading(self.board.poll())

    def look_again(self, reading: Reading) -> Reading:
        """Return a reading with its position read anew, by a shorter packet."""
        if reading.fault is not None:
            return self.poll()
        position = self.board.read(StatusItem.POSITION).position
        assert position is not None  # it was asked for
        return replace(reading, position=position)

    def move_to(
        self, goal: int, velocity: float | None, acceleration: float | None, *, start: bool
    ) -> Reading:
        """Give the board a goal."""
        status = self.board.move_to(goal, velocity, acceleration, start=start)
        self.loaded = not start
        return self._reading(status)

    def brake(self, acceleration: float, *, start: bool) -> Reading:
        """Slow down to a standstill."""
        status = self.board.brake(acceleration, start=start)
        self.loaded = not start
        return self._reading(status)

    def stop(self, *, smoothly: bool) -> None:
        """Stop and hold."""
        (self.board.stop_smoothly if smoothly else self.board.hold)()

    def release(self) -> None:
        """Switch motor and amplifier off, and leave the group."""
        self.board.release()
        self._join(member=False)

    def _join(self, *, member: bool) -> None:
        self.member = False
        join_group(self.board, self.group if member else EVERYONE)
        self.member = member

    def knows_its_zero(self) -> bool:
        """Return whether the zero was set since the board was powered up."""
        return self.board.knows_its_zero()

    def zero_at(self, register: int) -> None:
        """Make where the joint stands `register`.

        Raises:
            ServoFault: If the board does not take it.
            BusError: If it does not answer.
        """
        self.board.zero_at(register)

    def _reading(self, status: Status) -> Reading:
        assert status.position is not None  # every board is watched
        self.flags = status.flags
        return Reading(
            position=status.position,
            commanded=status.position + (status.position_error or 0),
            standing=bool(status.flags & StatusFlag.MOVE_DONE),
            fault=self._fault(status),
        )

    def _fault(self, status: Status) -> str | None:
        flags = status.flags
        if flags & StatusFlag.OVERCURRENT:
            return "over-current: something blocks the joint; free it, then enable it again"
        if not flags & StatusFlag.POWER_ON:
            return "no motor power: emergency stop? Restore it, then enable the joint again"
        if flags & StatusFlag.POSITION_ERROR:
            return (
                f"position error above {self.joint.gains.error_limit} counts: the joint is blocked "
                "or overloaded; free it, then enable it again"
            )
        if not (status.auxiliary is None or status.auxiliary & AuxiliaryFlag.SERVO_ON):
            return "its servo is off though nobody switched it off; enable it again"
        return None


def _servo_on(status: Status) -> bool:
    return bool((status.auxiliary or 0) & AuxiliaryFlag.SERVO_ON)


def _stands(status: Status) -> bool:
    """Return whether a board that was told to brake has done so: a path counts as never done."""
    going = (status.auxiliary or 0) & AuxiliaryFlag.PATH_MODE
    return bool(status.flags & StatusFlag.MOVE_DONE) and not going


class PicServoJointBus:
    """The boards of a configuration on their bus.

    What sends raises `PortLostError` where the port is gone.
    """

    def __init__(self, bus: Bus, config: ServoConfig) -> None:
        """Describe them; sends nothing."""
        self.bus, self.config = bus, config
        self.group = group_of([joint.address for joint in config.joints])
        """Of the modules that are enabled; packets to it reach no other board."""
        self.motors = [
            PicServoMotor(joint, PicServo(bus, joint.address), self.group)
            for joint in config.joints
        ]
        self.port = bus.port

    @classmethod
    def open(cls, port: str, config: ServoConfig, settings: BusSettings) -> "PicServoJointBus":
        """Open a port; sends nothing.

        Raises:
            PortLostError: If the port cannot be opened.
        """
        return cls(Bus.open(port, config.baud, settings), config)

    @classmethod
    def scan(cls, port: str, baud: int | None, last: int) -> Scan:
        """Find the boards on a port, and give addresses to new ones; moves and resets nothing.

        Args:
            baud: Rate of the line; the one that boards come up with if None.
            last: Highest address to look at.

        Raises:
            PortLostError: If the port cannot be opened.
            BusError: If two share an address.
        """
        with Bus.open(port, baud or PIC_SERVO.bauds[0]) as bus:
            found = [
                FoundMotor(
                    module.address,
                    str(module.device),
                    module.status.position or 0,
                    module.servo_on,
                    module.zero_known,
                    module.newly_addressed,
                )
                for module in scan(bus, range(1, last + 1))
            ]
            return Scan(bus.rate, tuple(found), bus.total())

    @staticmethod
    def simulated_line() -> type[PicServoLine]:
        """Return the class of the simulated line of such boards."""
        return PicServoLine

    def find(self) -> None:
        """Find the boards and give addresses to new ones.

        Raises:
            BusError: If one is missing, of another type or too old.
        """
        find_modules(self.bus, self.config)

    def read_all(self) -> None:
        """Do nothing: a board that is given a goal answers with its state."""

    def flush(self) -> None:
        """Start together what was loaded."""
        if any(motor.loaded for motor in self.motors):
            for motor in self.motors:
                motor.loaded = False
            start_together(self.bus, self.group)

    def stop_all(self, motors: Sequence[Motor], *, smoothly: bool) -> None:
        """Stop the boards that are enabled with one packet; nobody confirms."""
        for motor in self.motors:
            motor.loaded = False
        stop_together(self.bus, self.group, smoothly=smoothly)

    def release_all(self, motors: Sequence[Motor]) -> None:
        """Switch boards off at once; nobody confirms."""
        if all(motor in motors for motor in self.motors):
            release_together(self.bus, self.group)
        for motor in self.motors:
            if motor in motors and not (motor.member and len(motors) == len(self.motors)):
                self.bus.send_at_once(motor.board.address, StopMotor(StopMode.MOTOR_OFF))

    def hurried(self) -> AbstractContextManager[None]:
        """Ask every board but once, while somebody waits for a stop."""
        return self.bus.hurried()

    def close(self) -> None:
        """Give the port back; never fails."""
        self.bus.close()

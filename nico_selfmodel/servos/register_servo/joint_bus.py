"""The servos of an arm on their bus: all read with one packet, all told with one."""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from typing import Self

from nico_selfmodel.errors import BusError, ServoFault
from nico_selfmodel.servos.arm.motor import Motor
from nico_selfmodel.servos.arm.servo_config import JointServo, ServoConfig
from nico_selfmodel.servos.bus_settings import BusSettings, NoisyLineError, NoReplyError
from nico_selfmodel.servos.found_motor import FoundMotor, Scan
from nico_selfmodel.servos.makes import Make
from nico_selfmodel.servos.ports import SerialPort
from nico_selfmodel.servos.register_servo.register_bus import RegisterBus
from nico_selfmodel.servos.register_servo.register_motor import RegisterMotor
from nico_selfmodel.servos.register_servo.sdk import PacketSdk

_ATTEMPTS = 2
"""How often an id is asked whether a servo has it."""


class RegisterJointBus:
    """The servos of a configuration. Making one sends nothing.

    What sends raises `PortLostError` where the port is gone.
    """

    make: Make
    sdk_type: type[PacketSdk]
    motor_type: type[RegisterMotor]
    model_register: int
    models: Mapping[int, str]
    """Model number -> name, of those whose registers are known."""

    def __init__(self, bus: RegisterBus, config: ServoConfig) -> None:
        """Describe them."""
        self.bus, self.config, self.port = bus, config, bus.port
        self.motors = [self.motor_type(joint, bus) for joint in config.joints]

    @classmethod
    def open(cls, port: str, config: ServoConfig, settings: BusSettings) -> Self:
        """Open a port; sends nothing.

        Raises:
            PortLostError: If the port cannot be opened.
            BusError: If the package that speaks to these servos is missing.
        """
        sdk = cls.sdk_type()
        return cls(RegisterBus(SerialPort(port, config.baud), sdk, settings), config)

    @classmethod
    def scan(cls, port: str, baud: int | None, last: int) -> Scan:
        """Return the servos that answer at the first rate at which any does; changes nothing.

        Args:
            baud: Rate of the line; every rate of the make if None.
            last: Highest id to look at.

        Raises:
            PortLostError: If the port cannot be opened.
            BusError: If two servos have one id, or the package that speaks to them is missing.
        """
        rates = cls.make.bauds if baud is None else (baud,)
        sdk = cls.sdk_type()
        bus = RegisterBus(SerialPort(port, rates[0]), sdk)
        first, highest = cls.make.addresses
        ids = range(first, min(last, highest) + 1)
        try:
            for rate in rates:
                if bus.port.rate != rate:
                    bus.port.set_rate(rate)
                found = [servo for n in ids if (servo := cls._servo(bus, n)) is not None]
                if found:
                    return Scan(rate, tuple(found), bus.total())
            return Scan(bus.port.rate, (), bus.total())
        finally:
            bus.close()

    @classmethod
    def _servo(cls, bus: RegisterBus, address: int) -> FoundMotor | None:
        """Return the servo at an id, None where none answers."""
        motor = cls.motor_type
        try:
            bus.read(address, cls.model_register, 2, attempts=_ATTEMPTS)
        except NoReplyError:
            if not bus.counts[address].damaged:
                return None
        model = model_of(bus, address, cls.model_register, motor.block)
        position = bus.read(address, *motor.position).data
        on = bus.read(address, motor.torque_register, 1).data[0]
        name = cls.models.get(model, f"model {model}")
        return FoundMotor(address, name, motor.number(position), bool(on), True, False)

    def find(self) -> None:
        """See that every servo is there and is what it should be; moves and resets nothing.

        Raises:
            BusError: If one is missing, shares its id, is of another kind, or has narrower limits.
        """
        missing = []
        for motor in self.motors:
            try:
                self._check_model(motor)
            except NoReplyError:
                missing.append(motor.joint)
        if missing:
            raise BusError(self._what_is_missing(missing))
        for motor in self.motors:
            self._check_limits(motor)

    def _check_model(self, motor: RegisterMotor) -> None:
        model = model_of(self.bus, motor.address, self.model_register, motor.block)
        if model not in self.models:
            raise BusError(
                f"{motor.joint} is a servo of model {model}, whose registers are not known here: "
                "correct its 'address' in the servo configuration"
            )

    def _what_is_missing(self, missing: Sequence[JointServo]) -> str:
        if len(missing) == len(self.motors):
            return (
                f"no servo answers on {self.port.name} at {self.config.baud} baud: are the servos "
                "switched on? `servo scan` finds them at any rate"
            )
        names = ", ".join(map(str, missing))
        return (
            f"{len(self.motors) - len(missing)} of {len(self.motors)} servos answer; missing: "
            f"{names}. Check power and cable; `servo scan` shows which ids are there"
        )

    def _check_limits(self, motor: RegisterMotor) -> None:
        joint = motor.joint
        low, high = sorted(map(joint.register, (joint.lower_reading, joint.upper_reading)))
        first, last = self.limits(motor)
        if low < first or high > last:
            raise BusError(
                f"{joint} may go from {low} to {high} counts, but its servo only from {first} to "
                f"{last}: narrow its limits in the servo configuration, or widen the servo's own"
            )

    def limits(self, motor: RegisterMotor) -> tuple[int, int]:
        """Return the servo's own limits [register].

        Raises:
            BusError: If it does not answer.
        """
        raise NotImplementedError

    def read_all(self) -> None:
        """Read every servo with one packet; who is missing is read by itself when it is polled."""
        self._read(self.motors)

    def _read(self, motors: Sequence[RegisterMotor]) -> None:
        found = self.bus.sync_read(*self.motor_type.block, [motor.address for motor in motors])
        for motor in motors:
            motor.fresh = found.get(motor.address)

    def flush(self) -> None:
        """Send what servos were told and do not have, with one packet.

        On a line that damages packets each is written by itself: shorter packets come through, and
        those are confirmed.
        """
        waiting = [motor for motor in self.motors if motor.waiting and motor.told is not None]
        for motor in self.motors:
            motor.fresh = None
        if self.bus.noisy:
            for motor in waiting:
                with suppress(NoReplyError, ServoFault):  # it still waits: the next cycle tells
                    motor.write_goal()
        else:
            self._send(waiting)

    def _send(self, motors: Sequence[RegisterMotor], *, at_once: bool = False) -> None:
        goals = {motor.address: motor.encode(motor.told) for motor in motors if motor.told}
        if not goals:
            return
        write = self.bus.sync_write_at_once if at_once else self.bus.sync_write
        write(self.motor_type.goal_register, goals)
        for motor in motors:
            motor.was_written()

    def stop_all(self, motors: Sequence[Motor], *, smoothly: bool) -> None:
        """Stop servos with one packet; nobody confirms. One that has a fault is not told."""
        for motor in self.motors:
            motor.waiting = False
        mine = [motor for motor in self.motors if motor in motors]
        with suppress(NoisyLineError):
            self._read(mine)
        sound = [motor for motor in mine if motor.fresh is None or motor.look().fault is None]
        for motor in sound:
            motor.tell_to_stop(smoothly=smoothly)
        self._send(sound, at_once=True)

    def release_all(self, motors: Sequence[Motor]) -> None:
        """Switch servos off with one packet; nobody confirms."""
        off = {motor.address: b"\x00" for motor in self.motors if motor in motors}
        if off:
            self.bus.sync_write_at_once(self.motor_type.torque_register, off)

    def hurried(self) -> AbstractContextManager[None]:
        """Ask every servo but once, while somebody waits for a stop."""
        return self.bus.hurried()

    def close(self) -> None:
        """Give the port back; never fails."""
        self.bus.close()


def model_of(bus: RegisterBus, address: int, register: int, block: tuple[int, int]) -> int:
    """Return the model number of the servo at an id.

    Args:
        address: The id.
        register: Of the model number.
        block: Registers that differ between any two servos.

    Raises:
        NoReplyError: If nobody answers.
        BusError: If two do.
    """
    before = bus.counts[address].damaged
    try:
        model = int.from_bytes(bus.read(address, register, 2).data, "little")
        bus.read(address, *block)
    except NoReplyError as error:
        if bus.counts[address].damaged == before:
            raise
        raise BusError(
            f"id {address} answers, but every reply is damaged: two servos have this id, or the "
            "baud rate is wrong. Connect them one at a time and give each an id of its own"
        ) from error
    return model

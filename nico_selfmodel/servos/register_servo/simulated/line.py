"""The simulated half-duplex line of servos: every packet is heard by all, some answer in turn."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import ClassVar, Protocol

from nico_selfmodel.servos.register_servo.simulated.servo import RefusedError, SimulatedServo
from nico_selfmodel.servos.simulated.line import Plant, SimulatedLine, WireFaults

BROADCAST = 0xFE
PING, READ, WRITE, REBOOT, SYNC_READ, SYNC_WRITE = 1, 2, 3, 8, 0x82, 0x83
_REBOOT = 0.2
"""How long a servo takes to start anew [s]."""
_PAUSE = 5e-3
"""A pause in a packet after which a servo waits for a new one [s]."""


@dataclass(frozen=True)
class Instruction:
    """A packet to a servo, or to all."""

    address: int
    code: int
    parameters: bytes


class Framing(Protocol):
    """How packets of a make look."""

    def take(self, heard: bytearray) -> Instruction | None:
        """Take the first undamaged packet out of what was heard, with all that stands before it."""
        ...

    def answer(self, address: int, error: int, data: bytes) -> bytes:
        """Return a status packet."""
        ...

    def registers(self, parameters: bytes) -> tuple[int, int, bytes]:
        """Return the register, the length and the rest that parameters begin with."""
        ...

    def target(self, parameters: bytes) -> tuple[int, bytes]:
        """Return the register that is written, and its data."""
        ...


class RegisterLine(SimulatedLine[SimulatedServo]):
    """Servos on one half-duplex line."""

    servo_type: ClassVar[type[SimulatedServo]]
    framing: Framing

    def __init__(
        self,
        modules: Sequence[SimulatedServo] | int,
        faults: WireFaults | None = None,
        plant: Plant | None = None,
    ) -> None:
        """Connect servos.

        Args:
            modules: How many, with the ids from 1 on, or which.
            faults: Damage on the wire; none if omitted.
            plant: What moves the shafts; without it they follow their servos exactly.
        """
        if isinstance(modules, int):
            modules = [self.servo_type(address) for address in range(1, modules + 1)]
        super().__init__(modules, faults, plant)
        self._heard, self._heard_at = bytearray(), 0.0

    def _hear(self, time: float, byte: int, rate: int) -> None:
        if time - self._heard_at > _PAUSE:
            self._heard.clear()
        self._heard.append(byte)
        self._heard_at = time
        while (packet := self.framing.take(self._heard)) is not None:
            listening = [m for m in self.modules if m.baud == rate and time >= m.deaf_until]
            for replies in self._obey(packet, listening, time):
                if spoken := [(m, data) for m, data in replies if not m.silent]:
                    self._reply(time, rate, spoken)

    def _obey(
        self, packet: Instruction, listening: Sequence[SimulatedServo], time: float
    ) -> list[list[tuple[SimulatedServo, bytes]]]:
        """Let servos carry a packet out; returns who answers, in turn, and who at once."""
        for module in listening:
            if packet.address in (BROADCAST, module.address):
                self._catch_up(module, time)
                module.heard = time
        if packet.code in (SYNC_READ, SYNC_WRITE):
            try:
                obey = self._sync_read if packet.code == SYNC_READ else self._sync_write
                return obey(packet, listening)
            except (IndexError, RefusedError):  # damage that the checksum did not show
                return []
        meant = [m for m in listening if packet.address in (BROADCAST, m.address)]
        replies = [(m, data) for m in meant if (data := self._one(m, packet)) is not None]
        if packet.address != BROADCAST:
            return [replies]
        return [[reply] for reply in replies] if packet.code == PING else []

    def _one(self, module: SimulatedServo, packet: Instruction) -> bytes | None:
        """Return what one servo answers, None where it stays silent."""
        data = b""
        try:
            if packet.code == PING:
                data = self.greeting(module)
            elif packet.code == READ:
                register, length, _ = self.framing.registers(packet.parameters)
                data = module.read(register, length)
            elif packet.code == WRITE:
                module.write(*self.framing.target(packet.parameters))
            elif packet.code == REBOOT:
                module.power_cycle()
                module.deaf_until = module.time + _REBOOT
            else:
                raise RefusedError(2)
        except RefusedError as refused:
            return self._status(module, refused.code, b"")
        except IndexError:  # damage that the checksum did not show
            return None
        return self._status(module, 0, data)

    def greeting(self, module: SimulatedServo) -> bytes:
        """Return what a servo answers a ping with."""
        return b""

    def _status(self, module: SimulatedServo, error: int, data: bytes) -> bytes:
        return self.framing.answer(module.address, error | self.ailing(module), data)

    def ailing(self, module: SimulatedServo) -> int:
        """Return the bits of a status packet's error that say what ails a servo."""
        return 0

    def _sync_read(
        self, packet: Instruction, listening: Sequence[SimulatedServo]
    ) -> list[list[tuple[SimulatedServo, bytes]]]:
        register, length, addresses = self.framing.registers(packet.parameters)
        turns = []
        for address in addresses:
            meant = [module for module in listening if module.address == address]
            turn = [(m, self._status(m, 0, m.read(register, length))) for m in meant]
            if not any(not module.silent for module in meant):
                break  # each waits for the one before it to have spoken
            turns.append(turn)
        return turns

    def _sync_write(
        self, packet: Instruction, listening: Sequence[SimulatedServo]
    ) -> list[list[tuple[SimulatedServo, bytes]]]:
        register, length, rest = self.framing.registers(packet.parameters)
        for begin in range(0, len(rest) - length, length + 1):
            data = rest[begin + 1 : begin + 1 + length]
            for module in listening:
                if module.address == rest[begin]:
                    with suppress(RefusedError):  # to a packet for all nobody says so
                        module.write(register, data)
        return []

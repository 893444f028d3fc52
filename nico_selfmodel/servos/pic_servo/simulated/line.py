"""The simulated RS485 line of PIC-SERVO boards: addresses along the chain, groups."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from nico_selfmodel.servos.pic_servo.protocol.command_packets import command_of
from nico_selfmodel.servos.pic_servo.protocol.commands import HardReset
from nico_selfmodel.servos.pic_servo.protocol.packets import (
    EVERYONE,
    FIRST_GROUP,
    HEADER,
    SHORTEST_COMMAND,
    DamagedPacketError,
    decode_frame,
)
from nico_selfmodel.servos.pic_servo.simulated.module import SimulatedModule
from nico_selfmodel.servos.simulated.line import Plant, SimulatedLine, WireFaults


@dataclass
class _Listener:
    """A module with what it has heard of the packet that is under way."""

    module: SimulatedModule
    heard: bytearray = field(default_factory=bytearray)

    def hear(self, byte: int) -> bytes | None:
        """Take one byte; return a whole packet when it is the last of one."""
        if not self.heard and byte != HEADER:
            return None
        self.heard.append(byte)
        if len(self.heard) < 3 or len(self.heard) < SHORTEST_COMMAND + (self.heard[2] >> 4):
            return None
        packet = bytes(self.heard)
        self.heard.clear()
        return packet


class PicServoLine(SimulatedLine[SimulatedModule]):
    """Modules on a line, in the order of their chain."""

    reply_delay = 0.51e-3  # one servo tick

    def __init__(
        self,
        modules: Sequence[SimulatedModule] | int,
        faults: WireFaults | None = None,
        plant: Plant | None = None,
    ) -> None:
        """Connect modules.

        Args:
            modules: How many, or which; the first one is enabled, each later one when the one
                before got its address.
            faults: Damage on the wire; none if omitted.
            plant: What moves the shafts; without it they follow their servos exactly.
        """
        if isinstance(modules, int):
            modules = [SimulatedModule() for _ in range(modules)]
        super().__init__(modules, faults, plant)
        self.broken_after: int | None = None
        """Number of modules before the place where the line is cut."""
        self._listeners = [_Listener(module) for module in self.modules]

    def _hear(self, time: float, byte: int, rate: int) -> None:
        replies = []
        for listener in self._reachable():
            if listener.module.baud != rate:
                listener.heard.clear()
                continue
            packet = listener.hear(byte)
            if packet is not None:
                self._catch_up(listener.module, time)
                answer = self._answer(listener.module, packet)
                if answer is not None and not listener.module.silent:
                    replies.append((listener.module, answer))
        if replies:
            self._reply(time, rate, replies)

    def _reachable(self) -> list[_Listener]:
        """Return the modules whose communication is enabled: ADDR_OUT of the one before is low.

        A module that is reset raises its ADDR_OUT, so that those behind it neither hear nor answer
        until it has an address again. Whether a module with an address from its own memory waits
        for that is not known; here it does not.
        """
        reachable = []
        for index, listener in enumerate(self._listeners[: self.broken_after]):
            before = self._listeners[index - 1].module if index else None
            own = listener.module.restored_address is not None
            if before is None or before.was_addressed or own:
                reachable.append(listener)
        return reachable

    @staticmethod
    def _answer(module: SimulatedModule, packet: bytes) -> bytes | None:
        """Let a module read a packet; return its reply, None where it stays silent."""
        address = packet[1]
        is_group = address >= FIRST_GROUP
        # A reset to everyone is heard in every group.
        reset = address == EVERYONE and packet[2] & 0xF == HardReset.code
        if address != (module.group if is_group else module.address) and not reset:
            return None
        answers = not is_group or module.leader
        try:
            command = command_of(decode_frame(packet))
        except DamagedPacketError:
            return module.reply(damaged=True) if answers else None
        reply = module.execute(command)
        return reply if answers else None

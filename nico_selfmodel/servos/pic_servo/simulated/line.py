"""The simulated RS485 line: bytes with their times, the chain of modules, and damage on the way."""

import heapq
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.servos.pic_servo.protocol.command_packets import command_of
from nico_selfmodel.servos.pic_servo.protocol.commands import HardReset
from nico_selfmodel.servos.pic_servo.protocol.packets import (
    EVERYONE,
    FIRST_GROUP,
    HEADER,
    SHORTEST_COMMAND,
    UNADDRESSED,
    DamagedPacketError,
    decode_frame,
)
from nico_selfmodel.servos.pic_servo.simulated.module import SimulatedModule

REPLY_DELAY = 0.51e-3
"""From the last byte of a command to the first of its reply [s]: one servo tick."""
BITS_PER_BYTE = 10
"""Start bit, eight data bits, stop bit."""

Plant = Callable[[float, NDArray], NDArray]
"""(time [s], commanded counts or nan where a servo is off (n,)) -> counts of the encoders (n,)."""


@dataclass
class WireFaults:
    """How likely a byte is damaged, either way; the counts say how often it was."""

    rng: np.random.Generator
    corrupt: float = 0.0
    drop: float = 0.0
    duplicate: float = 0.0
    corrupted: int = 0
    dropped: int = 0
    duplicated: int = 0

    def pass_on(self, byte: int) -> bytes:
        """Return what arrives of a byte: itself, something else, nothing, or it twice."""
        draw = self.rng.random()
        if draw < self.drop:
            self.dropped += 1
            return b""
        if draw < self.drop + self.duplicate:
            self.duplicated += 1
            return bytes([byte, byte])
        if draw < self.drop + self.duplicate + self.corrupt:
            self.corrupted += 1
            return bytes([byte ^ int(self.rng.integers(1, 256))])
        return bytes([byte])


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


class SimulatedLine:
    """Modules on a line, in the order of their chain.

    Bytes go in with the time at which they were sent, and come out when the rate of the line and
    the modules' delay allow. Nothing here waits: the time is the caller's, real or not.
    """

    def __init__(
        self,
        modules: Sequence[SimulatedModule],
        faults: WireFaults | None = None,
        plant: Plant | None = None,
    ) -> None:
        """Connect modules.

        Args:
            modules: The first one is enabled, each later one when the one before got its address.
            faults: Damage on the wire; none if omitted.
            plant: What moves the shafts; without it they follow their servos exactly.
        """
        self.modules = list(modules)
        self.faults = faults
        self.plant = plant
        self.plant_period = 10e-3
        """How often the plant is asked [s]."""
        self.broken_after: int | None = None
        """Number of modules before the place where the line is cut."""
        self.zeros_only = False
        """Whether the host receives nothing but zeros: a line that is shorted."""
        self._listeners = [_Listener(module) for module in self.modules]
        self._arriving: deque[tuple[float, int, int]] = deque()
        self._replies: list[tuple[float, int, int]] = []
        self._sent_until = self._answered_until = 0.0
        self._order = 0
        self._plant_asked: float | None = None
        for module in self.modules:
            module.external = plant is not None

    def receive(self, data: bytes, now: float, rate: int) -> None:
        """Take bytes that the host begins to send now at a rate [baud]."""
        byte_time = BITS_PER_BYTE / rate
        time = max(now, self._sent_until)
        for sent in data:
            time += byte_time
            arrived = self.faults.pass_on(sent) if self.faults else bytes([sent])
            self._arriving.extend((time, byte, rate) for byte in arrived)
        self._sent_until = time
        self._carry(now)

    def advance(self, now: float) -> None:
        """Let everything happen that happens until now [s]."""
        self._carry(now)
        self._ask_plant(now)
        for module in self.modules:
            module.advance(now)

    def _carry(self, now: float) -> None:
        """Let the bytes arrive that have arrived by now."""
        while self._arriving and self._arriving[0][0] <= now:
            self._hear(*self._arriving.popleft())

    def due(self, now: float) -> bytes:
        """Return the bytes that have reached the host by now [s]."""
        self._carry(now)
        if self.next_event() is None:  # else there is time later; a packet advances its module
            self.advance(now)
        arrived = bytearray()
        while self._replies and self._replies[0][0] <= now:
            arrived.append(heapq.heappop(self._replies)[2])
        return bytes(arrived)

    def next_event(self) -> float | None:
        """Return when to look again [s], None if no byte is under way.

        That is when the last byte under way has arrived, which is what a reader waits for; a reply
        that was held back comes later.
        """
        times = [self._arriving[-1][0]] if self._arriving else []
        if self._replies:
            first = self._replies[0][0]
            times.append(self._answered_until if first <= self._answered_until else first)
        return min(times, default=None)

    def _hear(self, time: float, byte: int, rate: int) -> None:
        replies = []
        for listener in self._reachable():
            if listener.module.baud != rate:
                listener.heard.clear()
                continue
            packet = listener.hear(byte)
            if packet is not None:
                self._ask_plant(time)
                listener.module.advance(time)
                answer = self._answer(listener.module, packet)
                if answer is not None and not listener.module.silent:
                    replies.append((listener.module, answer))
        if replies:
            self._reply(time, rate, replies)

    def _reachable(self) -> list[_Listener]:
        """Return the modules whose communication is enabled: ADDR_OUT of the one before is low.

        Whether a module with an address from its own memory waits for that is not known; here it
        does not, and lowers its own ADDR_OUT only when it is given an address.
        """
        reachable = []
        for index, listener in enumerate(self._listeners[: self.broken_after]):
            before = self._listeners[index - 1].module if index else None
            if before is None or before.was_addressed or listener.module.address != UNADDRESSED:
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

    def _reply(self, time: float, rate: int, replies: list[tuple[SimulatedModule, bytes]]) -> None:
        late = max(module.late_by for module, _ in replies)
        for module, _ in replies:
            module.late_by = 0.0
        # Two that speak at once pull the line low together.
        both = zip_longest(*(data for _, data in replies), fillvalue=0xFF)
        begin = time + REPLY_DELAY + late
        if not late:
            begin = self._answered_until = max(begin, self._answered_until)
        for column in both:
            begin += BITS_PER_BYTE / rate
            byte = 0xFF
            for value in column:
                byte &= value
            byte = 0 if self.zeros_only else byte
            for arrived in self.faults.pass_on(byte) if self.faults else (byte,):
                self._order += 1
                heapq.heappush(self._replies, (begin, self._order, arrived))
        if not late:
            self._answered_until = begin

    def _ask_plant(self, now: float) -> None:
        if self.plant is None:
            return
        if self._plant_asked is not None and now - self._plant_asked < self.plant_period:
            return
        self._plant_asked = now
        wanted = [module.commanded_shaft for module in self.modules]
        counts = self.plant(now, np.array([np.nan if w is None else w for w in wanted]))
        for module, shaft in zip(self.modules, counts, strict=True):
            module.shaft = float(shaft)

"""The simulated line of any make: bytes with their times, replies, and damage on the way."""

import heapq
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import ClassVar, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

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


class SimulatedMotor(Protocol):
    """A motor behind the line. Time is whatever the line says."""

    silent: bool
    """Hears and obeys, but its replies are lost."""
    late_by: float
    """Delay of the next reply [s], once."""
    external: bool
    """Whether a plant outside moves the shaft."""
    shaft: float
    """Where it stands [counts]."""

    @property
    def commanded_shaft(self) -> float | None:
        """Where the servo wants the shaft [counts], None where it does not hold it."""
        ...

    def advance(self, time: float) -> None:
        """Catch up with a time [s]."""
        ...


MotorT = TypeVar("MotorT", bound=SimulatedMotor)


class SimulatedLine(Generic[MotorT]):
    """Motors on a line; what they hear and answer is up to their make, in `_hear`.

    Bytes go in with the time at which they were sent, and come out when the rate of the line and
    the modules' delay allow. Nothing here waits: the time is the caller's, real or not.
    """

    reply_delay: ClassVar[float] = 0.5e-3
    """From the last byte of a command to the first of its reply [s]."""

    def __init__(
        self,
        modules: Sequence[MotorT],
        faults: WireFaults | None = None,
        plant: Plant | None = None,
    ) -> None:
        """Connect motors.

        Args:
            modules: In their order on the line.
            faults: Damage on the wire; none if omitted.
            plant: What moves the shafts; without it they follow their servos exactly.
        """
        self.modules = list(modules)
        self.faults = faults
        self.plant = plant
        self.plant_period = 10e-3
        """How often the plant is asked [s]."""
        self.zeros_only = False
        """Whether the host receives nothing but zeros: a line that is shorted."""
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
        """Let a byte arrive at the motors that listen at a rate [baud]."""
        raise NotImplementedError

    def _catch_up(self, module: MotorT, time: float) -> None:
        """Bring a motor, and what moves it, up to a time before it obeys."""
        self._ask_plant(time)
        module.advance(time)

    def _reply(self, time: float, rate: int, replies: Sequence[tuple[MotorT, bytes]]) -> None:
        """Let motors that answer at the same time speak."""
        late = max(module.late_by for module, _ in replies)
        for module, _ in replies:
            module.late_by = 0.0
        # Two that speak at once pull the line low together.
        both = zip_longest(*(data for _, data in replies), fillvalue=0xFF)
        begin = time + self.reply_delay + late
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

"""A simulated hand that speaks the line protocol."""

import heapq

from nico_selfmodel.errors import BusError
from nico_selfmodel.servos.hand import FINGERS, LONGEST_RUN, WAYS, decode_line, encode_line
from nico_selfmodel.servos.simulated.pseudo_terminal import PseudoTerminal

_RUNNING, _BLOCKED = 120, 700
_FULL_TRAVEL_TIME = 0.6  # at full power [s]


class SimulatedFinger:
    """A motor that turns a finger between two stops, by time and power."""

    def __init__(self) -> None:
        """Start half open."""
        self.place = 0.5
        """0 is open, 1 closed."""
        self.motion, self.cause = "idle", "none"
        self.limit = 1023
        self.obstacle: float | None = None
        """Place that the finger cannot close beyond."""
        self._power, self._ends, self._time = 0.0, 0.0, 0.0

    @property
    def current(self) -> int:
        """What the board's converter reads."""
        if self.motion == "idle":
            return 0
        return _BLOCKED if self._blocked else _RUNNING

    @property
    def _blocked(self) -> bool:
        end = 0.0 if self.motion == "open" else self._furthest
        return self.place == end

    @property
    def _furthest(self) -> float:
        return 1.0 if self.obstacle is None else self.obstacle

    def go(self, way: str, power: float, seconds: float, now: float) -> None:
        """Run for a time."""
        self.motion, self._power = way, power
        self._time, self._ends = now, now + min(seconds, LONGEST_RUN)

    def halt(self, cause: str) -> None:
        """Stop."""
        if self.motion != "idle":
            self.motion, self.cause = "idle", cause

    def advance(self, now: float) -> None:
        """Move on to a time [s]."""
        if self.motion == "idle":
            return
        seconds = max(0.0, min(now, self._ends) - self._time)
        step = seconds * self._power / _FULL_TRAVEL_TIME
        step = -step if self.motion == "open" else step
        self.place = max(0.0, min(self._furthest, self.place + step))
        self._time = now
        if self.current > self.limit:
            self.halt("current")
        elif now >= self._ends:
            self.halt("time")


class HandFirmware:
    """The board: lines in, lines out, motors that end by themselves."""

    def __init__(self) -> None:
        """Power up."""
        self.fingers = {name: SimulatedFinger() for name in FINGERS}
        self._line = b""
        self._replies: list[tuple[float, int, int]] = []
        self._order = 0

    def receive(self, data: bytes, now: float, rate: int) -> None:
        """Take bytes that the host begins to send now."""
        time = now
        for byte in data:
            time += 10 / rate
            self._line += bytes([byte])
            if byte == ord("\n"):
                self._answer(self._line, time, rate)
                self._line = b""
        self._line = self._line[-200:]

    def advance(self, now: float) -> None:
        """Let the motors run until now."""
        for finger in self.fingers.values():
            finger.advance(now)

    def due(self, now: float) -> bytes:
        """Return the bytes that have reached the host by now."""
        self.advance(now)
        arrived = bytearray()
        while self._replies and self._replies[0][0] <= now:
            arrived.append(heapq.heappop(self._replies)[2])
        return bytes(arrived)

    def next_event(self) -> float | None:
        """Return when the next byte reaches the host, None if none is under way."""
        return self._replies[0][0] if self._replies else None

    def _answer(self, line: bytes, now: float, rate: int) -> None:
        self.advance(now)
        try:
            answer = self._obey(decode_line(line).split(), now)
        except BusError:
            answer = "ERR checksum"
        except (ValueError, KeyError):
            answer = "ERR command"
        for byte in encode_line(answer):
            now += 10 / rate
            self._order += 1
            heapq.heappush(self._replies, (now, self._order, byte))

    def _obey(self, words: list[str], now: float) -> str:
        match words:
            case ["ID"]:
                return "ID hand 1"
            case ["STATE"]:
                parts = (f"{f.motion} {f.current} {f.cause}" for f in self.fingers.values())
                return " ".join(("STATE", *parts))
            case ["STOP"]:
                for finger in self.fingers.values():
                    finger.halt("stop")
                return "OK"
            case ["LIMIT", name, limit]:
                self.fingers[name].limit = int(limit)
                return "OK"
            case ["GO", name, way, pwm, milliseconds] if way in WAYS:
                self.fingers[name].go(way, int(pwm) / 255, int(milliseconds) / 1e3, now)
                return "OK"
        return "ERR command"


class SimulatedHand(PseudoTerminal[HandFirmware]):
    """A hand on a pseudo-terminal; `name` is the device to open."""

    def __init__(self) -> None:
        """Describe it; nothing runs before it is entered."""
        super().__init__(HandFirmware())

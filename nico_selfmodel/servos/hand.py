"""Nico's hand: two motors without encoders, opened and closed by time.

The firmware of the thesis' hand board is not public. This is a line protocol of our own, for a
board that is programmed anew: see docs/servos.md.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field

from nico_selfmodel.errors import BusError, RobotError, ServoFault
from nico_selfmodel.servos.ports import Port, SerialPort
from nico_selfmodel.with_blocks import ClosedAtEnd

FINGERS = ("index", "fingers")
"""The index finger, and the other three together."""
WAYS = ("open", "close")
LONGEST_RUN = 5.0
"""What the board runs a motor at most [s], whatever it is told."""
_RATE = 9600
_ANSWER_TIME = 0.2
_ATTEMPTS = 3


@dataclass(frozen=True)
class FingerState:
    """What the board says of one motor."""

    motion: str
    """`open`, `close` or `idle`."""
    current: int
    """Motor current, 0-1023 of the board's converter."""
    cause: str
    """Why it last stopped: `time`, `current`, `stop`, or `none` since power-up."""


@dataclass
class Hand(ClosedAtEnd):
    """The hand on its serial line. Making one sends nothing; opening it moves nothing.

    There is no encoder: where a finger is, is `unknown` until it was run to an end.
    """

    port: Port
    position: dict[str, str] = field(default_factory=lambda: dict.fromkeys(FINGERS, "unknown"))
    """`open`, `closed` or `unknown` for each finger."""

    @classmethod
    def open_port(cls, name: str) -> "Hand":
        """Open the hand's serial port and see that a hand is there.

        Raises:
            PortLostError: If the port cannot be opened.
            BusError: If no hand answers.
        """
        hand = cls(SerialPort(name, _RATE))
        try:
            hand.identify()
        except BusError:
            hand.close()
            raise
        return hand

    def close(self) -> None:
        """Give the port back; a motor that runs ends by itself in time."""
        self.port.close()

    def identify(self) -> str:
        """Return name and version of the firmware.

        Raises:
            BusError: If what answers is no hand.
        """
        words = self.ask("ID").split()
        if words[:2] != ["ID", "hand"]:
            raise BusError(f"{self.port.name} is no hand: it says {' '.join(words)!r}")
        return " ".join(words[1:])

    def state(self) -> dict[str, FingerState]:
        """Return what the board says of each motor.

        Raises:
            BusError: If there is no good answer.
        """
        words = self.ask("STATE").split()
        if len(words) != 1 + 3 * len(FINGERS) or words[0] != "STATE":
            raise BusError(f"the hand's state cannot be read: {' '.join(words)!r}")
        parts = [words[k : k + 3] for k in range(1, len(words), 3)]
        return {
            finger: FingerState(motion, int(current) if current.isdigit() else -1, cause)
            for finger, (motion, current, cause) in zip(FINGERS, parts, strict=True)
        }

    def move(
        self,
        way: str,
        fingers: Sequence[str] = FINGERS,
        *,
        seconds: float = 1.0,
        power: float = 0.7,
        current_limit: int = 500,
    ) -> dict[str, str]:
        """Open or close fingers and wait until they have stopped.

        The board itself ends the motion when the time is over or the current above its limit, so
        that it ends when this process does not live to see it.

        Args:
            way: `open` or `close`.
            fingers: Which.
            seconds: How long to run [s].
            power: Share of the full PWM.
            current_limit: Where to cut off, 0-1023 of the board's converter.

        Returns:
            Finger -> why it stopped: `time` or `current`.

        Raises:
            ValueError: If an argument is out of range.
            ServoFault: If a motor does not stop in time, or another cause stopped it.
            BusError: If the hand does not answer.
        """
        check_motion(way, fingers, seconds, power, current_limit)
        try:
            for finger in fingers:
                self._expect_ok(f"LIMIT {finger} {current_limit}")
            for finger in fingers:
                self.position[finger] = "unknown"
                # Sent twice it starts its time anew, and it still ends.
                pwm, milliseconds = round(255 * power), round(1e3 * seconds)
                self._expect_ok(f"GO {finger} {way} {pwm} {milliseconds}")
            causes = self._wait(fingers, seconds)
        except BaseException:
            self._stop_whatever_happens()
            raise
        for finger in fingers:
            self.position[finger] = {"open": "open", "close": "closed"}[way]
        return causes

    def _wait(self, fingers: Sequence[str], seconds: float) -> dict[str, str]:
        until = self.port.now() + seconds + 1.0
        while True:
            states = {finger: self.state()[finger] for finger in fingers}
            if all(state.motion == "idle" for state in states.values()):
                break
            if self.port.now() > until:
                raise ServoFault("the hand does not stop in time; switch it off")
            self.port.sleep(0.02)
        causes = {finger: state.cause for finger, state in states.items()}
        for finger, cause in causes.items():
            if cause not in ("time", "current"):
                raise ServoFault(f"{finger} was stopped by {cause!r}; where it is, is not known")
        return causes

    def stop(self) -> None:
        """Stop both motors.

        Raises:
            BusError: If the hand does not confirm.
        """
        self._expect_ok("STOP")

    def _stop_whatever_happens(self) -> None:
        with suppress(RobotError):  # the board's own time ends it; what happened is told
            self.stop()

    def _expect_ok(self, body: str) -> None:
        answer = self.ask(body)
        if answer != "OK":
            raise ServoFault(f"the hand refuses {body!r}: {answer}")

    def ask(self, body: str) -> str:
        """Send a line and return the answer, both without checksum.

        Raises:
            PortLostError: If the port is gone.
            BusError: If no undamaged answer comes.
        """
        problem = "no answer"
        for _ in range(_ATTEMPTS):
            self.port.read(4096, 0.0)
            self.port.write(encode_line(body))
            line = self._read_line()
            if not line:
                continue
            try:
                answer = decode_line(line)
            except BusError as error:
                problem = str(error)
                continue
            if answer != "ERR checksum":
                return answer
            problem = "it receives damaged lines"
        raise BusError(
            f"no hand answers on {self.port.name} ({problem}): is it switched on, and is this its "
            "port?"
        )

    def _read_line(self) -> bytes:
        until, line = self.port.now() + _ANSWER_TIME, b""
        while not line.endswith(b"\n") and len(line) < 200:
            left = until - self.port.now()
            if left <= 0.0 or not (byte := self.port.read(1, left)):
                break
            line += byte
        return line


def encode_line(body: str) -> bytes:
    """Return a line with its checksum: the exclusive or of the bytes of the body, in hex."""
    return f"{body}*{_exclusive_or(body.encode('ascii')):02X}\n".encode("ascii")


def decode_line(line: bytes) -> str:
    """Return the body of a line.

    Raises:
        BusError: If it is not a whole, undamaged line.
    """
    body, star, rest = line.partition(b"*")
    if not star or len(rest) != 3 or not line.endswith(b"\n") or not body.isascii():
        raise BusError(f"not a whole line: {line[:40]!r}")
    if rest[:2] != f"{_exclusive_or(body):02X}".encode():
        raise BusError(f"damaged line: {line[:40]!r}")
    return body.decode("ascii")


def _exclusive_or(data: bytes) -> int:
    total = 0
    for byte in data:
        total ^= byte
    return total


def check_motion(
    way: str, fingers: Sequence[str], seconds: float, power: float, current_limit: int
) -> None:
    """Refuse what `Hand.move` cannot do; its arguments.

    Raises:
        ValueError: If an argument is out of range.
    """
    if way not in WAYS:
        raise ValueError(f"way must be one of {', '.join(WAYS)}, got {way!r}")
    if not fingers or set(fingers) - set(FINGERS):
        raise ValueError(f"fingers must be some of {', '.join(FINGERS)}, got {list(fingers)}")
    if not (math.isfinite(seconds) and 0.0 < seconds <= LONGEST_RUN):
        raise ValueError(f"seconds must be above 0, at most {LONGEST_RUN:g}, got {seconds}")
    if not 0.0 < power <= 1.0:
        raise ValueError(f"power must be above 0, at most 1, got {power}")
    if not 0 <= current_limit <= 1023:
        raise ValueError(f"current_limit must be 0 to 1023, got {current_limit}")

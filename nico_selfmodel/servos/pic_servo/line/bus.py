"""The one owner of the port: a command out, the reply of that module in, whatever the line does."""

import math

from nico_selfmodel.errors import BusError
from nico_selfmodel.servos.bus_settings import BusSettings, NoReplyError
from nico_selfmodel.servos.link_counts import LinkCounts
from nico_selfmodel.servos.pic_servo.protocol.command_packets import encode_command, may_repeat
from nico_selfmodel.servos.pic_servo.protocol.commands import (
    BAUD_CODES,
    Command,
    ReadStatus,
    SetBaud,
    StopMotor,
)
from nico_selfmodel.servos.pic_servo.protocol.packets import (
    EVERYONE,
    FIRST_GROUP,
    DamagedPacketError,
)
from nico_selfmodel.servos.pic_servo.protocol.status import (
    Status,
    StatusFlag,
    StatusItem,
    decode_status,
    reply_length,
)
from nico_selfmodel.servos.pic_servo.protocol.trajectory import TICK
from nico_selfmodel.servos.port_owner import PortOwner
from nico_selfmodel.servos.ports import Port, SerialPort

FLUSH = bytes(30)
"""Longer than the rest of any packet: ends a half-heard one with a wrong checksum."""
_LONGEST_REPLY = 20
"""Bytes, and one more."""
_QUESTIONS = (
    StatusItem.CURRENT | StatusItem.VELOCITY,
    StatusItem.POSITION | StatusItem.CURRENT,
    StatusItem.POSITION | StatusItem.VELOCITY,
    StatusItem.CURRENT,
)
"""Items whose replies have lengths that no other reply here has."""
_SILENCE = "no reply"
_STRAGGLING = 0.1
"""How late a reply may be that a later one has passed [s]."""
_DOUBLED = 2
"""So many bytes behind a reply are no other: damage may double one."""
_LATEST = 0.25
"""Longest delay of replies that every exchange waits for [s]."""
_FORGETTING = 0.7
"""What is left of a delay that was seen after each exchange that needed none of it."""


class UncertainError(BusError):
    """The reply to a command that must not be repeated was lost: it may have been carried out."""


class _ShortReplyError(DamagedPacketError):
    """A reply came with too few bytes, or none."""


class Bus(PortOwner):
    """Exchanges with modules, one at a time, from any thread.

    Raises:
        PortLostError: From its methods, if the port is gone.
    """

    def __init__(self, port: Port, settings: BusSettings | None = None) -> None:
        """Take a port over; sends nothing.

        Args:
            port: An open port that nobody else reads or writes.
        """
        super().__init__(port, settings)
        self._owed = 0
        """How many replies were given up of which no byte has come yet."""
        self._owed_since = self._asked_at = 0.0
        """When the first of those commands was sent, and the last command of all [s]."""
        self._late = 0.0
        """How late replies came lately [s]."""
        self._lengths = (0, 0)
        """Of the last replies by which it was seen that none is owed."""

    @classmethod
    def open(cls, name: str, rate: int = 19200, settings: BusSettings | None = None) -> "Bus":
        """Open a serial port for this process alone; sends nothing.

        Args:
            name: `/dev/serial/by-id/...`, or of a `SimulatedBus`.
            rate: Of the line [baud].

        Raises:
            PortLostError: If the port cannot be opened; says why.
        """
        return cls(SerialPort(name, rate), settings)

    @property
    def rate(self) -> int:
        """Rate of the line [baud]."""
        return self.port.rate

    def exchange(
        self,
        address: int,
        command: Command,
        items: int,
        *,
        repeatable: bool | None = None,
        attempts: int | None = None,
    ) -> Status:
        """Send a command to one module (or a group with a leader) and return its reply.

        Args:
            address: Of the module.
            command: What to do.
            items: What the reply will carry.
            repeatable: Whether the command may be sent again when its reply is lost; as the
                command itself says if omitted.
            attempts: How often to send it at most, instead of the settings'.

        Returns:
            The reply, undamaged, and of a command that the module did carry out.

        Raises:
            NoReplyError: If no good reply came.
            UncertainError: If none came and the command must not be repeated.
        """
        packet = encode_command(address, command)
        again = may_repeat(command) if repeatable is None else repeatable
        with self._lock:
            if (self._doubtful or self._owed) and isinstance(command, StopMotor):
                self.send_at_once(address, command)  # the line may take its time to become quiet
            if self._owed:
                self._catch_up(address, items, attempts or self.settings.attempts)
            return self._persist(packet, items, again, attempts or self.settings.attempts, address)

    def _persist(
        self, packet: bytes, items: int, again: bool, attempts: int, address: int
    ) -> Status:
        counts = self.counts[address]
        failure: BusError | None = None
        for attempt in range(attempts):
            if self._doubtful:
                counts.stray_bytes += self.resynchronise()
            try:
                status = self._attempt(packet, items, attempt, counts)
            except DamagedPacketError as error:
                failure = error
                if again:
                    continue
                counts.failures += 1
                raise UncertainError(
                    f"module {address}: the reply was lost ({error}); the command may or may not "
                    "have been carried out"
                ) from error
            if status.flags & StatusFlag.CHECKSUM_ERROR:
                counts.refused += 1  # it was not carried out, so that any command may be repeated
                failure, self._doubtful = DamagedPacketError("it got only damaged commands"), True
                continue
            # After a failure an earlier reply may still be under way; the next module must not
            # be taken for it.
            if attempt and (stray := self._drain()):
                counts.stray_bytes += stray
                self._account(stray)
                failure, self._doubtful = DamagedPacketError("its replies come late"), True
                if again:
                    continue
            counts.exchanges += 1
            return status
        counts.failures += 1
        raise NoReplyError(f"module {address} does not answer ({failure})") from failure

    def _catch_up(self, address: int, items: int, attempts: int) -> None:
        """Wait until no reply is under way that was given up: it would be taken for the next one.

        Raises:
            NoReplyError: If the module does not answer.
        """
        counts, since, crossed = self.counts[address], self._owed_since, False
        for attempt in range(attempts):
            if self._doubtful:
                stray = self.resynchronise()
                counts.stray_bytes += stray
                if crossed and stray > _DOUBLED:  # another reply came in place of the one behind it
                    self._note_lateness(since)
            if not self._owed:
                return
            try:
                stray = self._ask_otherwise(address, items, attempt)
            except DamagedPacketError as error:
                crossed = not isinstance(error, _ShortReplyError)
                continue
            if not stray:
                self._owed = 0
                return
            counts.stray_bytes += stray
            self._doubtful = True
            if stray > _DOUBLED:
                self._note_lateness(since)
        counts.failures += 1
        raise NoReplyError(f"module {address} does not answer ({_SILENCE})")

    def _ask_otherwise(self, address: int, items: int, attempt: int) -> int:
        """Ask a module for something whose reply is as long as none that may be under way.

        When that comes, what was asked for before has been answered.

        Returns:
            Number of bytes that came behind it.

        Raises:
            DamagedPacketError: If something else came, or nothing.
        """
        lengths = (reply_length(items), *self._lengths)
        question = next(one for one in _QUESTIONS if reply_length(one) not in lengths)
        self._lengths = (*self._lengths[1:], reply_length(question))
        packet = encode_command(address, ReadStatus(question))
        # Motors answer in turn, and so do adapters; still, one that is late may have been passed.
        until = self._asked_at + max(_STRAGGLING, 1.5 * self._late)
        self._attempt(packet, question, attempt, LinkCounts())
        return self._drain(until - self.port.now())

    def _note_lateness(self, since: float) -> None:
        """Be as patient from now on as a reply was late to a command sent at a time [s]."""
        self._late = min(_LATEST, max(self._late, self.port.now() - since))

    def _account(self, stray: int) -> None:
        """Note that bytes came that may be replies which were given up."""
        self._owed = max(0, self._owed - math.ceil(stray / _LONGEST_REPLY))

    def _attempt(self, packet: bytes, items: int, attempt: int, counts: LinkCounts) -> Status:
        """Send once and read exactly the reply."""
        counts.stray_bytes += len(self.port.read(4096, 0.0))
        length, self._asked_at = reply_length(items), self.port.now()
        # Until the reply is here: who interrupts this must not leave it to the next who asks.
        self._doubtful = True
        self._owed_since = self._owed_since if self._owed else self._asked_at
        self._owed += 1
        self.port.write(packet)
        patience = self._patience(len(packet) + length, attempt)
        reply = self.port.read(length, patience + self._late)
        self._owed -= bool(reply)
        if len(reply) < length:
            counts.timeouts += 1
            what = f"{len(reply)} of {length} bytes" if reply else _SILENCE
            raise _ShortReplyError(what)
        try:
            status = decode_status(items, reply)
        except DamagedPacketError:
            self._note_damage(counts)
            if reply.startswith(packet[:length]):
                raise BusError(
                    f"{self.port.name} sends back what is written to it: the adapter echoes; "
                    "switch its echo off (four wires, full duplex)"
                ) from None
            raise
        if extra := self.port.read(4096, 0.0):
            counts.stray_bytes += len(extra)
            raise DamagedPacketError(f"{len(extra)} bytes too many")
        self._doubtful = False
        if self.port.now() - self._asked_at <= patience:
            self._late *= _FORGETTING
        return status

    def _patience(self, bytes_under_way: int, attempt: int) -> float:
        """Return how long an exchange may take [s]."""
        wire = bytes_under_way * 10 / self.port.rate
        slack = self.settings.slack * min(2**attempt, 8)
        return wire + TICK + 2e-3 + 2 * self.settings.latency + slack

    def send(self, address: int, command: Command) -> None:
        """Send a command that nobody answers: to a group without a leader, or a reset.

        Args:
            address: Of the group, or of a module.
            command: What to do.
        """
        with self._lock:
            if self._doubtful:
                self.counts[address].stray_bytes += self.resynchronise()
            self._let_go(encode_command(address, command))

    def send_at_once(self, address: int, command: Command) -> None:
        """Send a command without a look at what arrives: a stop must not wait for a quiet line.

        What a module replies is thrown away before the next exchange.

        Args:
            address: Of the group, or of a module.
            command: What to do, the same twice as once.
        """
        with self._lock:
            packet = encode_command(address, command)
            self._let_go(FLUSH + packet if self._doubtful else packet)
            if address < FIRST_GROUP:
                self._doubtful = True
                self.wait(_LONGEST_REPLY * 10 / self.port.rate)

    def _let_go(self, data: bytes) -> None:
        """Write what nobody answers, and wait until it has left and is carried out."""
        self.port.write(data)
        # Written is not sent: a reply can only follow when the bytes have left.
        self.port.read(0, 0.0)
        self.wait(len(data) * 10 / self.port.rate + 2 * TICK)

    def resynchronise(self) -> int:
        """End what modules may have half heard, and wait until nothing arrives any more.

        Returns:
            Number of bytes that arrived unasked.

        Raises:
            NoisyLineError: If the line never becomes quiet.
        """
        with self._lock:
            self.port.write(FLUSH)
            self.wait(len(FLUSH) * 10 / self.port.rate)
            stray = self._drain()
            self._account(stray)
            self._doubtful = False
            return stray

    def _drain(self, at_least: float = 0.0) -> int:
        """Read until nothing has come for as long as the longest reply could take.

        Args:
            at_least: For how long at least [s].
        """
        quiet = _LONGEST_REPLY * 10 / self.port.rate + 2 * TICK + 2 * self.settings.latency
        quiet += max(self.settings.slack / 4, 1.5 * self._late)
        return self._until_quiet(max(quiet, at_least))

    def wait(self, seconds: float) -> None:
        """Let time of the port pass; what arrives meanwhile stays for the next reader."""
        self.port.sleep(seconds)

    def change_rate(self, rate: int, addresses: list[int]) -> None:
        """Change the rate of all modules and of the port, and see that all followed.

        Args:
            rate: 9600, 19200, 57600 or 115200 baud.
            addresses: The modules that must answer afterwards.

        Raises:
            ValueError: If the rate is none of these.
            NoReplyError: If a module did not follow.
        """
        if rate not in BAUD_CODES:
            raise ValueError(f"rate must be one of {sorted(BAUD_CODES)} baud, got {rate}")
        with self._lock:
            self.send(EVERYONE, SetBaud(BAUD_CODES[rate]))
            self.wait(0.02)
            self.port.set_rate(rate)
            self._doubtful = True
            for address in addresses:
                self.exchange(address, ReadStatus(StatusItem.DEVICE), StatusItem.DEVICE)

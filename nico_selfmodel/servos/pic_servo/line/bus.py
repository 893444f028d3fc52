"""The one owner of the port: a command out, the reply of that module in, whatever the line does."""

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
from nico_selfmodel.servos.ports import SerialPort

FLUSH = bytes(30)
"""Longer than the rest of any packet: ends a half-heard one with a wrong checksum."""
_LONGEST_REPLY = 20
"""Bytes, and one more."""


class UncertainError(BusError):
    """The reply to a command that must not be repeated was lost: it may have been carried out."""


class Bus(PortOwner):
    """Exchanges with modules, one at a time, from any thread.

    Raises:
        PortLostError: From its methods, if the port is gone.
    """

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
            if self._doubtful and isinstance(command, StopMotor):
                self.send_at_once(address, command)  # the line may take its time to become quiet
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
                failure, self._doubtful = DamagedPacketError("its replies come late"), True
                if again:
                    continue
            counts.exchanges += 1
            return status
        counts.failures += 1
        raise NoReplyError(f"module {address} does not answer ({failure})") from failure

    def _attempt(self, packet: bytes, items: int, attempt: int, counts: LinkCounts) -> Status:
        """Send once and read exactly the reply."""
        counts.stray_bytes += len(self.port.read(4096, 0.0))
        length = reply_length(items)
        # Until the reply is here: who interrupts this must not leave it to the next who asks.
        self._doubtful = True
        self.port.write(packet)
        reply = self.port.read(length, self._patience(len(packet) + length, attempt))
        if len(reply) < length:
            counts.timeouts += 1
            what = f"{len(reply)} of {length} bytes" if reply else "no reply"
            raise DamagedPacketError(what)
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
            self._doubtful = False
            return stray

    def _drain(self) -> int:
        """Read until nothing has come for as long as the longest reply could take."""
        quiet = _LONGEST_REPLY * 10 / self.port.rate + 2 * TICK + 2 * self.settings.latency
        quiet += self.settings.slack / 4
        return self._until_quiet(quiet)

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

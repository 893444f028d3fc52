"""The one owner of the port of servos with registers, whatever the line does."""

import math
from collections.abc import Callable, Sequence

from nico_selfmodel.errors import ServoFault
from nico_selfmodel.servos.bus_settings import BusSettings, NoReplyError
from nico_selfmodel.servos.port_owner import PortOwner
from nico_selfmodel.servos.ports import Port
from nico_selfmodel.servos.register_servo.sdk import DamagedReplyError, PacketSdk, StatusPacket
from nico_selfmodel.servos.register_servo.sdk_port import SdkPort


class RegisterBus(PortOwner):
    """Exchanges with servos, one at a time, from any thread.

    Reading and writing registers is the same twice as once: whatever was lost is sent again.

    Raises:
        PortLostError: From its methods, if the port is gone.
    """

    def __init__(self, port: Port, sdk: PacketSdk, settings: BusSettings | None = None) -> None:
        """Take a port over; sends nothing.

        Args:
            port: An open port that nobody else reads or writes.
            sdk: How packets of this make look.
        """
        super().__init__(port, settings)
        self.sdk = sdk
        self.heard = -math.inf
        """When the servos last heard a packet, as far as is known [s]."""
        self._sdk_port = SdkPort(port, self.settings)

    def read(
        self, address: int, register: int, length: int, *, attempts: int | None = None
    ) -> StatusPacket:
        """Return registers of one servo.

        Args:
            address: Its id.
            register: The first.
            length: How many bytes.
            attempts: How often to ask at most, instead of the settings'.

        Raises:
            NoReplyError: If no good reply came.
        """
        return self._persist(
            address, lambda p: self.sdk.read(p, address, register, length), length, attempts
        )

    def write(self, address: int, register: int, data: bytes) -> StatusPacket:
        """Write registers of one servo, which confirms.

        Raises:
            ServoFault: If the servo refuses.
            NoReplyError: If no good reply came.
        """
        status = self._persist(
            address, lambda p: self.sdk.write(p, address, register, data), 0, None
        )
        if refusal := self.sdk.refusal(status.error):
            raise ServoFault(f"servo {address} refuses {data.hex(' ')} at {register}: {refusal}")
        return status

    def send(self, packet: Callable[[SdkPort], None]) -> None:
        """Send a packet whose answer does not matter."""
        with self._lock:
            if self._doubtful:
                self._drain()
            self._doubtful = True
            packet(self._sdk_port)

    def sync_write(self, register: int, data: dict[int, bytes]) -> None:
        """Write the same registers of several servos at once; nobody confirms."""
        with self._lock:
            if self._doubtful:
                self._drain()
            self.sync_write_at_once(register, data)

    def sync_write_at_once(self, register: int, data: dict[int, bytes]) -> None:
        """Do the same without waiting for a quiet line, as a stop must not."""
        with self._lock:
            self.sdk.sync_write(self._sdk_port, register, data)
            self.heard = self.port.now()
            # What follows must not be sent into it.
            self.port.sleep(len(self._sdk_port.sent) * 10 / self.port.rate)

    def sync_read(
        self, register: int, length: int, addresses: Sequence[int]
    ) -> dict[int, StatusPacket]:
        """Return registers of several servos, as far as they answered undamaged."""
        missing: list[int] = list(addresses)
        found: dict[int, StatusPacket] = {}
        port, sdk, damaged = self._sdk_port, self.sdk, False
        with self._lock:
            if self._doubtful:
                self._drain()
            self._doubtful, port.attempt = True, 0
            sdk.sync_read(port, register, length, addresses)
            self.heard = self.port.now()
            port.setPacketTimeout((sdk.overhead + length) * len(addresses))
            while missing and not port.isPacketTimeout():
                try:
                    status = sdk.receive(port)
                except DamagedReplyError as error:
                    damaged = damaged or str(error) != "no reply"
                    continue
                if status.address in missing and len(status.data) == length:
                    missing.remove(status.address)
                    found[status.address] = status
                    self.counts[status.address].exchanges += 1
            self._doubtful = bool(missing)
            for address in missing:
                if damaged:
                    self._note_damage(self.counts[address])
                else:
                    self.counts[address].timeouts += 1
        return found

    def _persist(
        self, address: int, send: Callable[[SdkPort], None], length: int, attempts: int | None
    ) -> StatusPacket:
        """Send until a good reply comes."""
        counts, failure = self.counts[address], DamagedReplyError("no reply")
        with self._lock:
            late = self._doubtful
            for attempt in range(attempts or self.settings.attempts):
                if self._doubtful:
                    counts.stray_bytes += self._drain(attempt)
                try:
                    status = self._attempt(address, send, length, attempt)
                except DamagedReplyError as error:
                    failure = error
                    if str(error) != "no reply":
                        self._note_damage(counts)
                    else:
                        counts.timeouts += 1
                    continue
                # After a failure an earlier reply may still be under way; the next servo must not
                # be taken for it.
                if (attempt or late) and (stray := self._drain(attempt)):
                    counts.stray_bytes += stray
                    failure, self._doubtful = DamagedReplyError("its replies come late"), True
                    continue
                self._doubtful = False
                counts.exchanges += 1
                return status
            counts.failures += 1
        raise NoReplyError(f"servo {address} does not answer ({failure})") from failure

    def _attempt(
        self, address: int, send: Callable[[SdkPort], None], length: int, attempt: int
    ) -> StatusPacket:
        port, self._sdk_port.attempt = self._sdk_port, attempt
        # Until the reply is here: who interrupts this must not leave it to the next who asks.
        self._doubtful = True
        send(port)
        self.heard = self.port.now()
        port.setPacketTimeout(self.sdk.overhead + length)
        status = self.sdk.receive(port)
        if status.address != address or len(status.data) != length:
            raise DamagedReplyError("another reply than was asked for")
        if port.stray:
            port.stray, stray = 0, port.stray
            self.counts[address].stray_bytes += stray
        return status

    def _drain(self, attempt: int = 0) -> int:
        """Read until nothing has come for as long as a late reply could take.

        Args:
            attempt: How often the exchange under way has failed: replies that come late come later.
        """
        quiet = 1e-3 + 2.0 * self.settings.latency
        quiet += self.settings.slack / 4.0 * min(2**attempt, 8)
        stray = self._until_quiet(quiet)
        self._doubtful = False
        return stray

"""Our port as the SDKs of both makers want one: their packets, our clock and our patience."""

from nico_selfmodel.servos.bus_settings import BusSettings
from nico_selfmodel.servos.ports import Port

_BITS_PER_BYTE = 10
_TURNAROUND = 2e-3
"""What a servo takes to answer, and a line to turn round [s]."""


class SdkPort:
    """Has the methods that the SDKs call of their `PortHandler`, by the names they call.

    Theirs spins until a reply is complete; this one waits for the bytes, in the time of the port.
    """

    def __init__(self, port: Port, settings: BusSettings) -> None:
        """Take a port."""
        self.port, self.settings = port, settings
        self.attempt = 0
        """How often the exchange under way has failed: each time it may take longer."""
        self.stray = 0
        """Bytes that nobody had asked for."""
        self.sent = b""
        """The last packet."""
        self._deadline = 0.0

    @property
    def is_using(self) -> bool:
        """Whether another thread uses it: never, the bus has a lock of its own."""
        return False

    @is_using.setter
    def is_using(self, value: bool) -> None:
        """Do nothing: an exchange that was interrupted must not leave the port in use."""

    def clearPort(self) -> None:
        """Throw away what has arrived unasked."""
        self.stray += len(self.port.read(4096, 0.0))

    def writePort(self, packet: list[int]) -> int:
        """Send a packet; returns how many bytes it has."""
        self.sent = bytes(packet)
        self.port.write(self.sent)
        return len(self.sent)

    def readPort(self, length: int) -> bytes:
        """Return so many bytes, or fewer at the end of patience."""
        left = self._deadline - self.port.now()
        return self.port.read(length, max(0.0, left)) if length > 0 else b""

    def setPacketTimeout(self, packet_length: int) -> None:
        """Begin to wait for so many bytes."""
        wire = (len(self.sent) + packet_length) * _BITS_PER_BYTE / self.port.rate
        slack = self.settings.slack * min(2**self.attempt, 8)
        patience = wire + _TURNAROUND + 2.0 * self.settings.latency + slack
        self._deadline = self.port.now() + patience

    def isPacketTimeout(self) -> bool:
        """Return whether patience has ended."""
        return self.port.now() >= self._deadline - 1e-9

    def getBaudRate(self) -> int:
        """Return the rate of the line [baud]."""
        return self.port.rate

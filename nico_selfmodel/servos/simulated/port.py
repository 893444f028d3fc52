"""The port of a simulated device in virtual time: minutes on the arm are seconds in a test."""

from nico_selfmodel.servos.ports import PortLostError
from nico_selfmodel.servos.simulated.line import BITS_PER_BYTE
from nico_selfmodel.servos.simulated.pseudo_terminal import Device


class SimulatedPort:
    """A simulated device without a pseudo-terminal, in a time that passes only when it is used.

    Every delay is the device's, none the machine's, so that a run is the same each time.
    """

    def __init__(self, line: Device, rate: int = 19200) -> None:
        """Connect to a device.

        Args:
            line: What is at the other end.
            rate: Baud.
        """
        self.name, self.rate = "simulated", rate
        self.line = line
        self.time = 0.0
        """The virtual clock [s]."""
        self.unplugged = False
        self._buffer = bytearray()

    def now(self) -> float:
        """Return the virtual time [s]."""
        return self.time

    def sleep(self, seconds: float) -> None:
        """Let virtual time pass; what arrives meanwhile waits."""
        self.time += seconds
        self._buffer += self.line.due(self.time)
        self.line.advance(self.time)

    def write(self, data: bytes) -> None:
        """Send all bytes; returns at once, as a serial driver does."""
        self._check()
        self._buffer += self.line.due(self.time)
        self.line.receive(data, self.time, self.rate)

    def read(self, count: int, timeout: float) -> bytes:
        """Return `count` bytes, or fewer if the time [s] runs out first."""
        self._check()
        until = self.time + timeout
        self._buffer += self.line.due(self.time)
        while len(self._buffer) < count:
            event = self.line.next_event()
            if event is None or event > until:
                self.time = until
                self._buffer += self.line.due(until)
                break
            self.time = max(self.time, event)
            self._buffer += self.line.due(self.time)
        data = bytes(self._buffer[:count])
        del self._buffer[:count]
        return data

    def set_rate(self, rate: int) -> None:
        """Change the rate [baud] once everything written has left."""
        self._check()
        while (event := self.line.next_event()) is not None:
            self.time = max(self.time, event)
            self._buffer += self.line.due(self.time)
        self.sleep(BITS_PER_BYTE / rate)
        self.rate = rate

    def close(self) -> None:
        """Do nothing."""

    def _check(self) -> None:
        if self.unplugged:
            raise PortLostError(f"port {self.name} is gone: plug the adapter in again")

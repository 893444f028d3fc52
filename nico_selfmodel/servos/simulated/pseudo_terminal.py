"""A simulated device behind a pseudo-terminal: real bytes at the real pace, served by a thread."""

import os
import pty
import select
import termios
import threading
import time
import tty
from typing import Generic, Protocol, Self, TypeVar

_RATES = {
    getattr(termios, name): int(name[1:])
    for name in dir(termios)
    if name[0] == "B" and name[1:].isdecimal()
}
_IDLE = 5e-3
_BUFFER = 62


class Device(Protocol):
    """Something at the other end of a line, that knows no time but what it is told."""

    def receive(self, data: bytes, now: float, rate: int) -> None:
        """Take bytes that the host begins to send now."""
        ...

    def advance(self, now: float) -> None:
        """Let everything happen that happens until now."""
        ...

    def due(self, now: float) -> bytes:
        """Return the bytes that have reached the host by now."""
        ...

    def next_event(self) -> float | None:
        """Return when the next byte arrives somewhere, None if none is under way."""
        ...


DeviceT = TypeVar("DeviceT", bound=Device)


class PseudoTerminal(Generic[DeviceT]):
    """Serves a device on a pseudo-terminal while it is entered; `name` is what to open."""

    def __init__(self, device: DeviceT, latency: float = 1e-3) -> None:
        """Describe it; nothing runs before it is entered.

        Args:
            device: What to serve.
            latency: How long the adapter holds on to bytes that arrive [s].
        """
        self.device, self.latency = device, latency
        self.name = ""
        """The device to open, while it runs."""
        self.lock = threading.RLock()
        """Hold it while changing the device."""
        self._master = self._slave = self._wake_read = self._wake_write = -1
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self._wake_read, self._wake_write = os.pipe()
        self.name = os.ttyname(self._slave)
        self._thread = threading.Thread(target=self._serve, name="simulation", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.unplug()
        for handle in (self._wake_read, self._wake_write):
            os.close(handle)

    def unplug(self) -> None:
        """Pull the cable: the terminal disappears."""
        if self._thread is None:
            return
        os.write(self._wake_write, b"x")
        self._thread.join()
        self._thread = None
        # This side kept the other end open, so that a client may come and go.
        os.close(self._slave)
        os.close(self._master)

    def _serve(self) -> None:
        waiting, last, event = bytearray(), 0.0, None
        while True:
            with self.lock:
                now = time.monotonic()
                arrived = self.device.due(now)
                event, expected = self.device.next_event(), event
            if arrived:  # at the time it was expected: this thread may wake up late
                waiting, last = waiting + arrived, min(now, expected or now)
            # As an adapter does: what has arrived is handed on together.
            if waiting and (now - last >= self.latency or len(waiting) >= _BUFFER):
                os.write(self._master, waiting)
                waiting.clear()
            times = [now + _IDLE, *([last + self.latency] if waiting else [])]
            until = min(times if event is None else [*times, event])
            pause = max(0.0, until - time.monotonic())
            ready = select.select([self._master, self._wake_read], [], [], pause)[0]
            if self._wake_read in ready:
                return
            if self._master in ready:
                data = os.read(self._master, 4096)
                rate = _RATES.get(termios.tcgetattr(self._master)[5], 9600)
                with self.lock:
                    self.device.receive(data, time.monotonic(), rate)

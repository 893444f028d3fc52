"""The byte stream that a bus owns, and a real serial port as one."""

import errno
import os
import select
import time
from contextlib import suppress
from typing import Protocol

from nico_selfmodel.errors import BusError

_LONGEST_READ = 4096


class PortLostError(BusError):
    """The port is gone: unplugged, or never opened."""


class Port(Protocol):
    """A byte stream with a clock of its own."""

    name: str
    rate: int
    """Baud."""

    def now(self) -> float:
        """Return the time [s]."""
        ...

    def sleep(self, seconds: float) -> None:
        """Let time pass; what arrives meanwhile waits."""
        ...

    def write(self, data: bytes) -> None:
        """Send all bytes."""
        ...

    def read(self, count: int, timeout: float) -> bytes:
        """Return `count` bytes, or fewer if the time [s] runs out first."""
        ...

    def set_rate(self, rate: int) -> None:
        """Change the rate [baud] once everything written has left."""
        ...

    def close(self) -> None:
        """Give the device back."""
        ...


class SerialPort:
    """A serial device, opened for this process alone. Opening sends nothing."""

    def __init__(self, name: str, rate: int = 19200) -> None:
        """Open a device.

        Args:
            name: `/dev/serial/by-id/...`, `/dev/ttyUSB0`, a pseudo-terminal.
            rate: Baud.

        Raises:
            PortLostError: If it does not exist, may not be used or is used by another program.
        """
        self.name, self.rate = name, rate
        self.low_latency = False
        """Whether the adapter hands on bytes after 1 ms instead of 16."""
        self._open()

    def _open(self) -> None:
        import serial

        try:
            self._serial = serial.Serial(self.name, self.rate, timeout=0, exclusive=True)
            self._serial.reset_input_buffer()
        except (OSError, ValueError, *_terminal_errors()) as error:
            raise PortLostError(_why_not(self.name, error)) from error
        _take_alone(self._serial.fileno(), self.name)
        try:
            self._serial.set_low_latency_mode(True)
            self.low_latency = True
        except (OSError, ValueError, NotImplementedError):
            self.low_latency = False  # a pseudo-terminal, or an adapter without it

    def now(self) -> float:
        """Return the time [s]."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Let time pass; what arrives meanwhile waits."""
        time.sleep(seconds)

    def write(self, data: bytes) -> None:
        """Send all bytes.

        Raises:
            PortLostError: If the device is gone or takes no bytes for a second.
        """
        handle = self._handle()
        try:
            while data:
                if not select.select([], [handle], [], 1.0)[1]:
                    raise PortLostError(f"{self.name} takes no more bytes: check the adapter")
                data = data[os.write(handle, data) :]
        except OSError as error:
            raise self._lost(error) from error

    def read(self, count: int, timeout: float) -> bytes:
        """Return `count` bytes, or fewer if the time [s] runs out first.

        Raises:
            PortLostError: If the device is gone.
        """
        handle, until, data = self._handle(), time.monotonic() + timeout, b""
        try:
            while len(data) < count:
                left = max(0.0, until - time.monotonic())
                if not select.select([handle], [], [], left)[0]:
                    break
                arrived = os.read(handle, min(count - len(data), _LONGEST_READ))
                if not arrived:
                    raise PortLostError(self._unplugged())
                data += arrived
        except BlockingIOError:
            pass
        except OSError as error:
            raise self._lost(error) from error
        return data

    def set_rate(self, rate: int) -> None:
        """Change the rate [baud] once everything written has left.

        Raises:
            PortLostError: If the device is gone.
        """
        self._handle()
        try:
            self._serial.flush()
            self._serial.baudrate = self.rate = rate
        except (OSError, *_terminal_errors()) as error:
            raise self._lost(error) from error

    def close(self) -> None:
        """Give the device back; never fails."""
        try:
            self._serial.close()
        except (OSError, *_terminal_errors()):
            pass  # it is gone already

    def _handle(self) -> int:
        if not self._serial.is_open:
            raise PortLostError(f"{self.name} is closed: open it first")
        return self._serial.fileno()

    def _unplugged(self) -> str:
        return f"{self.name} is gone: plug the adapter in again, then connect anew"

    def _lost(self, error: BaseException) -> PortLostError:
        return error if isinstance(error, PortLostError) else PortLostError(self._unplugged())


def _terminal_errors() -> tuple[type[BaseException], ...]:
    import termios

    return (termios.error,)  # no OSError, unlike every other error of a port


def _take_alone(handle: int, name: str) -> None:
    """Let no program open the device beside us, also one that asks for no lock."""
    import fcntl
    import termios

    # A pseudo-terminal would stay locked when a program is killed: its other side keeps it open.
    if not os.path.realpath(name).startswith("/dev/pts/"):
        with suppress(OSError):
            fcntl.ioctl(handle, termios.TIOCEXCL)


def _why_not(name: str, error: BaseException) -> str:
    """Say why a device cannot be opened and what to do."""
    number = getattr(error, "errno", None)
    if number is None:  # pyserial tells it only in words; what it caught has the number
        cause = error.__context__ or error
        number = cause.args[0] if cause.args else None
    if number == errno.ENOENT:
        return f"port {name} does not exist; {_ports_here()}"
    if number in (errno.EACCES, errno.EPERM):
        return f"no permission for port {name}: join the group that owns it (often 'dialout')"
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in str(error):
        return f"port {name} is in use: end the other program, it may be another servo command"
    if number in (errno.ENOTTY, errno.EISDIR, errno.EINVAL):
        return f"{name} is not a serial port; {_ports_here()}"
    return f"port {name} cannot be opened: {error}"


def _ports_here() -> str:
    from serial.tools.list_ports import comports

    found = sorted(port.device for port in comports())
    return f"found {', '.join(found)}" if found else "no serial port is plugged in"

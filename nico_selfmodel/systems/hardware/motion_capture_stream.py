"""Motion capture over TCP, as the thesis' Vicon link: newline-delimited JSON in UTF-8.

The server sends, each on a line of its own:

    {"format": "nico-motion-capture/1", "markers": ["hand"], "unit": "m"}     first, once
    {"frame": 12, "time_s": 0.12, "hand": [0.1, -0.2, 0.3]}                   for every frame
    {"frame": 13, "time_s": 0.13, "hand": null}                               a marker that was lost
    {"end": true}                                                             before it closes

It listens on this machine only unless told otherwise, and reads nothing. A client that reads too
slowly misses frames, never halves of them.
"""

import contextlib
import json
import queue
import socket
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import RobotError
from nico_selfmodel.with_blocks import ClosedAtEnd

FORMAT = "nico-motion-capture/1"
LOOPBACK = "127.0.0.1"
_BACKLOG = 64
"""Frames kept for a client that reads slowly; older ones are dropped."""
_LONGEST = 1 << 16
"""A line longer than this is none of ours [bytes]."""


@dataclass(frozen=True, eq=False)
class MarkerFrame:
    """What motion capture saw at one time."""

    frame: int
    """Number of the frame."""
    time: float
    """When [s]."""
    positions: Mapping[str, NDArray | None]
    """Measured position of each marker in the tracker's frame [m], None where it was lost."""


class MotionCaptureServer(ClosedAtEnd):
    """Hands frames to whoever has connected. Close it, or use it in a `with` block."""

    def __init__(self, markers: Sequence[str], host: str = LOOPBACK, port: int = 0) -> None:
        """Start to listen.

        Args:
            markers: Names of the markers; `frame`, `time_s` and `end` are taken.
            host: Address to listen at; only this machine by default.
            port: Port; any free one by default, see `address`.

        Raises:
            RobotError: If the address cannot be listened at.
            ValueError: If a marker has a name that is taken.
        """
        taken = {"frame", "time_s", "end"} & set(markers)
        if taken or len(set(markers)) != len(markers):
            raise ValueError(f"markers must have other names, each its own, got {list(markers)}")
        self.markers = tuple(markers)
        try:
            self._listener = socket.create_server((host, port))
        except OSError as error:
            raise RobotError(
                f"motion capture cannot listen at {host}:{port}: {error.strerror or error}"
            ) from error
        self._listener.settimeout(0.1)
        self._lock = threading.Lock()
        self._clients: list[_Client] = []
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._accept, name="motion-capture", daemon=True)
        self._thread.start()

    @property
    def address(self) -> tuple[str, int]:
        """Host and port."""
        host, port = self._listener.getsockname()[:2]
        return host, port

    @property
    def clients(self) -> int:
        """How many are connected."""
        with self._lock:
            self._clients = [client for client in self._clients if client.alive]
            return len(self._clients)

    def send(self, frame: MarkerFrame) -> None:
        """Send a frame to all clients; those that went away are forgotten. Never waits."""
        line = {"frame": int(frame.frame), "time_s": float(frame.time)}
        places: dict[str, list[float] | None] = {}
        for marker in self.markers:
            p = frame.positions[marker]
            places[marker] = None if p is None else [float(x) for x in p]
        self._broadcast({**line, **places})

    def close(self) -> None:
        """Tell the clients that this was the end, and close everything."""
        if self._closing.is_set():
            return
        self._broadcast({"end": True})
        self._closing.set()
        self._thread.join()
        self._listener.close()
        with self._lock:
            for client in self._clients:
                client.finish()

    def _broadcast(self, message: Mapping[str, object]) -> None:
        line = (json.dumps(message, allow_nan=False) + "\n").encode()
        with self._lock:
            self._clients = [client for client in self._clients if client.alive]
            for client in self._clients:
                client.put(line)

    def _accept(self) -> None:
        greeting = {"format": FORMAT, "markers": list(self.markers), "unit": "m"}
        line = (json.dumps(greeting) + "\n").encode()
        while not self._closing.is_set():
            try:
                connection, _ = self._listener.accept()
            except TimeoutError:
                continue
            except OSError:
                return
            with self._lock:
                client = _Client(connection)
                client.put(line)
                self._clients.append(client)


class _Client:
    """One connection with a thread that writes to it, so that a slow one holds up nobody."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._connection.settimeout(5.0)
        self._lines: queue.Queue[bytes | None] = queue.Queue(_BACKLOG)
        self._thread = threading.Thread(target=self._write, name="motion-capture-client")
        self._thread.daemon = True
        self._thread.start()

    @property
    def alive(self) -> bool:
        return self._thread.is_alive()

    def put(self, line: bytes | None) -> None:
        while True:
            try:
                return self._lines.put_nowait(line)
            except queue.Full:
                self._drop()

    def _drop(self) -> None:
        with contextlib.suppress(queue.Empty):
            self._lines.get_nowait()

    def finish(self) -> None:
        self.put(None)
        self._thread.join()

    def _write(self) -> None:
        with self._connection:
            try:
                for line in iter(self._lines.get, None):
                    self._connection.sendall(line)
            except OSError:
                return


class MotionCaptureClient(ClosedAtEnd):
    """Receives frames. Close it, or use it in a `with` block."""

    def __init__(self, address: tuple[str, int], timeout: float = 5.0) -> None:
        """Connect.

        Args:
            address: Host and port of the server.
            timeout: How long to wait for the connection and for every frame [s].

        Raises:
            RobotError: If nobody answers there, or something else does.
        """
        self._name = f"motion capture at {address[0]}:{address[1]}"
        try:
            self._connection = socket.create_connection(address, timeout)
        except OSError as error:
            raise RobotError(
                f"{self._name} cannot be reached: {error.strerror or error}: is its server running?"
            ) from error
        self._timeout, self._rest = timeout, b""
        try:
            greeting = self._line()
            if greeting.get("format") != FORMAT:
                raise RobotError(f"{self._name} speaks {greeting.get('format')!r}, not {FORMAT}")
            self.markers = tuple(greeting["markers"])
        except BaseException:
            self._connection.close()
            raise

    def next(self) -> MarkerFrame:
        """Wait for the next frame.

        Raises:
            RobotError: If it does not come in time, the server went away or ended, or it sent
                something that is no frame.
        """
        line = self._line()
        if "end" in line:
            raise RobotError(f"{self._name} has ended: its server was closed")
        try:
            positions = {marker: _position(line[marker]) for marker in self.markers}
            return MarkerFrame(
                int(line["frame"]), float(line["time_s"]), MappingProxyType(positions)
            )
        except (KeyError, TypeError, ValueError) as error:
            raise RobotError(f"{self._name} sent no frame: {error}") from error

    def latest(self) -> MarkerFrame:
        """Return the newest frame there is, and wait for one only if there is none.

        Raises:
            RobotError: As `next`.
        """
        frame = self.next()
        while b"\n" in self._rest or self._more():
            frame = self.next()
        return frame

    def close(self) -> None:
        """Hang up."""
        self._connection.close()

    def _more(self) -> bool:
        """Take what has arrived without waiting; tell whether a whole line is there."""
        self._connection.setblocking(False)
        try:
            received = self._connection.recv(_LONGEST)
        except BlockingIOError:
            return False
        except OSError:
            return False
        finally:
            self._connection.settimeout(self._timeout)
        self._rest += received
        return b"\n" in self._rest

    def _line(self) -> dict[str, Any]:
        """Read one line.

        Raises:
            RobotError: If there is none.
        """
        while b"\n" not in self._rest:
            try:
                received = self._connection.recv(_LONGEST)
            except TimeoutError as error:
                raise RobotError(f"{self._name} was silent for {self._timeout:g} s") from error
            except OSError as error:
                raise RobotError(f"{self._name} went away: {error.strerror or error}") from error
            if not received:
                raise RobotError(f"{self._name} went away without saying so")
            self._rest += received
            if len(self._rest) > 4 * _LONGEST:
                raise RobotError(f"{self._name} sends no lines: it is something else")
        line, _, self._rest = self._rest.partition(b"\n")
        try:
            message = json.loads(line)
        except ValueError as error:
            raise RobotError(f"{self._name} sent no JSON: {line[:60]!r}") from error
        if not isinstance(message, dict):
            raise RobotError(f"{self._name} sent no frame: {line[:60]!r}")
        return message


def _position(value: object) -> NDArray | None:
    if value is None:
        return None
    p = np.array(value, dtype=float)
    if p.shape != (3,) or not np.isfinite(p).all():
        raise ValueError(f"a position is three numbers or null, got {value!r}")
    p.flags.writeable = False
    return p

"""The motor server: other processes read the arm's state, and one at a time commands it.

One JSON object a line over TCP on this machine, each answered by one line: see docs/servos.md.
"""

import json
import math
import secrets
import socket
import socketserver
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from nico_selfmodel.errors import BusError, RobotError, SelfModelError
from nico_selfmodel.servos.arm_loop import ArmLoop
from nico_selfmodel.servos.controller import ArmController

LOOPBACK = "127.0.0.1"
DEFAULT_PORT = 4747
LONGEST_LINE = 65536
SHORTEST_LEASE, LONGEST_LEASE = 0.1, 10.0
_MOST_CLIENTS = 32


class _RefusedError(SelfModelError):
    """A request that cannot be granted; its message is the answer."""


class MotorServer:
    """Serves one arm to the processes of this machine.

    Whoever holds the lease may command; it must speak in time, or the lease ends and the arm
    stops, as it does when its connection closes. Anybody may read, and anybody may stop.
    """

    def __init__(self, loop: ArmLoop, port: int = DEFAULT_PORT) -> None:
        """Take an arm over; nothing listens before it is entered.

        Args:
            loop: A running loop; the server gives it its heartbeat.
            port: TCP port on the loopback interface; 0 lets the system choose.
        """
        self.loop, self.port = loop, port
        self._lock = threading.RLock()
        self._lease: str | None = None
        self._seconds = 1.0
        self._ends = -math.inf
        self._holder: object | None = None
        self._closing = threading.Event()
        self._clients: set[socket.socket] = set()
        self._server: socketserver.ThreadingTCPServer | None = None
        self._threads: list[threading.Thread] = []

    def __enter__(self) -> "MotorServer":
        try:
            self._server = _Server((LOOPBACK, self.port), _Handler)
        except OSError as error:
            raise BusError(
                f"the motor server cannot listen on {LOOPBACK}:{self.port}: {error.strerror}; "
                "another one may be running, or give another --tcp-port"
            ) from error
        self._server.motor_server = self  # type: ignore[attr-defined]
        self.port = self._server.server_address[1]
        for target in (lambda: self._server and self._server.serve_forever(0.05), self._watch):
            thread = threading.Thread(target=target, name="motor server", daemon=True)
            thread.start()
            self._threads.append(thread)
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        if self._server is not None:
            self._server.shutdown()
            for client in list(self._clients):
                _hang_up(client)
            self._server.server_close()
        for thread in self._threads:
            thread.join()

    def wait(self, timeout: float | None = None) -> None:
        """Serve until the arm fails, or for a time [s].

        Raises:
            RobotError: What the arm failed with.
        """
        until = math.inf if timeout is None else time.monotonic() + timeout
        while time.monotonic() < until and not self._closing.wait(0.1):
            self.loop.check()

    def answer(self, request: Any, client: object) -> dict[str, Any]:
        """Return the answer to one request.

        Args:
            request: What the line held.
            client: Whose connection it came from.
        """
        try:
            if not isinstance(request, Mapping) or not isinstance(request.get("op"), str):
                raise _RefusedError('a request is an object with an "op"')
            handler = getattr(self, f"_op_{request['op']}", None)
            if handler is None:
                known = ", ".join(name[4:] for name in sorted(dir(self)) if name[:4] == "_op_")
                raise _RefusedError(f"no op {request['op']!r}; there are {known}")
            return {"ok": True, **handler(request, client)}
        except (SelfModelError, ValueError, TypeError) as error:
            return {"ok": False, "error": " ".join(str(error).split())}

    def hung_up(self, client: object) -> None:
        """Note that a connection closed; the arm stops if it held the lease."""
        self._end_lease(client)

    def _op_state(self, request: Mapping[str, Any], client: object) -> dict[str, Any]:
        state = self.loop.state()
        if state is None:
            raise _RefusedError("the arm was not read yet")
        return {"state": state.to_mapping(), "leased": self._lease is not None}

    def _op_describe(self, request: Mapping[str, Any], client: object) -> dict[str, Any]:
        arm = self.loop.arm
        joints = {
            name: {
                "lower_rad": float(low),
                "upper_rad": float(high),
                "max_speed_rad_s": float(speed),
            }
            for name, (low, high), speed in zip(
                arm.joints, arm.limits.positions, arm.limits.speeds, strict=True
            )
        }
        return {"robot": arm.config.name, "joints": joints}

    def _op_lease(self, request: Mapping[str, Any], client: object) -> dict[str, Any]:
        seconds = float(request.get("seconds", 1.0))
        if not SHORTEST_LEASE <= seconds <= LONGEST_LEASE:
            raise _RefusedError(
                f"seconds must be {SHORTEST_LEASE} to {LONGEST_LEASE}, got {seconds}"
            )
        with self._lock:
            if self._lease is not None:
                raise _RefusedError("another process holds the lease; wait until it gives it back")
            self._lease, self._holder = secrets.token_hex(8), client
            self._seconds = seconds
            self._extend()
            return {"lease": self._lease, "seconds": seconds}

    def _op_renew(self, request: Mapping[str, Any], client: object) -> dict[str, Any]:
        self._require_lease(request)
        return {}

    def _op_release(self, request: Mapping[str, Any], client: object) -> dict[str, Any]:
        self._require_lease(request)
        self._end_lease()
        return {}

    def _op_enable(self, request: Mapping[str, Any], client: object) -> dict[str, Any]:
        self._require_lease(request)
        joints = request.get("joints")
        if not (joints is None or isinstance(joints, list)):
            raise _RefusedError(f'"joints" must be a list of names, got {joints!r}')
        self._do(request, lambda arm: arm.enable(joints))
        return {}

    def _op_move(self, request: Mapping[str, Any], client: object) -> dict[str, Any]:
        self._require_lease(request)
        targets = request.get("targets")
        if not isinstance(targets, Mapping) or not targets:
            raise _RefusedError('"targets" must be an object: joint -> angle [rad]')
        for name, value in targets.items():
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise _RefusedError(f"the target of {name} must be a number, got {value!r}")
        speed = request.get("speed_rad_s")
        if isinstance(speed, bool) or not isinstance(speed, int | float | None):
            raise _RefusedError(f'"speed_rad_s" must be a number, got {speed!r}')
        return {"seconds": self._do(request, lambda arm: arm.move(targets, speed=speed))}

    def _do(self, request: Mapping[str, Any], action: Callable[[ArmController], Any]) -> Any:
        """Let the loop do something, unless the lease ends before it comes to it."""

        def still_leased(arm: ArmController) -> Any:
            self._require_lease(request)
            return action(arm)

        return self.loop.call(still_leased)

    def _op_stop(self, request: Mapping[str, Any], client: object) -> dict[str, Any]:
        self.loop.stop()
        return {}

    def _require_lease(self, request: Mapping[str, Any]) -> None:
        with self._lock:
            if self._lease is None:
                raise _RefusedError('no lease: ask for one with {"op": "lease"}')
            if request.get("lease") != self._lease:
                raise _RefusedError("this is not the lease that is valid now")
            self._extend()

    def _extend(self) -> None:
        self._ends = time.monotonic() + self._seconds
        self.loop.heartbeat()

    def _end_lease(self, holder: object | None = None) -> None:
        """End the lease, if `holder` is given only where it is theirs, and stop the arm."""
        with self._lock:
            if holder is not None and self._holder is not holder:
                return
            self._lease = self._holder = None
            self._ends = -math.inf
        # Not under the lock, for which the arm's thread may wait: see `_do`.
        with suppress(RobotError):  # without heartbeats it stops all the same
            self.loop.stop()

    def _watch(self) -> None:
        """Keep the arm alive while a lease is valid, and stop it when it ends."""
        pause = self.loop.arm.config.heartbeat / 4
        while not self._closing.wait(pause):
            with self._lock:
                leased, valid = self._lease is not None, time.monotonic() < self._ends
                if leased and valid:
                    self.loop.heartbeat()
            if leased and not valid:
                self._end_lease()


class _Server(socketserver.ThreadingTCPServer):
    allow_reuse_address = True
    daemon_threads = True
    request_queue_size = _MOST_CLIENTS


class _Handler(socketserver.StreamRequestHandler):
    def handle(self) -> None:
        """Answer line after line until the client hangs up."""
        owner: MotorServer = self.server.motor_server  # type: ignore[attr-defined]
        clients = owner._clients
        if len(clients) >= _MOST_CLIENTS:
            self._say({"ok": False, "error": "too many clients"})
            return
        clients.add(self.connection)
        try:
            while line := self.rfile.readline(LONGEST_LINE + 1):
                if len(line) > LONGEST_LINE:
                    self._say({"ok": False, "error": f"a line has at most {LONGEST_LINE} bytes"})
                    return
                self._say(owner.answer(_parsed(line), self))
        except OSError:
            pass  # the client is gone
        finally:
            clients.discard(self.connection)
            owner.hung_up(self)

    def _say(self, answer: Mapping[str, Any]) -> None:
        self.wfile.write(json.dumps(answer, allow_nan=False).encode() + b"\n")


def _parsed(line: bytes) -> Any:
    try:
        return json.loads(line)
    except (ValueError, RecursionError):
        return None


def _hang_up(client: socket.socket) -> None:
    with suppress(OSError):  # it was quicker
        client.shutdown(socket.SHUT_RDWR)

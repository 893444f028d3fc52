"""A client of the motor server, for other Python processes."""

import json
import socket
from collections.abc import Mapping
from typing import Any

from nico_selfmodel.errors import RobotError
from nico_selfmodel.servos.line_server import LOOPBACK
from nico_selfmodel.servos.motor_server import DEFAULT_PORT

_LONGEST_ANSWER = 1 << 20


class MotorClient:
    """Talks to the motor server of this machine, one request at a time.

    A server hangs up on who is silent for long; one without a lease then connects again by itself.
    """

    def __init__(self, port: int = DEFAULT_PORT, timeout: float = 10.0) -> None:
        """Connect.

        Args:
            port: TCP port of the server.
            timeout: Longest wait for an answer [s].

        Raises:
            RobotError: If no server listens there.
        """
        self._port, self._timeout = port, timeout
        self.lease: str | None = None
        """What `take_lease` was given."""
        self._connect()

    def _connect(self) -> None:
        try:
            self._socket = socket.create_connection((LOOPBACK, self._port), self._timeout)
        except OSError as error:
            raise RobotError(
                f"no motor server on {LOOPBACK}:{self._port}: start one with nico-selfmodel "
                "servo serve"
            ) from error
        self._lines = self._socket.makefile("rb")

    def __enter__(self) -> "MotorClient":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Hang up; a lease ends with it, and the arm stops."""
        self._lines.close()
        self._socket.close()

    def ask(self, op: str, **values: Any) -> dict[str, Any]:
        """Send a request and return the answer, the lease with it if there is one.

        Args:
            op: What is asked, as `docs/servos.md` lists.
            values: What belongs to it.

        Raises:
            RobotError: If the server refuses, fails or is gone; says why.
        """
        request = {"op": op, **values}
        if self.lease is not None:
            request.setdefault("lease", self.lease)
        sent = json.dumps(request).encode() + b"\n"
        line = self._exchange(sent)
        if not line and self.lease is None:
            self.close()
            self._connect()
            line = self._exchange(sent)
        if not line:
            raise RobotError("the motor server has hung up")
        return self._understood(line)

    def _exchange(self, sent: bytes) -> bytes:
        """Send a line and return the one that comes back, nothing where the server hung up."""
        try:
            self._socket.sendall(sent)
            return self._lines.readline(_LONGEST_ANSWER)
        except TimeoutError as error:
            raise RobotError(
                f"the motor server does not answer within {self._timeout:g} s"
            ) from error
        except ConnectionError:
            return b""
        except (OSError, ValueError) as error:
            raise RobotError(f"the motor server cannot be asked: {error}") from error

    def _understood(self, line: bytes) -> dict[str, Any]:
        try:
            answer = json.loads(line)
            done = answer.pop("ok")
        except (ValueError, RecursionError, AttributeError, KeyError, TypeError) as error:
            raise RobotError(
                f"what listens on {LOOPBACK}:{self._port} is no motor server: {line[:60]!r}"
            ) from error
        if not done:
            raise RobotError(str(answer.get("error")))
        return answer

    def take_lease(self, seconds: float = 1.0) -> None:
        """Become the one who commands; ask something within the time, or the arm stops.

        Raises:
            RobotError: If another process has it.
        """
        self.lease = self.ask("lease", seconds=seconds)["lease"]

    def state(self) -> dict[str, Any]:
        """Return the state of the arm.

        Raises:
            RobotError: If the arm has failed.
        """
        return self.ask("state")["state"]

    def move(self, targets: Mapping[str, float], speed: float | None = None) -> float:
        """Send joints to displacements.

        Args:
            targets: Joint -> displacement [rad]; joints that are not named stay.
            speed: Largest joint speed [rad/s]; the limits if omitted.

        Returns:
            How long it will take [s].

        Raises:
            RobotError: If the server refuses.
        """
        return self.ask("move", targets=dict(targets), speed_rad_s=speed)["seconds"]

    def stop(self) -> None:
        """Stop the arm; needs no lease.

        Raises:
            RobotError: If a joint did not confirm.
        """
        self.ask("stop")

"""The motor server: other processes read the arm's state, and one at a time commands it.

One JSON object a line over TCP on this machine, each answered by one line: see docs/servos.md.
"""

import asyncio
import math
import secrets
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

from nico_selfmodel.errors import BusError, RobotError, SelfModelError
from nico_selfmodel.servos.arm_loop import ArmLoop
from nico_selfmodel.servos.motor_driver import MotorDriver
from nico_selfmodel.servos.server.line_server import IDLE, LOOPBACK, LineClient, LineServer
from nico_selfmodel.servos.server.motor_requests import (
    NotARequestError,
    RefusedError,
    brief,
    number,
    read_request,
)

DEFAULT_PORT = 4747
SHORTEST_LEASE, LONGEST_LEASE = 0.1, 10.0
_LONGEST_ERROR = 300

_Answer = dict[str, Any]


class MotorServer:
    """Serves one arm to the processes of this machine.

    Whoever holds the lease may command; it must speak in time, or the lease ends and the arm
    stops, as it does when its connection closes. Anybody may read, and anybody may stop: a stop
    waits for no other request, whoever sent it.
    """

    def __init__(self, loop: ArmLoop, port: int = DEFAULT_PORT, *, idle: float = IDLE) -> None:
        """Take an arm over; nothing listens before it is entered.

        Args:
            loop: A running loop; the server gives it its heartbeat.
            port: TCP port on the loopback interface; 0 lets the system choose.
            idle: After how long without a request a client is hung up on [s].
        """
        self.loop, self.port = loop, port
        self._lock = threading.RLock()
        self._lease: str | None = None
        self._seconds = 1.0
        self._ends = -math.inf
        self._holder: LineClient | None = None
        self._closing = threading.Event()
        self._lines = LineServer(self._answer, self._end_lease_of, idle=idle)
        self._watcher = threading.Thread(target=self._watch, name="motor server", daemon=True)
        # A stop must not wait behind a command that waits for the arm.
        self._stopper = ThreadPoolExecutor(1, "motor server stop")
        self._commander = ThreadPoolExecutor(1, "motor server command")
        self._stopping: asyncio.Task | None = None
        self._next_stop: asyncio.Task | None = None
        self._ops: Mapping[str, Callable[..., Any]] = {
            "describe": self._describe,
            "enable": self._enable,
            "lease": self._give_lease,
            "move": self._move,
            "release": self._release,
            "renew": self._renew,
            "state": self._state,
            "stop": self._stop,
        }

    def __enter__(self) -> "MotorServer":
        try:
            self.port = self._lines.start(self.port)
        except OSError as error:
            raise BusError(
                f"the motor server cannot listen on {LOOPBACK}:{self.port}: {error.strerror}; "
                "another one may be running, or give another --tcp-port"
            ) from error
        self._watcher.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._lines.stop()
        self._watcher.join()
        self._commander.shutdown(cancel_futures=True)
        self._stopper.shutdown()  # whoever held the lease was hung up on: the arm stops

    def wait(self, timeout: float | None = None) -> None:
        """Serve until the arm fails, or for a time [s].

        Raises:
            RobotError: What the arm failed with.
        """
        until = math.inf if timeout is None else time.monotonic() + timeout
        while time.monotonic() < until and not self._closing.wait(0.1):
            self.loop.check()

    async def _answer(self, line: bytes, client: LineClient) -> tuple[_Answer, bool]:
        """Return the answer to a line, and whether to listen to its sender any longer."""
        try:
            request = await self._read_in_turn(line)
            return {"ok": True, **await self._ops[request["op"]](request, client)}, True
        except NotARequestError as error:
            return _refusal(error), False
        except (SelfModelError, ValueError, TypeError) as error:
            return _refusal(error), True
        except Exception as error:  # one clear answer, whatever it was
            return _refusal(RobotError(f"the request failed: {error!r}")), True

    async def _read_in_turn(self, line: bytes) -> Mapping[str, Any]:
        """Read a line; all but a stop and the holder of the lease wait for their turn.

        So do lines that are refused: a flood of them must leave time, too.
        """
        try:
            request = read_request(line)
        except RefusedError:
            await self._lines.wait_turn(line)
            raise
        if request["op"] != "stop" and not self._holds_lease(request):
            await self._lines.wait_turn(line)
        return request

    async def _state(self, request: Mapping[str, Any], client: LineClient) -> _Answer:
        state = self.loop.state()
        if state is None:
            raise RefusedError("the arm was not read yet")
        return {"state": state.to_mapping(), "leased": self._lease is not None}

    async def _describe(self, request: Mapping[str, Any], client: LineClient) -> _Answer:
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
        return {"robot": arm.name, "joints": joints}

    async def _give_lease(self, request: Mapping[str, Any], client: LineClient) -> _Answer:
        seconds = number(
            request.get("seconds", 1.0),
            f'"seconds", which is {SHORTEST_LEASE} to {LONGEST_LEASE},',
        )
        if not SHORTEST_LEASE <= seconds <= LONGEST_LEASE:
            raise RefusedError(
                f'"seconds" must be {SHORTEST_LEASE} to {LONGEST_LEASE}, got {seconds:g}'
            )
        with self._lock:
            if self._lease is not None:
                raise RefusedError("another process holds the lease; wait until it gives it back")
            self._lease, self._holder = secrets.token_hex(8), client
            self._seconds, client.kept = seconds, True
            self._extend()
            return {"lease": self._lease, "seconds": seconds}

    async def _renew(self, request: Mapping[str, Any], client: LineClient) -> _Answer:
        self._require_lease(request)
        return {}

    async def _release(self, request: Mapping[str, Any], client: LineClient) -> _Answer:
        self._require_lease(request)
        self._forget_lease()
        with suppress(RobotError):  # without heartbeats it stops all the same
            await self._stop(request, client)
        return {}

    async def _enable(self, request: Mapping[str, Any], client: LineClient) -> _Answer:
        self._require_lease(request)
        joints = request.get("joints")
        if not (joints is None or isinstance(joints, list)):
            raise RefusedError(f'"joints" must be a list of names, got {brief(joints)}')
        await self._do(request, lambda arm: arm.enable(joints))
        return {}

    async def _move(self, request: Mapping[str, Any], client: LineClient) -> _Answer:
        self._require_lease(request)
        asked = request.get("targets")
        if not isinstance(asked, Mapping) or not asked:
            raise RefusedError('"targets" must be an object: joint -> angle [rad]')
        targets = {
            name: number(value, f"the target of {brief(name)}") for name, value in asked.items()
        }
        speed = request.get("speed_rad_s")
        speed = None if speed is None else number(speed, '"speed_rad_s"')
        return {"seconds": await self._do(request, lambda arm: arm.move(targets, speed=speed))}

    async def _do(self, request: Mapping[str, Any], action: Callable[[MotorDriver], Any]) -> Any:
        """Let the loop do something, unless the lease ends before it comes to it."""

        def still_leased(arm: MotorDriver) -> Any:
            self._require_lease(request)
            return action(arm)

        events = asyncio.get_running_loop()
        return await events.run_in_executor(self._commander, self.loop.call, still_leased)

    async def _stop(self, request: Mapping[str, Any], client: LineClient) -> _Answer:
        # Who comes while a stop is under way waits for the next one, all of them for the same:
        # something may have started the arm in between.
        if self._next_stop is None:
            self._next_stop = self._lines.spawn(self._stop_after(self._stopping))
            # Who asked may be gone by then.
            self._next_stop.add_done_callback(lambda task: task.cancelled() or task.exception())
        await asyncio.shield(self._next_stop)
        return {}

    async def _stop_after(self, earlier: asyncio.Task | None) -> None:
        if earlier is not None:
            await asyncio.wait([earlier])
        self._stopping, self._next_stop = self._next_stop, None
        await asyncio.get_running_loop().run_in_executor(self._stopper, self.loop.stop)

    def _holds_lease(self, request: Mapping[str, Any]) -> bool:
        with self._lock:
            return self._lease is not None and request.get("lease") == self._lease

    def _require_lease(self, request: Mapping[str, Any]) -> None:
        with self._lock:
            if self._lease is None:
                raise RefusedError('no lease: ask for one with {"op": "lease"}')
            if request.get("lease") != self._lease:
                raise RefusedError("this is not the lease that is valid now")
            self._extend()

    def _extend(self) -> None:
        self._ends = time.monotonic() + self._seconds
        self.loop.heartbeat()

    def _end_lease_of(self, client: LineClient) -> None:
        """Note that a connection closed; the arm stops if it held the lease."""
        with self._lock:
            if self._holder is not client:
                return
            self._forget_lease()
        self._stopper.submit(self._stop_somehow)

    def _forget_lease(self) -> None:
        with self._lock:
            if self._holder is not None:
                self._holder.kept = False
            self._lease = self._holder = None
            self._ends = -math.inf

    def _stop_somehow(self) -> None:
        with suppress(RobotError):  # without heartbeats it stops all the same
            self.loop.stop()

    def _watch(self) -> None:
        """Keep the arm alive while a lease is valid, and stop it when it ends."""
        pause = self.loop.arm.longest_silence / 4
        while not self._closing.wait(pause):
            with self._lock:
                leased, valid = self._lease is not None, time.monotonic() < self._ends
                if leased and valid:
                    self.loop.heartbeat()
                elif leased:
                    self._forget_lease()
            if leased and not valid:
                # Not under the lock, for which the arm's thread may wait: see `_do`.
                self._stopper.submit(self._stop_somehow)


def _refusal(error: Exception) -> _Answer:
    words = " ".join(str(error).split())
    if len(words) > _LONGEST_ERROR:
        words = f"{words[:_LONGEST_ERROR]}..."
    return {"ok": False, "error": words}

"""The thread that keeps an arm going: others hand over what they want and take what is known."""

import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, wait
from contextlib import suppress
from typing import Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.errors import BusError, RobotError
from nico_selfmodel.servos.arm_state import ArmState
from nico_selfmodel.servos.motor_driver import MotorDriver
from nico_selfmodel.with_blocks import ClosedAtEnd

DEFAULT_PERIOD = 0.05
_PATIENCE = 10.0
"""How long the driver is waited for [s]."""
_T = TypeVar("_T")


class ArmLoop(ClosedAtEnd):
    """Cycles a driver in a thread of its own; every method returns at once but `call`.

    What the thread fails with is raised from `check` and `state` with its cause. The heartbeat is
    whoever calls `heartbeat` or `command`: without one of them the arm stops.
    """

    def __init__(self, arm: MotorDriver, period: float = DEFAULT_PERIOD) -> None:
        """Take a driver over; nothing runs before `start`.

        Args:
            arm: A driver that nobody else uses from now on; connected, or connected by `call`.
            period: Shortest time of a cycle [s]; the bus may need longer.
        """
        self.arm, self.period = arm, period
        self.cycles = 0
        """How many were made."""
        self._lock = threading.Lock()
        self._wake = threading.Condition(self._lock)
        self._jobs: list[tuple[Callable[[MotorDriver], object], Future]] = []
        self._command: tuple[NDArray, float | None, Sequence[int] | None] | None = None
        self._last = self._command
        self._alive = False
        self._ending = False
        self._state: ArmState | None = None
        self._failure: BaseException | None = None
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        self.start()
        return self

    def start(self, timeout: float = _PATIENCE) -> ArmState:
        """Start the thread and wait for the first complete reading.

        Raises:
            RobotError: If it fails, or does not come in time.
        """
        self._thread = threading.Thread(target=self._run, name="arm loop", daemon=True)
        self._thread.start()
        with self._wake:
            self._wake.wait_for(lambda: self._state or self._failure, timeout)
        state = self.state()
        if state is None:
            raise BusError(f"the arm was not read within {timeout:g} s: is the bus very slow?")
        return state

    def state(self) -> ArmState | None:
        """Return the newest state, None before the first.

        Raises:
            RobotError: What the thread failed with.
        """
        self.check()
        return self._state

    def check(self) -> None:
        """Raise what the thread failed with, as an error of the same kind with that as its cause.

        Raises:
            RobotError: If it failed.
        """
        failure = self._failure
        if isinstance(failure, RobotError):
            raise type(failure)(str(failure), partial=self._state) from failure
        if failure is not None:
            raise BusError(f"the arm's thread failed: {failure}", partial=self._state) from failure

    def heartbeat(self) -> None:
        """Say that the host is alive."""
        with self._lock:
            self._alive = True

    def command(
        self, q: ArrayLike, *, speed: float | None = None, joints: Sequence[int] | None = None
    ) -> None:
        """Hand over where joints are to go; the newest command counts. Also a heartbeat.

        A command that cannot be carried out fails the thread: see `check`.

        Args:
            q: Joint displacements [rad]. Shape (n,).
            speed: Largest joint speed [rad/s]; the limits if omitted.
            joints: Which of them are meant, the others stay as they are; all if omitted.

        Raises:
            ValueError: If it is not finite, beyond a limit or of another shape.
            RobotError: If the thread has failed.
        """
        self.check()
        q = np.array(q, dtype=float)
        n = len(self.arm.joints)
        if q.shape != (n,):
            raise ValueError(f"q must have shape ({n},), got {q.shape}")
        self.arm.limits.registers(q, range(n) if joints is None else joints)
        self._last = (q, speed, joints)
        self.repeat()

    def repeat(self) -> None:
        """Hand the last command over again, or none before the first; also a heartbeat.

        Raises:
            RobotError: If the thread has failed.
        """
        self.check()
        with self._lock:  # the next cycle takes it: waking the thread up would only cost both
            self._command, self._alive = self._last, True

    def move(self, targets: Mapping[str, float], *, speed: float | None = None) -> float:
        """Send joints to displacements; waits until they have started, not until they arrive.

        Args:
            targets: Joint -> displacement [rad]; joints that are not named stay.
            speed: Largest joint speed [rad/s]; the limits if omitted.

        Returns:
            How long it will take [s].

        Raises:
            ValueError: If a target is not finite or beyond a limit.
            RobotError: As of the driver's `move`.
        """
        return self.call(lambda arm: arm.move(targets, speed=speed))

    def stop(self) -> None:
        """Stop every joint and hold; waits until each confirmed.

        Raises:
            RobotError: If one did not, or the thread has failed. A stop that it does not come to in
                time is carried out all the same.
        """
        self.call(lambda arm: arm.stop(), however_late=True)

    def call(self, action: Callable[[MotorDriver], _T], *, however_late: bool = False) -> _T:
        """Do something with the driver between two cycles, and wait for its result.

        Args:
            action: Is given the driver, in the arm's own thread.
            however_late: Whether to do it also when nobody waits for it any more.

        Raises:
            RobotError: If the thread has failed or does not come to it in time; then it is not
                done later either, unless it was begun.
            Exception: What the action raises; the thread goes on.
        """
        self.check()
        future: Future = Future()
        with self._wake:
            if self._ending:
                raise BusError("the arm's thread has ended: open the arm again")
            self._jobs.append((action, future))
            self._wake.notify_all()
        try:
            wait([future], _PATIENCE)
        finally:  # Ctrl-C too ends the wait
            given_up = not however_late and future.cancel()
        if future.done() and not given_up:
            return future.result()
        what = (
            "it is busy or the bus is slow; nothing was sent, try again"
            if given_up
            else "what was asked may still be done, see where the joints stand"
        )
        raise BusError(f"the arm's thread did not answer within {_PATIENCE:g} s: {what}")

    def close(self) -> None:
        """Stop what moves, end the thread and give the port back; never fails."""
        with self._wake:
            self._ending = True
            self._wake.notify_all()
        if self._thread is not None:
            self._thread.join()
        self.arm.close()
        self._refuse_jobs()

    def _run(self) -> None:
        try:
            while not self._ending:
                begin = self.arm.now()
                self._do_jobs()
                state = self.arm.cycle()
                with self._wake:
                    self._state = state
                    self.cycles += 1
                    self._wake.notify_all()
                    left = begin + self.period - self.arm.now()
                    self._wake.wait_for(lambda: self._ending or self._jobs, max(0.0, left))
        except Exception as error:  # whatever it is, whoever uses the arm must see it
            with suppress(RobotError):
                self.arm.stop()
            with self._wake:
                self._failure = error
                self._wake.notify_all()
        self._refuse_jobs()

    def _do_jobs(self) -> None:
        with self._lock:
            jobs, self._jobs = self._jobs, []
            command, self._command = self._command, None
            alive, self._alive = self._alive, False
        if alive:
            self.arm.heartbeat()
        if command is not None:  # before the jobs: a stop must have the last word
            q, speed, joints = command
            try:
                self.arm.command(q, speed=speed, joints=joints)
            except Exception:
                with self._lock:  # who waits for one must hear of it
                    self._jobs = jobs + self._jobs
                raise
        for action, future in jobs:
            if not future.set_running_or_notify_cancel():
                continue  # who asked was told that it came too late
            result = error = None
            try:
                result = action(self.arm)
            except Exception as raised:  # it belongs to who asked
                error = raised
            if self._state is not None:
                # Else a motion would count as over until the next cycle.
                self._state = self.arm.state()
            if error is None:
                future.set_result(result)
            else:
                future.set_exception(error)

    def _refuse_jobs(self) -> None:
        with self._lock:
            jobs, self._jobs = self._jobs, []
            self._ending = True
        for _, future in jobs:
            if not future.set_running_or_notify_cancel():
                continue
            future.set_exception(BusError("the arm's thread has ended: open the arm again"))

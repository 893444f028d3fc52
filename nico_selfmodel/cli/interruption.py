"""What a command does when a signal stops it, while modules load too; it imports nothing slow.

Ctrl-C (SIGINT), the end of the terminal (SIGHUP) and the wish of the system (SIGTERM) are one: what
moves is stopped, devices are freed, and the exit code is 128 and the signal's number.
"""

import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

CODE = 130
"""Exit code of a command that Ctrl-C stopped, as a shell has it."""
_LIKE_CTRL_C = (signal.SIGTERM, signal.SIGHUP)
_ONE_WISH = 10.0
"""Signals that come within this time of the first are the same wish [s]: a terminal that closes
sends one, and who waits for the end of its commands another."""


class _Heard:
    """Which signal stopped this command, and when; none so far."""

    number: int = signal.SIGINT
    at: float = float("-inf")


def hear_signals() -> None:
    """Take SIGTERM and SIGHUP for Ctrl-C from now on, but for what this process shall ignore."""
    for number in _LIKE_CTRL_C if _may_be_told() else ():
        if signal.getsignal(number) == signal.SIG_DFL:  # `nohup` ignores SIGHUP
            signal.signal(number, _stop)


def _stop(number: int, _: object) -> None:
    before, _Heard.at = _Heard.at, time.monotonic()
    if _Heard.at - before > _ONE_WISH:
        _Heard.number = number
        raise KeyboardInterrupt


def _may_be_told() -> bool:
    """Return whether signals are heard in this thread."""
    return threading.current_thread() is threading.main_thread()


@contextmanager
def undisturbed() -> Iterator[None]:
    """Do what no signal may break off, as stopping an arm; one that comes meanwhile is heard after.

    Raises:
        KeyboardInterrupt: At the end, if one came.
    """
    came: list[int] = []
    numbers = (signal.SIGINT, *_LIKE_CTRL_C) if _may_be_told() else ()
    before = {number: signal.signal(number, lambda n, _: came.append(n)) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
    for number in came:
        signal.raise_signal(number)


def was_stopped(error: BaseException) -> bool:
    """Return whether an error is Ctrl-C, or came of it.

    A module in C that is interrupted while it loads raises an ImportError from it.
    """
    seen: BaseException | None = error
    while seen is not None:
        if isinstance(seen, KeyboardInterrupt):
            return True
        seen = seen.__cause__ or seen.__context__
    return False


def say_stopped() -> int:
    """Say in one line that a command was stopped, and return its exit code."""
    with suppress(OSError):  # the terminal may be what ended
        print("nico-selfmodel: stopped", file=sys.stderr)
    return 128 + _Heard.number

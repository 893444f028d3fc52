"""What a command says when Ctrl-C stops it, while modules load too; it imports nothing slow."""

import sys

CODE = 130
"""Exit code of a command that was stopped, as a shell has it."""


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
    print("nico-selfmodel: stopped", file=sys.stderr)
    return CODE

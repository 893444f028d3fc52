"""How a long job tells how far it is."""

from collections.abc import Callable
from typing import Protocol

Steps = Callable[[int, int], None]
"""Called with the number of steps done and their total."""


class Progress(Protocol):
    """What long jobs call to tell how far they are."""

    def __call__(self, what: str, done: int, total: int) -> None:
        """Show that `done` of `total` steps of `what` are done."""
        ...


def steps_of(progress: Progress | None, what: str) -> Steps:
    """Return what a part of a job calls, named; nothing happens where nobody listens."""
    return lambda done, total: progress(what, done, total) if progress else None

"""How a long job tells how far it is."""

from typing import Protocol


class Progress(Protocol):
    """What long jobs call to tell how far they are."""

    def __call__(self, what: str, done: int, total: int) -> None:
        """Show that `done` of `total` steps of `what` are done."""
        ...


def telling_nobody(what: str, done: int, total: int) -> None:
    """Show nothing."""

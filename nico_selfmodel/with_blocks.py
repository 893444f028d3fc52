"""What is used in `with` blocks: closed at their end, or opened at their start too."""

from typing import Any, Self


class ClosedAtEnd:
    """Something that a `with` block closes when it ends."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give back what is held."""
        raise NotImplementedError


class OpenedAtStart(ClosedAtEnd):
    """Something that a `with` block opens when it begins, and closes when it ends."""

    def __enter__(self) -> Self:
        self.open()
        return self

    def open(self) -> Any:
        """Take what is needed."""
        raise NotImplementedError

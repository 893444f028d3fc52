"""What is given back when it is closed, and the error of whoever uses it afterwards.

Drake (1.51) never frees systems that are made in Python, nor the diagrams that these are part of:
what is large in them, or belongs to the machine, must be given back by hand.
"""

import ctypes
import gc
import sys
from contextlib import suppress
from typing import Self

from nico_selfmodel.errors import RobotError
from nico_selfmodel.with_blocks import ClosedAtEnd


class Closable(ClosedAtEnd):
    """Something to be used in a `with` block; closing it twice is fine."""

    _closed = False

    @property
    def is_closed(self) -> bool:
        """Whether it was closed."""
        return self._closed

    def close(self) -> None:
        """Give back what it holds; it cannot be used any more."""
        if not self._closed:
            self._closed = True
            self._give_back()

    def __enter__(self) -> Self:
        self.require_open()
        return self

    def require_open(self) -> None:
        """Refuse to be used after closing.

        Raises:
            RobotError: If it was closed.
        """
        if self._closed:
            raise RobotError(
                f"this {type(self).__name__} was closed: make a new one, and use it in its own "
                "with block"
            )

    def _give_back(self) -> None:
        """Let go of what is held; called once."""


def free_memory() -> None:
    """Give back to the system what nobody holds any more, where the C library can.

    Plants lie in circles of references, and a renderer leaves its memory in pieces, which would
    stay with this process for ever.
    """
    gc.collect()
    trim_memory()


def trim_memory() -> None:
    """Give back to the system what is freed already, which takes ten milliseconds."""
    if sys.platform.startswith("linux"):
        with suppress(OSError, AttributeError):  # another C library than GNU's
            ctypes.CDLL(None).malloc_trim(0)

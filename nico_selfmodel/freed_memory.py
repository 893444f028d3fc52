"""Memory that arrays free stays with the process, which soon asks for as much again."""

import ctypes
import sys
from contextlib import suppress

_LARGEST = 31 << 20
"""A little less than what glibc gives back at once whatever was freed before [bytes]."""
_MMAP_THRESHOLD = -3
"""Of mallopt(3)."""


def keep_freed_memory() -> None:
    """Let glibc keep what is freed; without glibc nothing happens.

    It gives each block above 128 kB back to the system, which clears it page by page when it is
    asked for anew: a sixth of a calibration. Once a larger one was freed it keeps blocks of up to
    that size (mallopt(3), M_MMAP_THRESHOLD). This one is never written to, so that it takes no
    memory.
    """
    bytes(_LARGEST)


def give_back_freed_memory() -> None:
    """Let glibc give back each block above 1 MB as soon as it is freed; else nothing happens.

    Where renderers come and go, what is freed between their buffers is in pieces, and would stay.
    """
    if sys.platform.startswith("linux"):
        with suppress(OSError, AttributeError):  # another C library than GNU's
            ctypes.CDLL(None).mallopt(_MMAP_THRESHOLD, 1 << 20)

"""Memory that arrays free stays with the process, which soon asks for as much again."""

_LARGEST = 31 << 20
"""A little less than what glibc gives back at once whatever was freed before [bytes]."""


def keep_freed_memory() -> None:
    """Let glibc keep what is freed; without glibc nothing happens.

    It gives each block above 128 kB back to the system, which clears it page by page when it is
    asked for anew: a sixth of a calibration. Once a larger one was freed it keeps blocks of up to
    that size (mallopt(3), M_MMAP_THRESHOLD). This one is never written to, so that it takes no
    memory.
    """
    bytes(_LARGEST)

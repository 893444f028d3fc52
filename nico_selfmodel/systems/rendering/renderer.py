"""Whether this machine can render, asked before Drake's renderer would end the process."""

import ctypes
import sys

from nico_selfmodel.errors import RobotError


def can_render() -> bool:
    """Return whether the library that Drake renders through without a screen is there."""
    if not sys.platform.startswith("linux"):
        return True
    try:
        ctypes.CDLL("libEGL.so.1")
    except OSError:
        return False
    return True


def check_renderer() -> None:
    """Refuse to render where it cannot be done.

    Raises:
        RobotError: Saying what to install.
    """
    if not can_render():
        raise RobotError(
            "nothing can be rendered here: libEGL.so.1 is missing; install Debian's libegl1 and "
            "libgl1-mesa-dri, or take --sensor motion-capture"
        )

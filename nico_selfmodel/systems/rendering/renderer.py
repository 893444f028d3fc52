"""Whether this machine can render, asked before Drake's renderer would end the process."""

import ctypes
import os
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


def draw_in_one_thread() -> None:
    """Let Mesa's software renderer draw in the thread that asks, if nothing was drawn yet.

    While threads of its own draw, it gathers the next triangles in further memory, up to 36 MB a
    part of a picture, and keeps that: 0.2 to 0.6 GB where a robot looks at itself. Without them one
    process takes a fifth longer on two cores, and no more processor time. Who has set
    `LP_NUM_THREADS` keeps it.
    """
    os.environ.setdefault("LP_NUM_THREADS", "0")

"""Telling somebody how far a session is."""

from collections.abc import Callable

Stage = Callable[[str, int, int], None]
"""Called with what is going on, steps done and steps in all."""


def telling(stage: Stage | None, what: str) -> Callable[[int, int], None]:
    """Return what is called with steps done and steps in all of one thing that goes on.

    Args:
        stage: Who is told, if anybody.
        what: What is going on.
    """
    return lambda done, total: stage(what, done, total) if stage else None


def of_robot(stage: Stage | None, i: int, count: int, kind: str = "robot") -> Stage:
    """Return who is told with the number of the robot in front, where there are several.

    Args:
        stage: Who is told, if anybody.
        i: Number of the robot, from 0.
        count: Of the robots.
        kind: What they are called.
    """
    number = f"{kind} {i + 1} of {count}: " if count > 1 else ""
    return lambda what, done, total: stage(number + what, done, total) if stage else None

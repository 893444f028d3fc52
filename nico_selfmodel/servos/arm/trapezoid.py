"""How long trapezoidal motions take, and how fast to go to be there at a given time."""

import math
from collections.abc import Sequence

_SLOWEST = 0.02
"""No joint is slower than this share of its speed, lest a rounding make it crawl."""


def duration(distance: float, speed: float, acceleration: float) -> float:
    """Return how long a trapezoidal motion takes [s].

    Args:
        distance: Not negative.
        speed: Largest speed.
        acceleration: Of start and end.
    """
    if distance * acceleration < speed * speed:  # it never gets to full speed
        return 2.0 * math.sqrt(distance / acceleration)
    return distance / speed + speed / acceleration


def common_duration(
    distances: Sequence[float], speeds: Sequence[float], accelerations: Sequence[float]
) -> float:
    """Return how long the slowest of several motions takes [s], 0 if there is none."""
    motions = zip(distances, speeds, accelerations, strict=True)
    return max((duration(*motion) for motion in motions), default=0.0)


def speed_for(distance: float, seconds: float, speed: float, acceleration: float) -> float:
    """Return the speed at which a motion takes a given time.

    The acceleration stays, so that a slower joint does not take longer to stop.

    Args:
        distance: Not negative.
        seconds: At least the shortest time possible.
        speed: Largest speed.
        acceleration: Of start and end.
    """
    # seconds = distance / v + v / acceleration, the smaller root
    half = acceleration * seconds / 2.0
    root = math.sqrt(max(0.0, half * half - distance * acceleration))
    if half + root == 0.0:
        return speed
    return min(speed, max(distance / (half + root) * acceleration, speed * _SLOWEST))

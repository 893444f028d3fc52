"""Steps by which joints show how they follow their commands."""

import numpy as np
from numpy.typing import NDArray

SMALLEST = 0.1
"""Share of the largest step that the smallest one is."""


def planned_steps(
    start: float, lower: float, upper: float, largest: float, count: int, rng: np.random.Generator
) -> NDArray:
    """Return where a joint is told to go, one step after another, in the end back to its start.

    Sizes are spread evenly by their logarithm, in random order: short steps show delay and
    acceleration, long ones the largest speed. They go back and forth about the start, as far as
    there is room.

    Args:
        start: Where it stands [rad].
        lower: The least that it may go to [rad].
        upper: The most [rad].
        largest: Largest step [rad].
        rng: Of the order.

    Returns:
        Displacements to go to [rad]. Shape (count + 1,).

    Raises:
        ValueError: If it stands beyond its limits, or has no room for a step.
    """
    if not lower <= start <= upper:
        raise ValueError(
            f"it stands at {np.degrees(start):.1f} deg, beyond its limits of "
            f"{np.degrees(lower):.1f} to {np.degrees(upper):.1f} deg"
        )
    sizes = rng.permutation(np.geomspace(SMALLEST, 1.0, count)) * largest
    at, goals = start, []
    for size in sizes.tolist():
        up, down = upper - at, at - lower
        # Back and forth about the start, as far as there is room.
        side = 1.0 if (at <= start and up >= size) or down < min(size, up) else -1.0
        at += side * min(size, max(up, down))
        goals.append(at)
    if np.ptp([start, *goals]) == 0.0:
        raise ValueError("it has no room for a step")
    return np.array([*goals, start])

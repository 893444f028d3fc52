"""Round factors by which small things are drawn larger."""

import numpy as np


def nice_factor(drawn: float, real: float) -> float:
    """Return the largest of 1, 2, 5, 10, 20, ... that keeps a length within another; at least 1.

    Args:
        drawn: How long it may be drawn [m].
        real: How long it is [m].

    >>> nice_factor(0.03, 0.0012)
    20.0
    """
    if not real > 0.0:
        return 1.0
    return max(nice_below(drawn / real), 1.0)


def nice_below(value: float) -> float:
    """Return the largest of ..., 0.1, 0.2, 0.5, 1, 2, 5, ... that is not above a positive value.

    >>> nice_below(0.37)
    0.2
    """
    exponent = int(np.floor(np.log10(value)))
    for step, power in ((5, exponent), (2, exponent), (1, exponent), (5, exponent - 1)):
        nice = float(f"{step}e{power}")
        if nice <= value * (1.0 + 1e-12):
            return nice
    raise AssertionError("one of them is below any positive value")

"""Numbers as people read them: round factors, and no more digits than are known."""

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


def decimals(value: float, sigma: float | None) -> str:
    """Write a value as finely as its standard deviation allows, to its second digit.

    >>> decimals(12.34567, 0.021), decimals(12.34567, None)
    ('12.346', '12.346')
    """
    digits = 3
    if sigma is not None and sigma > 0.0:
        digits = int(np.clip(1 - np.floor(np.log10(sigma)), 0, 6))
    return f"{value:z.{digits}f}".replace("-", "−")


def signed(value: float, digits: int) -> str:
    """Write a deviation with its sign; what rounds to zero is not negative.

    >>> signed(0.126, 2), signed(-0.126, 2), signed(-0.001, 2)
    ('+0.13', '−0.13', '+0.00')
    """
    return f"{value:+z.{digits}f}".replace("-", "−")


def short(value: float) -> str:
    """Write a positive number with two digits that count, and never with an exponent.

    >>> short(0.0876), short(2.6), short(114.2)
    ('0.088', '2.6', '110')
    """
    return f"{float(f'{value:.2g}'):.10f}".rstrip("0").rstrip(".")

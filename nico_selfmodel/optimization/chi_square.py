"""How rare a value of chi square is."""

from functools import cache
from math import erfc, exp, lgamma, log, sqrt


def chi_square_tail(value: float, dof: int) -> float:
    """Return the probability that chi square exceeds a value.

    Q = erfc(sqrt(x / 2)) for one degree of freedom and exp(-x / 2) for two; two more add
    exp(-x / 2) (x / 2)^(k / 2) / Gamma(k / 2 + 1) (Abramowitz, Stegun 26.4.4-5).

    Args:
        value: Of chi square.
        dof: Degrees of freedom, at least 1.

    Returns:
        Between 0 and 1.

    Raises:
        ValueError: If there is no degree of freedom.
    """
    if dof < 1:
        raise ValueError(f"chi square needs at least one degree of freedom, got {dof}")
    half = 0.5 * max(value, 0.0)
    if half == 0.0:
        return 1.0
    tail = erfc(sqrt(half)) if dof % 2 else exp(-half)
    for k in range(1 if dof % 2 else 2, dof, 2):
        tail += exp(0.5 * k * log(half) - half - lgamma(0.5 * k + 1.0))
    return min(tail, 1.0)


@cache
def as_rare_as(value: float, dof: int, other: int) -> float:
    """Return the value of chi square with other degrees of freedom that is as rare.

    Args:
        value: Of chi square.
        dof: Its degrees of freedom.
        other: Those of the value asked for.

    Returns:
        By bisection, to 1e-9 of it.
    """
    tail, low, high = chi_square_tail(value, dof), 0.0, 10.0 * value + 10.0 * other
    while high - low > 1e-9 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if chi_square_tail(middle, other) > tail else (low, middle)
    return high

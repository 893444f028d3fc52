"""How rare a value of Fisher's F is."""

from math import exp, lgamma, log

_TERMS, _EXACT, _TINY = 500, 1e-14, 1e-300


def fisher_tail(value: float, above: int, below: int) -> float:
    """Return the probability that Fisher's F exceeds a value.

    Q = I_x(n / 2, m / 2), x = n / (n + m F), of F with m degrees of freedom above the line and n
    below it (Abramowitz, Stegun 26.6.2).

    Args:
        value: Of F.
        above: Degrees of freedom of what is tested, at least 1.
        below: Those of what it is held against, at least 1.

    Returns:
        Between 0 and 1.

    Raises:
        ValueError: If there is no degree of freedom.
    """
    if above < 1 or below < 1:
        raise ValueError(f"Fisher's F needs degrees of freedom, got {above} and {below}")
    if value <= 0.0:
        return 1.0
    x = below / (below + above * value)
    return _incomplete_beta(x, 0.5 * below, 0.5 * above)


def _incomplete_beta(x: float, a: float, b: float) -> float:
    """Return I_x(a, b), 0 < x < 1: by its continued fraction where that converges soon."""
    if x > (a + 1.0) / (a + b + 2.0):
        return 1.0 - _incomplete_beta(1.0 - x, b, a)
    if x <= 0.0:
        return 0.0
    # Abramowitz, Stegun 26.5.8, from the left (Lentz 1976).
    size = exp(lgamma(a + b) - lgamma(a) - lgamma(b) + a * log(x) + b * log(1.0 - x)) / a
    c, d = 1.0, 1.0 / (1.0 - (a + b) * x / (a + 1.0) or _TINY)
    fraction = d
    for m in range(1, _TERMS):
        even = m * (b - m) * x / ((a + 2 * m - 1.0) * (a + 2 * m))
        odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1.0))
        for term in (even, odd):
            d = 1.0 / (1.0 + term * d or _TINY)
            c = 1.0 + term / c or _TINY
            fraction *= c * d
        if abs(c * d - 1.0) < _EXACT:
            break
    return min(size * fraction, 1.0)

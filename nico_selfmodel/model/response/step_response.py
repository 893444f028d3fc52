"""How a joint answers a step of its command: after a delay, at a speed, with a lag.

Both kinds start at 0 and end at D, the way that is gone.

`profile`: the controller plans a trapezoid of a speed v and an acceleration a, which the joint
follows with a lag tau = 1 / rate. A trapezoid is a step that two boxes smooth, of lengths b and c,
and the lag is a low pass of first order:

    x(t) = D / (b c) [G(u) - G(u - b) - G(u - c) + G(u - b - c)],    u = t - delay,
    b = max(D / v, (D / a)^1/2),    c = min(v / a, (D / a)^1/2),    G'' = 1 - exp(-u / tau), u > 0.

`loop`: a loop of gain `rate` whose speed is limited, x' = min(v, rate (D - x)): at v until v / rate
is left, then exponentially.
"""

import numpy as np
from numpy.typing import NDArray

PARTS = ("delay", "speed", "acceleration", "rate")
"""Numbers of a response, in this order; `rate` is 1 / tau."""
UNITS = {"delay": "s", "speed": "rad/s", "acceleration": "rad/s^2", "rate": "1/s"}
PROFILE, LOOP = "profile", "loop"
_SHORT = 1e-4
"""A box is no shorter than this share of the longer one: below it nothing changes but rounding."""


def step_response(
    kind: str, way: NDArray, time: NDArray, parts: dict[str, float]
) -> tuple[NDArray, dict[str, NDArray]]:
    """Return how far a joint is on its way, and the derivatives.

    Args:
        kind: `PROFILE` or `LOOP`.
        way: How far it goes, D > 0 [rad]. Shape (N,).
        time: Since it was told to, less the delay [s]. Shape (N,).
        parts: Speed, acceleration and rate; what is not there is without limit.

    Returns:
        How far it is [rad], shape (N,), and its derivative by `time` and by the logarithm of each
        part. Shape (N,) each.
    """
    found = _profile if kind == PROFILE else _loop
    return found(way, time, parts)


def _profile(
    way: NDArray, time: NDArray, parts: dict[str, float]
) -> tuple[NDArray, dict[str, NDArray]]:
    v, a = parts.get("speed", np.inf), parts.get("acceleration", np.inf)
    tau = 1.0 / parts["rate"] if "rate" in parts else 0.0
    triangle = np.sqrt(way / a)
    b, c = np.maximum(way / v, triangle), np.minimum(v / a, triangle)
    reached = way / v > triangle
    longest = np.maximum(b, 1e-9)
    b, short = longest, c < _SHORT * longest
    c = np.maximum(c, _SHORT * longest)
    ends = np.stack([time, time - b, time - c, time - b - c])
    signs = np.array([1.0, -1.0, -1.0, 1.0])[:, None]
    G, G1, by_tau = _lagged(np.maximum(ends, 0.0), tau)
    scale = way / (b * c)
    x = scale * (signs * G).sum(axis=0)
    by_time = scale * (signs * G1).sum(axis=0)
    by_b = -x / b + scale * (G1[1] - G1[3])
    by_c = np.where(short, 0.0, -x / c + scale * (G1[2] - G1[3]))
    # ln b and ln c by ln v and ln a, where the speed is reached and where it is not.
    slopes = {"time": by_time}
    if "speed" in parts:
        slopes["speed"] = np.where(reached, -b * by_b + c * by_c, 0.0)
    if "acceleration" in parts:
        slopes["acceleration"] = np.where(reached, -c * by_c, -0.5 * (b * by_b + c * by_c))
    if "rate" in parts:
        slopes["rate"] = -tau * scale * (signs * by_tau).sum(axis=0)
    return x, slopes


def _lagged(u: NDArray, tau: float) -> tuple[NDArray, NDArray, NDArray]:
    """Return G, G' and the derivative of G by tau, of u >= 0.

    G(u) = u^2 / 2 - tau u + tau^2 (1 - exp(-u / tau)).
    """
    if tau == 0.0:
        return 0.5 * u * u, u, -u
    e = np.exp(-u / tau)
    G1 = u - tau * (1.0 - e)
    return 0.5 * u * u - tau * G1, G1, -u + 2.0 * tau * (1.0 - e) - u * e


def _loop(
    way: NDArray, time: NDArray, parts: dict[str, float]
) -> tuple[NDArray, dict[str, NDArray]]:
    v, rate = parts.get("speed", np.inf), parts["rate"]
    left = np.minimum(way, v / rate)
    """What is left of the way where the speed is no longer limited."""
    limited = way > left
    begins = np.where(limited, (way - left) / v, 0.0)
    u = np.maximum(time, 0.0)
    late = u >= begins
    rest = left * np.exp(-rate * np.maximum(u - begins, 0.0))
    x = np.where(late, way - rest, (v if limited.any() else 0.0) * u)
    moving = (time > 0.0) & ~late
    by_time = np.where(late & (time > 0.0), rate * rest, 0.0)
    by_rate = np.where(late, rate * rest * (u - begins), 0.0)
    if not limited.any():
        return x, {"time": by_time, "speed": np.zeros(len(x)), "rate": by_rate}
    by_time = np.where(moving, v, by_time)
    # Where the speed is limited, rest = v / rate exp(rate D / v - 1 - rate u).
    by_speed = np.where(late, rest * (rate * way / v - 1.0), v * u)
    return x, {"time": by_time, "speed": np.where(limited, by_speed, 0.0), "rate": by_rate}

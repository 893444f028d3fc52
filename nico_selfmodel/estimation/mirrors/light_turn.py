"""How a room's light stands about a robot, told by the shades of its body.

Turned by a small rotation vector l the light makes of an expected picture E another one, and all
grey levels of a look have one gain g:

    I - g E = g sum_k dE/dl_k l_k + (dg / g) g E + noise

Edges tell nothing of it: what they differ by, because nobody knows to the pixel where they are
seen, is a part of the noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.optimization.uncertainty import inverse_of

_BEFORE = np.radians(5.0)
"""How far a robot may be turned in its room, about each axis [rad]."""
_FAR_OFF = 2.5
"""Robust standard deviations from which on a grey level counts less (Huber)."""
_ROUNDS = 3
"""In which what is far off is told from what turned light explains."""
_GAIN_SIGMA = 0.1
"""What a gain may be off by that was found with light that was not turned."""


@dataclass(frozen=True, eq=False)
class ShadedLook:
    """What is judged of one camera's look, n pixels."""

    off: NDArray
    """I - g E. Shape (n, 3)."""
    expected: NDArray
    """g E. Shape (n, 3)."""
    by_turn: NDArray
    """g dE/dl. Shape (n, 3, 3), the last index that of l."""
    variance: NDArray
    """Of each grey level: of noise, colours and places. Shape (n, 3)."""


@dataclass(frozen=True, eq=False)
class LightTurn:
    """How the light is turned."""

    turn: NDArray
    """Rotation vector [rad]. Shape (3,)."""
    covariance: NDArray
    """Of that. Shape (3, 3)."""

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        object.__setattr__(self, "turn", read_only(self.turn))
        object.__setattr__(self, "covariance", read_only(self.covariance))


def light_turn(looks: Sequence[ShadedLook], area: float) -> LightTurn:
    """Return how the light is turned by which looks were expected.

    Args:
        looks: Of one body in one light.
        area: Pixels that err alike, those of one surface.
    """
    size = 3 + len(looks)
    x = np.zeros(size)
    covariance = np.zeros((size, size))
    for _ in range(_ROUNDS):
        information = np.diag([_BEFORE**-2] * 3 + [_GAIN_SIGMA**-2] * len(looks))
        pull = np.zeros(size)
        for k, look in enumerate(looks):
            slopes = np.zeros((*look.off.shape, size))
            slopes[:, :, :3], slopes[:, :, 3 + k] = look.by_turn, look.expected
            rest = np.abs(look.off - slopes @ x) / np.sqrt(look.variance)
            scale = max(1.4826 * float(np.median(rest)), 1.0)
            share = np.minimum(1.0, _FAR_OFF * scale / np.maximum(rest, 1e-9))
            weight = share / (look.variance * scale**2 * 3.0 * area)
            information += np.einsum("nci,nc,ncj->ij", slopes, weight, slopes)
            pull += np.einsum("nci,nc,nc->i", slopes, weight, look.off)
        covariance = inverse_of(information)
        x = covariance @ pull
    return LightTurn(x[:3], covariance[:3, :3])

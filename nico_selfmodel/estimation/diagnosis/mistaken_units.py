"""Joints read in another unit than stated, among joints that are not: their spans tell."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

OTHER_UNIT = {"deg": ("rad", 180.0 / np.pi), "rad": ("deg", np.pi / 180.0)}
"""Stated unit -> the one it is mistaken for, and what then mends an angle that was made of it."""
_LARGEST_SPAN = 4.0 * np.pi
"""A joint whose mended readings span more was read as stated [rad]. Where all joints that are asked
about do as they are stated, or mended none does, all are in doubt."""


def mistaken_units(angles: NDArray, stated: Sequence[str], asked: NDArray) -> NDArray:
    """Find joints that would turn as far as the others if their unit were another.

    Of s_i, the span of joint i's angles, and m, the median of the others', the unit is in doubt
    where |log(f s_i / m)| < |log(s_i / m)| with f what mends the angle, 57.3 or 1 / 57.3. So are
    all where each spans more than two turns as stated, or less mended.

    Args:
        angles: Encoder angles, as the stated units make them [rad]. Shape (N, n).
        stated: Units, n of them.
        asked: Joints whose unit may be in doubt. Boolean, shape (n,).

    Returns:
        By what each joint's angles are to be multiplied; 1 where the unit is as stated. Shape (n,).
    """
    spans, factors = np.ptp(angles, axis=0), np.ones(len(stated))
    for i in map(int, np.flatnonzero(asked & (spans > 0.0))):
        others = np.delete(spans, i)
        others = others[others > 0.0]
        if stated[i] not in OTHER_UNIT or not len(others):
            continue
        factor, off = OTHER_UNIT[stated[i]][1], np.log(spans[i] / np.median(others))
        if abs(off + np.log(factor)) < abs(off) and factor * spans[i] <= _LARGEST_SPAN:
            factors[i] = factor
    return factors if (factors != 1.0).any() else _all_mistaken(spans, stated, asked)


def _all_mistaken(spans: NDArray, stated: Sequence[str], asked: NDArray) -> NDArray:
    """Return what mends joints that all turned by two turns or more as stated, or less mended."""
    own, unit = np.flatnonzero(asked & (spans > 0.0)), {*np.array(stated)[asked].tolist()}
    factors = np.ones(len(stated))
    if len(own) < len(stated) or len(unit) != 1 or not unit <= set(OTHER_UNIT):
        return factors
    factor = OTHER_UNIT[unit.pop()][1]
    if (spans > _LARGEST_SPAN).all() if factor < 1.0 else (factor * spans <= _LARGEST_SPAN).all():
        factors[:] = factor
    return factors

"""Which joint was read wrongly where points were set aside: that along which all of them lie.

A joint that is read wrongly by any angle moves a point along one line, that of its derivative by
the joint. Whitened, with e what a point is off by, c that derivative and rest = e'e - (c'e)^2/c'c,
the point is as likely as exp(-rest / 2) / 2 pi across the line. A point that is wrong in any way
lies in any direction: on half a sphere of radius |e|. The ratio of both,

    B = e'e exp(-rest / 2),

is weighed for each joint over all points, of which half may be wrong in another way:
sum log (1 + B) / 2, a logarithm of likelihoods.
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.hand_noise import whitening_of
from nico_selfmodel.estimation.noise.joint_slips import FEWEST_SLIPS, OFTEN_AT

_ALIKE = 5.0
"""Difference of the logarithms below which the points do not tell two joints apart."""


def misread_joints(
    residuals: NDArray, by_angle: NDArray, covariance: NDArray
) -> tuple[tuple[int, ...], NDArray]:
    """Return which joint may have been read wrongly where points were set aside.

    Args:
        residuals: Measured minus predicted, of these points [m]. Shape (N, 3).
        by_angle: Derivatives of them by the joint angles. Shape (N, 3, n).
        covariance: Of what is expected of each [m^2]. Shape (N, 3, 3).

    Returns:
        The likeliest joint and those that the points do not tell from it, none where no joint
        explains them; and by how much the likeliest was off at each point, nan where another cause
        is likelier [rad]. Shape (N,).
    """
    off = np.full(len(residuals), np.nan)
    if len(residuals) < FEWEST_SLIPS:
        return (), off
    white = whitening_of(covariance, np.ones(residuals.shape, dtype=bool))
    e = np.einsum("nab,nb->na", white, residuals)
    c = white @ by_angle
    power = np.maximum(np.sum(c * c, axis=1), np.finfo(float).tiny)
    angle = np.einsum("nak,na->nk", c, e) / power
    square = np.sum(e * e, axis=1)[:, None]
    ratio = np.log(square) - 0.5 * (square - angle**2 * power)
    gain = np.sum(np.logaddexp(0.0, ratio) - np.log(2.0), axis=0)
    best = int(np.argmax(gain))
    if gain[best] - np.log(len(gain)) < OFTEN_AT:
        return (), off
    own = ratio[:, best] > 0.0
    off[own] = angle[own, best]
    alike = np.flatnonzero(gain > gain[best] - _ALIKE)
    return tuple(alike[np.argsort(-gain[alike])].tolist()), off

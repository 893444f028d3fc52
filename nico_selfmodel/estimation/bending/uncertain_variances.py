"""What it costs that variances are learned: error bars of a fit whose priors the data told.

A fit weighs its numbers x, of covariance C, by variances: v_g of the numbers w_g of each effect,
and that of the noise, s^2. These are learned from the same data, and C takes them as known. What is
not known of them adds to it (law of total variance, to second order in their logarithms, whose
covariance is K; Kackar and Harville 1984 have the first part, D K D'):

    x by log v_g    D_g = C L_g (x - m)                 L_g = 1 / v_g on the numbers of g, else 0
    x by log s^2    D_s = -sum_g D_g
    information     F_gh = |1 - L^1/2 C L^1/2|_gh^2 / 2     (and 1/2 on its diagonal: see below)
                    F_gs = tr (C - C L C)_gg L_g / 2
                    F_ss = (N - 2 tr(1 - C L) + tr (1 - C L)^2) / 2         K = F^-1
    covariance      (1 + K_ss) (C + D K D' + sum_gh K_gh C L_g C L_h C)

The last sum is the mean of C less C: log v_g, as that of an inverse gamma, is K_gg / 2 above its
mode in the mean, which cancels the other part of the second derivative, -C L_g C. Without all this
sigmas of unseen poses were 4 to 9 % too small, the more so the more effects there are. What the
data tell of log v_g is added to 1/2: an effect's size is known to a factor of two beforehand.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.bending.effect_fit import EffectFit
from nico_selfmodel.optimization.uncertainty import Uncertainty

_BEFOREHAND = 0.5
"""Information that the logarithm of an effect's variance has without data."""


def with_uncertain_variances(
    known: Uncertainty, values: Mapping[str, float], fit: EffectFit
) -> Uncertainty:
    """Return an uncertainty that counts how well variances are known.

    Args:
        known: As if they were known.
        fit: Whose variances held the effects.
    """
    groups = [e for e, names in fit.groups.items() if fit.variance[e] > 0.0 and names]
    index = {name: i for i, name in enumerate(known.names)}
    own = np.zeros((len(known.names), len(groups)))
    away, L = np.zeros(len(known.names)), np.zeros(len(known.names))
    for g, effect in enumerate(groups):
        for name in fit.groups[effect]:
            i = index[name]
            own[i, g], L[i] = 1.0, 1.0 / fit.variances[name]
            away[i] = values[name] - fit.means.get(name, 0.0)
    C = known.covariance
    F = _information(C, L, own, known.equations - int(own.sum()))
    learned = [g for g, effect in enumerate(groups) if effect not in fit.known]
    K = np.linalg.inv(F[np.ix_([*learned, -1], [*learned, -1])])
    D = C @ (own * (L * away)[:, None])
    D = np.column_stack([D[:, learned], -D.sum(axis=1)])
    pairs = own[:, learned] @ K[:-1, :-1] @ own[:, learned].T
    wider = (1.0 + K[-1, -1]) * (C + D @ K @ D.T + C @ (pairs * C * np.outer(L, L)) @ C)
    sigma = np.where(np.isfinite(known.sigma), np.sqrt(np.diag(wider)), np.inf)
    return replace(known, covariance=0.5 * (wider + wider.T), sigma=sigma)


def _information(C: NDArray, L: NDArray, own: NDArray, numbers: int) -> NDArray:
    """Return F, of groups and the noise. Shape (G + 1, G + 1)."""
    root, CL = np.sqrt(L), C * L
    told = (L > 0.0) * np.eye(len(C)) - C * np.outer(root, root)
    F = np.zeros((own.shape[1] + 1,) * 2)
    F[:-1, :-1] = own.T @ told**2 @ own + 2.0 * _BEFOREHAND * np.eye(own.shape[1])
    F[-1, :-1] = F[:-1, -1] = ((np.diag(C) - np.sum(CL * C, axis=1)) * L) @ own
    fitted = np.eye(len(C)) - CL
    F[-1, -1] = numbers - 2.0 * np.trace(fitted) + np.sum(fitted * fitted.T)
    return 0.5 * F

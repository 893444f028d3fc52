"""The most likely size of a change, with what the model is uncertain by common to all poses.

Maximises over the change theta and the model's own errors delta

    sum_i ln f(r_i - J_i delta - [i after the change] H_i theta) - 1/2 delta' C^-1 delta

f being the mixture of the noise: each round weighs core and tail of every pose by their chances and
solves the normal equations (expectation and maximisation).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.mixture_density import MixtureDensity
from nico_selfmodel.estimation.noise.pose_residuals import PoseResiduals
from nico_selfmodel.model.noise_mixture import NoiseMixture
from nico_selfmodel.optimization.uncertainty import root_of

_ROUNDS, _TOLERANCE = 50, 1e-3
"""Most rounds, and the gain in the likelihood's logarithm at which they end."""
_SHOWN = 1e-9
"""Least eigenvalue, of one, of a direction that the poses show."""


@dataclass(frozen=True, eq=False)
class ChangeEstimate:
    """A change as the poses tell it."""

    log_likelihood: float
    """Logarithm of the likelihood, the model's own errors weighed by their prior."""
    change: NDArray
    """theta, zero along what the poses do not show. Shape (d,)."""
    sigma: NDArray
    """Its standard deviations. Shape (d,)."""
    dof: int
    """How many directions of it the poses show."""
    of_pose: NDArray
    """What each pose says for having been taken after it, the logarithm of a likelihood ratio,
    ln f(r - J delta - H theta) - ln f(r - J delta). Shape (N,)."""


class ChangeLikelihood:
    """Poses of which some may have been taken after a change."""

    def __init__(self, poses: PoseResiduals, noise: NoiseMixture, covariance: NDArray) -> None:
        """Take poses.

        Args:
            poses: N poses.
            noise: Core and tail.
            covariance: C of the model's parameters. Shape (P, P).
        """
        self._poses, self._density = poses, MixtureDensity(poses, noise)
        self._white = self._density.whiten(poses.residuals)
        self._own = self._density.whiten(poses.slopes @ root_of(covariance))

    def of(self, basis: NDArray, since: int) -> ChangeEstimate:
        """Return the most likely change.

        Args:
            basis: Directions of change among the parameters; none for no change. Shape (P, d).
            since: First pose after it.
        """
        own, d = self._own, basis.shape[1]
        p = own.shape[3]
        after = (np.arange(len(self._poses)) >= since)[:, None, None]
        size = np.linalg.norm((self._poses.slopes @ basis) * after, axis=(0, 1))
        units = basis / np.where(size > 0.0, size, 1.0)
        everywhere = self._density.whiten(self._poses.slopes @ units)
        columns = np.concatenate([own, everywhere * after], axis=3)
        prior = np.diag(np.r_[np.ones(p), np.zeros(d)])
        # All poses taken for the tail: close to least squares, whatever the size of the change.
        chance = np.stack([np.zeros(len(after)), np.ones(len(after))])
        best, x, matrix = -np.inf, np.zeros(p + d), prior
        for _ in range(_ROUNDS):
            x, matrix = self._solved(columns, chance, prior)
            left = self._white - columns @ x
            logs = self._density.log_of_white(left)
            total = np.logaddexp(*logs)
            before, best = best, float(total.sum() - 0.5 * x[:p] @ x[:p])
            chance = np.exp(logs - total)
            if best - before < _TOLERANCE:
                break
        inverse, rank = _pseudo_inverse(matrix)
        scale = np.where(size > 0.0, size, np.inf)
        sigma = np.sqrt(np.maximum(np.diag(inverse)[p:], 0.0)) / scale
        left = self._white - own @ x[:p]
        of_pose = self._log(left - everywhere @ x[p:]) - self._log(left)
        return ChangeEstimate(best, x[p:] / scale, sigma, max(rank - p, 0), of_pose)

    def _log(self, white: NDArray) -> NDArray:
        return np.logaddexp(*self._density.log_of_white(white))

    def _solved(self, columns: NDArray, chance: NDArray, prior: NDArray) -> tuple[NDArray, NDArray]:
        """Return the weighted solution and its normal matrix."""
        root = np.sqrt(chance)[:, :, None]
        a = (columns * root[..., None]).reshape(self._white.size, columns.shape[3])
        matrix = a.T @ a + prior
        size = _sizes(matrix)
        # What the poses do not show stays where it is: its row of a is zero, or to rounding.
        whole = matrix / np.outer(size, size) + _SHOWN * np.eye(len(size))
        return np.linalg.solve(whole, a.T @ (self._white * root).ravel() / size) / size, matrix


def _pseudo_inverse(matrix: NDArray) -> tuple[NDArray, int]:
    """Return the inverse of a normal matrix along what the poses show, and its rank."""
    size = _sizes(matrix)
    values, vectors = np.linalg.eigh(matrix / np.outer(size, size))
    kept = values > _SHOWN
    inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T / np.outer(size, size)
    return inverse, int(kept.sum())


def _sizes(matrix: NDArray) -> NDArray:
    return np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))

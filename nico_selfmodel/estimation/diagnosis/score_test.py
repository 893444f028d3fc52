"""Score tests: whether residuals at a solution ask for effects that the model does not have.

An effect is columns Z, the change of the predictions by its numbers. With U the whitened Jacobian
of what was fitted, Z is taken off it, and the fall of the squares z'Z (Z'Z)^-1 Z'z is chi square of
the number of columns where the effect is not there (Rao 1948). Nothing is solved again.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.arm_solution import Linearised
from nico_selfmodel.optimization.chi_square import chi_square_tail


@dataclass(frozen=True, eq=False)
class Score:
    """What residuals say of one effect."""

    gain: float
    """Fall of the whitened sum of squares, in units of its expectation per coordinate."""
    dof: int
    """Columns that the fit does not already have."""
    values: NDArray
    """Its numbers. Shape (m,)."""
    sigma: NDArray
    """Standard deviations of its numbers; inf of those that the fit has already. Shape (m,)."""
    rms: float
    """What it moves the rows by, beyond what the fit takes [unit of the residuals]."""
    improvement: float
    """The mean residual without it over that with it."""

    @property
    def chance(self) -> float:
        """How often noise alone does so much."""
        return chi_square_tail(self.gain, self.dof) if self.dof else 1.0


class ScoreTest:
    """Residuals and fitted directions at a solution, against which effects are held."""

    def __init__(self, linear: Linearised, fitted: NDArray) -> None:
        """Prepare.

        Args:
            linear: Residuals and derivatives at the solution.
            fitted: Changes of the predictions that the fit could make. Shape (N, 3, k).
        """
        self.linear, self._fitted = linear, fitted
        U = linear.whitened(fitted)
        self._size = np.maximum(np.linalg.norm(U, axis=0), np.finfo(float).tiny)
        self._Q, self._R = np.linalg.qr(U / self._size)
        u = linear.whitened_residuals
        self.u = u - self._Q @ (self._Q.T @ u)
        self.count = 3 * len(linear.whitening.groups.rows)
        self.redundancy = max(self.count - U.shape[1], 1)
        self.variance = max(float(self.u @ self.u) / self.redundancy, np.finfo(float).tiny)

    @classmethod
    def at(cls, linear: Linearised, free: frozenset[str]) -> "ScoreTest":
        """Prepare the test at a solution whose free parameters were fitted."""
        chosen = [i for i, name in enumerate(linear.names) if name in free]
        return cls(linear, linear.jacobian[:, :, chosen])

    def of(self, columns: NDArray) -> Score:
        """Hold an effect against the residuals.

        Args:
            columns: Change of the predictions by its numbers. Shape (N, 3, m).

        Returns:
            The score; columns that the fit has already do not count.
        """
        Z = self.linear.whitened(columns)
        length = np.linalg.norm(Z, axis=0)
        inside = self._Q.T @ Z
        Z = Z - self._Q @ inside
        size = np.maximum(length, np.finfo(float).tiny)
        values, vectors = np.linalg.eigh((Z / size).T @ (Z / size))
        kept = values > 1e-6
        basis = vectors[:, kept] / values[kept]
        along = (Z / size).T @ self.u
        numbers = basis @ (vectors[:, kept].T @ along) / size
        fall = float(along @ (basis @ (vectors[:, kept].T @ along)))
        taken = np.linalg.lstsq(self._R, inside @ numbers, rcond=1e-10)[0] / self._size
        moved = np.tensordot(columns, numbers, 1) - np.tensordot(self._fitted, taken, 1)
        rows = self.linear.whitening.groups.rows
        before, after = (
            np.linalg.norm(r[rows], axis=1).mean()
            for r in (self.linear.residuals, self.linear.residuals - moved)
        )
        return Score(
            fall / self.variance,
            int(kept.sum()),
            numbers,
            self._sigma(basis, vectors, kept, size),
            float(np.sqrt(np.mean(np.sum(moved[rows] ** 2, axis=1)))),
            float(before / max(after, np.finfo(float).tiny)),
        )

    def _sigma(self, basis: NDArray, vectors: NDArray, kept: NDArray, size: NDArray) -> NDArray:
        """Return the standard deviations of an effect's numbers. Shape (m,)."""
        variance = np.sum(basis * vectors[:, kept], axis=1) / size**2 * self.variance
        lost = (np.abs(vectors[:, ~kept]) > 1e-3).any(axis=1)
        return np.where(lost, np.inf, np.sqrt(variance))

"""Score tests: whether residuals at a solution ask for effects that the model does not have.

An effect is columns Z, the change of the predictions by its numbers. With U the whitened Jacobian
of what was fitted, Z is taken off it, and the fall of the squares z'Z (Z'Z)^-1 Z'z is chi square of
the number of columns where the effect is not there (Rao 1948). Nothing is solved again.
"""

from dataclasses import dataclass, fields
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.arm_solution import Linearised, Priors
from nico_selfmodel.optimization.chi_square import chi_square_tail

_TOLD = 1e-6
"""Part of an effect's square below which the fit has it already."""


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


class Weighed(Protocol):
    """Residuals at a solution, d numbers a row, as noise weighs them."""

    @property
    def residuals(self) -> NDArray:
        """Measured minus predicted, in one unit. Shape (N, d)."""
        ...

    @property
    def by_angle(self) -> NDArray:
        """Derivatives of the predictions by displacements of joints. Shape (N, d, n)."""
        ...

    @property
    def rows(self) -> NDArray:
        """Which rows count. Shape (K,)."""
        ...

    @property
    def whitened_residuals(self) -> NDArray:
        """Those of the rows that count, then what priors leave. Shape (T,)."""
        ...

    def whitened(self, columns: NDArray) -> NDArray:
        """Whiten columns of the rows that count. Shape (N, d, m) -> (T, m)."""
        ...


_Weighed_co = TypeVar("_Weighed_co", bound=Weighed, covariant=True)


class ScoreTest(Generic[_Weighed_co]):
    """Residuals and fitted directions at a solution, against which effects are held."""

    def __init__(self, linear: _Weighed_co, fitted: NDArray, white: NDArray | None = None) -> None:
        """Prepare.

        Args:
            linear: Residuals and derivatives at the solution.
            fitted: Changes of the predictions that the fit could make. Shape (N, d, k).
            white: The same whitened, where priors hold some. Shape (T, k).
        """
        self.linear, self._fitted = linear, fitted
        self._white = linear.whitened(fitted) if white is None else white
        U, u = self._white, linear.whitened_residuals
        self._size = np.maximum(np.linalg.norm(U, axis=0), np.finfo(float).tiny)
        self._Q, self._R = np.linalg.qr(U / self._size)
        self.u = u - self._Q @ (self._Q.T @ u)
        count = linear.residuals.shape[1] * len(linear.rows)
        self.redundancy = max(count - U.shape[1], 1)
        self.variance = max(float(self.u @ self.u) / self.redundancy, np.finfo(float).tiny)

    def beside(self, columns: NDArray) -> "ScoreTest[_Weighed_co]":
        """Return the test had the fit some effects too. Shape (N, d, m)."""
        fitted = np.concatenate([self._fitted, columns], axis=2)
        white = np.hstack([self._white, self.linear.whitened(columns)])
        return ScoreTest(self.linear, fitted, white)

    def one_by_one(self, columns: NDArray) -> tuple[NDArray, NDArray]:
        """Hold columns against the residuals, each an effect by itself. Shape (N, d, m).

        Returns:
            Gains and numbers of each, as of a `Score`; 0 of what the fit has already. (m,) each.
        """
        Z = self.linear.whitened(columns)
        length = np.sum(Z**2, axis=0)
        Z = Z - self._Q @ (self._Q.T @ Z)
        left, along = np.sum(Z**2, axis=0), Z.T @ self.u
        told = left > _TOLD * np.maximum(length, np.finfo(float).tiny)
        values = np.divide(along, left, out=np.zeros(len(along)), where=told)
        return values * along / self.variance, values

    def of(self, columns: NDArray, *, of_moved: bool = False) -> Score:
        """Hold an effect against the residuals.

        Args:
            columns: Change of the predictions by its numbers. Shape (N, d, m).
            of_moved: Whether errors are compared of rows that it moves, not of all.

        Returns:
            The score; columns that the fit has already do not count.
        """
        Z = self.linear.whitened(columns)
        length = np.linalg.norm(Z, axis=0)
        inside = self._Q.T @ Z
        Z = Z - self._Q @ inside
        size = np.maximum(length, np.finfo(float).tiny)
        values, vectors = np.linalg.eigh((Z / size).T @ (Z / size))
        kept = values > _TOLD
        basis = vectors[:, kept] / values[kept]
        along = (Z / size).T @ self.u
        numbers = basis @ (vectors[:, kept].T @ along) / size
        fall = float(along @ (basis @ (vectors[:, kept].T @ along)))
        taken = np.linalg.lstsq(self._R, inside @ numbers, rcond=1e-10)[0] / self._size
        moved = np.tensordot(columns, numbers, 1) - np.tensordot(self._fitted, taken, 1)
        rows = self.linear.rows
        if of_moved:
            rows = rows[columns[rows].any(axis=(1, 2))]
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


ArmTest = ScoreTest[Linearised]
"""Of an arm."""


@dataclass(frozen=True, eq=False)
class _Held(Linearised):
    """Rows about an arm of which some parameters are held near what is known beforehand."""

    left: NDArray
    """What priors leave, over their standard deviations. Shape (p,)."""

    def whitened(self, columns: NDArray) -> NDArray:
        """Whiten columns; an effect moves no prior. Shape (N, 3, m) -> (coordinates + p, m)."""
        white = super().whitened(columns)
        return np.vstack([white, np.zeros((len(self.left), white.shape[1]))])

    @property
    def whitened_residuals(self) -> NDArray:
        """Those of the rows that count, then what priors leave. Shape (coordinates + p,)."""
        rows = super().whitened(self.residuals[:, :, None])[:, 0]
        return np.concatenate([rows, self.left])


def arm_test(
    linear: Linearised,
    free: frozenset[str],
    priors: Priors | None = None,
    values: NDArray | None = None,
) -> ArmTest:
    """Prepare the test of an arm at a solution whose free parameters were fitted.

    Args:
        priors: Those that the fit had; without them what bends would take what it could not.
        values: Of all parameters, in the order of `linear.names`. Shape (P,).
    """
    chosen = [i for i, name in enumerate(linear.names) if name in free]
    fitted, known = linear.jacobian[:, :, chosen], priors or {}
    held = [(k, i) for k, i in enumerate(chosen) if linear.names[i] in known]
    if values is None or not held:
        return ScoreTest(linear, fitted)
    means, sigmas = np.array([known[linear.names[i]] for _, i in held]).T
    columns, at = zip(*held, strict=True)
    # Rows are not weighed here by what their poses count, as they were in the fit.
    sigmas = sigmas * np.sqrt(linear.whitening.groups.weight.mean())
    parts = {part.name: getattr(linear, part.name) for part in fields(Linearised)}
    rows = _Held(**parts, left=(means - values[list(at)]) / sigmas)
    white = rows.whitened(fitted)
    white[np.arange(len(held)) - len(held), list(columns)] = 1.0 / sigmas
    return ScoreTest(rows, fitted, white)

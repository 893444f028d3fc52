"""Errors that poses share with poses that are alike.

What a controller tells of its flange is off by what its arm is not quite as it has it: nearly the
same in poses that are nearly the same. So is what a camera tells of how a board is turned: lens and
print are off in the same way again. Such an error is a Gaussian process over poses, of covariance

    K_kl = exp(-(a_kl^2 / A^2 + d_kl^2 / D^2) / (2 s^2))

of poses that are turned by a_kl (chord) and shifted by d_kl against each other, A and D their root
mean squares over all pairs and s what `alike` means. With Phi Phi' = K, of its largest
eigenvectors, a part of the poses' errors is Phi w, w ~ N(0, g^2).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_MOST = 36
"""Eigenvectors of K that are kept at most."""
_LEFT_OUT = 0.02
"""Share of the sum of the eigenvalues that may be left out."""


def turn_groups(first: int) -> NDArray:
    """Return the noise groups of turns across and about the line of sight, by their first. (3,)."""
    return np.array([first, first, first + 1])


def alike_basis(X: NDArray, size: float) -> NDArray:
    """Return Phi.

    Args:
        X: Poses. Shape (N, 4, 4).
        size: s.

    Returns:
        Shape (N, q).
    """
    R, p = X[:, :3, :3], X[:, :3, 3]
    turns = 3.0 - np.einsum("aij,bij->ab", R, R)
    shifts = np.sum((p[:, None] - p[None]) ** 2, axis=2)
    apart = sum(d / max(float(d.mean()), np.finfo(float).tiny) for d in (turns, shifts))
    values, vectors = np.linalg.eigh(np.exp(-0.5 * apart / size**2))
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    left = 1.0 - np.cumsum(values) / values.sum()
    count = min(int(np.argmax(left < _LEFT_OUT)) + 1, _MOST, len(values))
    return np.asarray(vectors[:, :count] * np.sqrt(values[:count]))


@dataclass(frozen=True, eq=False)
class AlikeErrors:
    """How large the errors are that poses share with poses that are alike."""

    basis: NDArray
    """Phi, of all poses. Shape (N, q)."""
    sigma: NDArray
    """g of each part of a pose's errors; 0 of what is each pose's own. Shape (m,)."""
    alone: NDArray
    """Standard deviation of what is each pose's own besides. Shape (m,)."""
    turns: int | None = None
    """First noise group of a sensor of whose measured turns, m = 3, these are; None of a flange's.
    """

    def columns(self, by_part: NDArray, pose: NDArray) -> NDArray:
        """Return what w of N(0, 1) do to rows.

        Args:
            by_part: Derivatives of the rows by the parts of their pose's errors. Shape (R, m).
            pose: Pose of each row. Shape (R,).

        Returns:
            Shape (R, parts that are shared x q).
        """
        own = np.flatnonzero(self.sigma > 0.0)
        by_own = (by_part[:, own] * self.sigma[own])[:, :, None]
        return np.asarray((by_own * self.basis[pose][:, None]).reshape(len(pose), -1))


@dataclass(frozen=True, eq=False)
class Decorrelation:
    """(1 + E E')^-1/2 of rows: with E = U s V' it is 1 - U (1 - (1 + s^2)^-1/2) U'."""

    E: NDArray
    """What shared errors of N(0, 1) do to rows whitened by what is each pose's own. (R, q)."""
    _U: NDArray
    _taken: NDArray

    @classmethod
    def of(cls, E: NDArray) -> "Decorrelation":
        """Prepare."""
        U, s, _ = np.linalg.svd(E, full_matrices=False)
        return cls(E, U, 1.0 - 1.0 / np.sqrt(1.0 + s**2))

    def __call__(self, white: NDArray) -> NDArray:
        """Return the rows. Shape (R, m) -> the same."""
        return np.asarray(white - self._U @ (self._taken[:, None] * (self._U.T @ white)))

    def of_some(self, white: NDArray, rows: NDArray) -> NDArray:
        """Return some rows, what they share with each other taken out and not with the rest.

        Args:
            white: All rows as they are called. Shape (R, m).
            rows: Boolean, shape (R,).

        Returns:
            Shape (K, m).
        """
        more = (self._taken / (1.0 - self._taken))[:, None]
        before = white + self._U @ (more * (self._U.T @ white))
        return Decorrelation.of(self.E[rows])(before[rows])

"""Residuals in which each observation has variables of its own, such as the pose of one board.

The normal equations of V observations with m variables of their own and s shared ones are
block-bordered; the own variables are eliminated by the Schur complement (Brown 1958, Triggs et al.
1999), so that a step costs O(V), not O(V^3).
"""

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

Parts = tuple[NDArray, NDArray, NDArray]
"""Residuals (V, k), derivatives by the shared variables (V, s, k) and by its own (V, m, k)."""


class SeparableBlock(ABC):
    """A residual block whose variables are shared ones, then m for each of its V observations.

    Attributes:
        names: All variables: the shared ones first, then those of each observation in turn.
        own: How many variables an observation has to itself, m.
    """

    names: tuple[str, ...]
    own: int

    @abstractmethod
    def evaluate_parts(self, x: NDArray) -> Parts:
        """Return whitened residuals and derivatives; x has the values of `names`."""

    def shared_and_own(self, columns: NDArray) -> tuple[NDArray, NDArray]:
        """Split indices of `names` into the shared ones (s,) and each observation's own (V, m)."""
        observations = self.observation_count
        split = len(self.names) - observations * self.own
        return columns[:split], columns[split:].reshape(observations, self.own)

    @property
    @abstractmethod
    def observation_count(self) -> int:
        """Number of observations, V."""

    def residuals(self, x: NDArray) -> NDArray:
        """Return whitened residuals. Shape (k, V)."""
        return self.evaluate_parts(x)[0].T

    def evaluate(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return residuals (k, V) and dense derivatives (p, k, V), mostly zeros."""
        r, by_shared, by_own = self.evaluate_parts(x)
        count, k = r.shape
        shared, own = self.shared_and_own(np.arange(len(self.names)))
        jacobian = np.zeros((len(self.names), k, count))
        jacobian[shared] = np.moveaxis(by_shared, 0, -1)
        jacobian[own, :, np.arange(count)[:, None]] = by_own
        return r.T, jacobian

    def add_normal_equations(
        self, parts: Parts, weight: NDArray, columns: NDArray, gradient: NDArray, hessian: NDArray
    ) -> None:
        """Add w J'r and w J'J of every observation to dense arrays of all variables.

        Args:
            parts: As returned by `evaluate_parts`.
            weight: Of each observation. Shape (V,).
            columns: Positions of `names` among all variables. Shape (len(names),).
            gradient: Added to. Shape (p,).
            hessian: Added to. Shape (p, p).
        """
        r, by_shared, by_own = parts
        if not np.all(weight == 1.0):
            root = np.sqrt(weight)
            r = r * root[:, None]
            by_shared, by_own = by_shared * root[:, None, None], by_own * root[:, None, None]
        shared, own = self.shared_and_own(columns)
        shared_transposed = np.swapaxes(by_shared, 1, 2)
        gradient[shared] += (by_shared @ r[:, :, None]).sum(axis=0)[:, 0]
        gradient[own] += (by_own @ r[:, :, None])[:, :, 0]
        hessian[np.ix_(shared, shared)] += (by_shared @ shared_transposed).sum(axis=0)
        cross = (by_own @ shared_transposed).reshape(-1, len(shared))
        hessian[np.ix_(own.ravel(), shared)] += cross
        hessian[np.ix_(shared, own.ravel())] += cross.T
        hessian[own[:, :, None], own[:, None, :]] += by_own @ np.swapaxes(by_own, 1, 2)

    @staticmethod
    def reduced_jacobian(parts: Parts, weight: NDArray) -> NDArray:
        """Return what the residuals say of the shared variables once each has its own freely.

        (I - Q Q') J_s with Q an orthonormal basis of the own derivatives of each observation.

        Args:
            parts: As returned by `evaluate_parts`.
            weight: Of each observation. Shape (V,).

        Returns:
            Shape (V k, s).
        """
        _, by_shared, by_own = parts
        q = np.linalg.qr(np.swapaxes(by_own, 1, 2))[0]
        free = by_shared - (by_shared @ q) @ np.swapaxes(q, 1, 2)
        weighted = np.swapaxes(free * np.sqrt(weight)[:, None, None], 1, 2)
        return weighted.reshape(-1, by_shared.shape[1])

    @staticmethod
    def own_leverage(parts: Parts) -> NDArray:
        """Return how much of each residual its observation's own variables take up.

        Args:
            parts: As returned by `evaluate_parts`.

        Returns:
            The diagonal of Q Q'. Shape (V k,).
        """
        q = np.linalg.qr(np.swapaxes(parts[2], 1, 2))[0]
        return np.sum(q * q, axis=2).ravel()


def eliminated_step(
    hessian: NDArray, gradient: NDArray, damping: NDArray, own: NDArray
) -> NDArray | None:
    """Solve (H + diag(damping)) step = -g with block-diagonal parts eliminated.

    With H = [A B'; B C], C block-diagonal: (A - B' C^-1 B) a = -(g_a - B' C^-1 g_c).

    Args:
        hessian: Gauss-Newton matrix. Shape (p, p).
        gradient: Shape (p,).
        damping: Shape (p,).
        own: Indices of the blocks of C. Shape (V, m).

    Returns:
        The step, shape (p,); None where the matrix is not positive definite.
    """
    try:
        shared, matrix, right, solved = _eliminate(hessian, gradient, damping, own)
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return None
    step = np.empty_like(gradient)
    step[shared] = -np.linalg.solve(matrix, right)
    step[own] = -(solved[:, :, -1] + solved[:, :, :-1] @ step[shared])
    return step


def shared_information(hessian: NDArray, own: NDArray) -> tuple[NDArray, NDArray] | None:
    """Return what is known of the shared variables once each observation has its own freely.

    The inverse of A - B' C^-1 B is the shared part of the inverse of the whole matrix.

    Args:
        hessian: Gauss-Newton matrix. Shape (p, p).
        own: Indices of the blocks of C. Shape (V, m).

    Returns:
        Indices of the shared variables, shape (s,), and the matrix, shape (s, s); None where an
        observation leaves its own variables open.
    """
    nothing = np.zeros(len(hessian))
    try:
        return _eliminate(hessian, nothing, nothing, own)[:2]
    except np.linalg.LinAlgError:
        return None


def _eliminate(
    hessian: NDArray, gradient: NDArray, damping: NDArray, own: NDArray
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Return the shared indices, A - B' C^-1 B, g_a - B' C^-1 g_c, and C^-1 [B g_c].

    Raises:
        LinAlgError: If C is not positive definite.
    """
    rest = np.ones(len(gradient), dtype=bool)
    rest[own.ravel()] = False
    shared = np.flatnonzero(rest)
    blocks = hessian[own[:, :, None], own[:, None, :]]
    m = own.shape[1]
    blocks[:, np.arange(m), np.arange(m)] += damping[own]
    border = hessian[np.ix_(own.ravel(), shared)].reshape(*own.shape, len(shared))
    np.linalg.cholesky(blocks)
    solved = np.linalg.solve(blocks, np.concatenate([border, gradient[own][:, :, None]], axis=2))
    # One product for all blocks: B' C^-1 [B g_c]
    reduced = border.reshape(own.size, len(shared)).T @ solved.reshape(own.size, len(shared) + 1)
    matrix = hessian[np.ix_(shared, shared)] - reduced[:, :-1]
    matrix.flat[:: len(shared) + 1] += damping[shared]
    return shared, matrix, gradient[shared] - reduced[:, -1], solved

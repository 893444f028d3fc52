"""Many small matrices at once, along contiguous memory: numpy's own loop over them takes longer."""

import numpy as np
from numpy.typing import NDArray


def invert_along(A: NDArray) -> NDArray:
    """Invert symmetric positive definite matrices in place, laid along the last axes.

    Args:
        A: Shape (n, n, ...); becomes the inverses.

    Returns:
        Logarithms of the determinants. Shape (...).
    """
    log = np.zeros(A.shape[2:])
    for k in range(len(A)):
        pivot, column = A[k, k].copy(), A[:, k].copy()
        row = A[k] / pivot
        A -= column[:, None] * row
        A[k], A[:, k], A[k, k] = row, -column / pivot, 1.0 / pivot
        log += np.log(pivot)
    return log


def inverse_cholesky(S: NDArray) -> tuple[NDArray, NDArray]:
    """Return L^-1 for S = L L', so that L^-1 S L^-T = I and L^-T L^-1 = S^-1.

    Args:
        S: Positive definite. Shape (N, n, n).

    Returns:
        L^-1, shape (N, n, n), and the logarithms of |S|, shape (N,).
    """
    L = _cholesky(S)
    return _rows_first(_lower_inverse(L)), _log_determinant(L)


def whitening_core(G: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Return X with (I - B X B')'(I - B X B') = I - B G^-1 B' for G = I + B'B.

    X = (L + I)^-T L^-1 with G = L L' (Andrews 1968, A square root formulation of the Kalman
    covariance equations).

    Args:
        G: Shape (N, n, n).

    Returns:
        X and L^-1, shapes (N, n, n), and the logarithms of |G|, shape (N,).
    """
    # Pivots of I + B'B are 1 and more, which those of a large B lose by rounding.
    L = _cholesky(G, 1.0)
    own, beside = _lower_inverse(L), _lower_inverse(L + np.eye(len(L))[:, :, None])
    core = np.ascontiguousarray(np.einsum("kiN,kjN->Nij", beside, own))
    return core, _rows_first(own), _log_determinant(L)


def _rows_first(matrices: NDArray) -> NDArray:
    return np.ascontiguousarray(matrices.transpose(2, 0, 1))


def _log_determinant(L: NDArray) -> NDArray:
    """Return log |L L'|. Shape (n, n, N) -> (N,)."""
    return np.asarray(2.0 * np.sum(np.log(np.einsum("iiN->iN", L)), axis=0))


def _cholesky(S: NDArray, least: float = -np.inf) -> NDArray:
    """Factor S = L L', of pivots that are `least` or more. Shape (N, n, n) -> (n, n, N)."""
    A = np.array(S.transpose(1, 2, 0), order="C")
    L = np.zeros_like(A)
    for j in range(len(A)):
        left = A[j:, j] - np.einsum("ikN,kN->iN", L[j:, :j], L[j, :j])
        left[0] = np.maximum(left[0], least)
        L[j:, j] = left / np.sqrt(left[0])
    return L


def _lower_inverse(L: NDArray) -> NDArray:
    """Invert lower triangular matrices. Shape (n, n, N)."""
    out = np.zeros_like(L)
    for j in range(len(L)):
        out[j] = -np.einsum("kN,kiN->iN", L[j, :j], out[:j])
        out[j, j] += 1.0
        out[j] /= L[j, j]
    return out

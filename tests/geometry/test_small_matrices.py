import numpy as np
import pytest

from nico_selfmodel.geometry.small_matrices import inverse_cholesky, whitening_core


def many(n, seed=0):
    B = np.random.default_rng(seed).normal(size=(50, 6, n))
    return B, np.eye(n) + np.swapaxes(B, 1, 2) @ B


@pytest.mark.parametrize("n", [1, 3, 7])
def test_inverse_factors_and_determinants_are_numpys(n):
    matrices = many(n)[1]
    lower, log = inverse_cholesky(matrices)
    inverse = np.linalg.inv(np.linalg.cholesky(matrices))
    np.testing.assert_allclose(lower, inverse, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(log, np.linalg.slogdet(matrices)[1], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("n", [1, 4, 7])
def test_a_whitening_core_whitens(n):
    B, G = many(n)
    core, lower, log = whitening_core(G)
    W = np.eye(6) - B @ core @ np.swapaxes(B, 1, 2)
    S = np.eye(6) + B @ np.swapaxes(B, 1, 2)
    whitened = W @ S @ np.swapaxes(W, 1, 2)
    np.testing.assert_allclose(whitened, np.broadcast_to(np.eye(6), S.shape), atol=1e-10)
    inverse = np.swapaxes(lower, 1, 2) @ lower
    np.testing.assert_allclose(inverse, np.linalg.inv(G), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(log, np.linalg.slogdet(G)[1], rtol=1e-12)


def test_matrices_are_left_as_they_were():
    matrices = many(4)[1]
    before = matrices.copy()
    inverse_cholesky(matrices)
    whitening_core(matrices)
    np.testing.assert_array_equal(matrices, before)


def test_a_core_of_columns_that_are_large_and_nearly_one_is_finite():
    B = 1e9 * np.ones((1, 6, 3)) + np.random.default_rng(3).normal(size=(20, 6, 3))
    core, lower, log = whitening_core(np.eye(3) + np.swapaxes(B, 1, 2) @ B)
    assert np.isfinite(core).all()
    assert np.isfinite(lower).all()
    assert np.isfinite(log).all()

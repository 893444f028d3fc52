"""Which surface the edges of a picture belong to."""

import numpy as np

from nico_selfmodel.vision.images.whose_edge import whose_edge

V, U = np.mgrid[0:40, 0:60]


def test_an_edge_is_the_nearer_surfaces_on_both_of_its_sides():
    depth = np.where(U < 30, 0.7, 0.9)
    owner = whose_edge(depth)
    assert (U.ravel()[owner][:, :33] < 30).all()
    itself = np.arange(depth.size).reshape(depth.shape)
    for rest in (np.s_[:, :30], np.s_[:, 33:]):
        assert np.array_equal(owner[rest], itself[rest])
    assert np.hypot(U.ravel()[owner] - U, V.ravel()[owner] - V).max() <= 3.0


def test_an_outline_is_the_bodys_and_not_what_is_behind_it():
    depth = np.where(np.hypot(U - 30, V - 20) < 10, 0.7, np.inf)
    owner = whose_edge(depth)
    beside = np.isinf(depth) & (np.hypot(U - 30, V - 20) < 11.5)
    assert beside.any()
    assert np.isfinite(depth.ravel()[owner][beside]).all()
    assert np.isinf(depth.ravel()[owner][np.hypot(U - 30, V - 20) > 14]).all()


def test_a_surface_that_is_turned_away_hides_nothing():
    depth = 0.7 + 2e-3 * U
    assert np.array_equal(whose_edge(depth), np.arange(depth.size).reshape(depth.shape))

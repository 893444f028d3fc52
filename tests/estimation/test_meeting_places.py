"""Markers that nothing sees are found by what they met."""

import numpy as np
import pytest

from nico_selfmodel.estimation.tree.guesses.meeting_places import meeting_places
from nico_selfmodel.geometry.rotation import rotation_from_vector

from ..slow_rest import slow_rest


def met(seed, rows=20, false=0, apart=0.03):
    """Links whose markers are as far apart as in all rows, but for some."""
    rng = np.random.default_rng(seed)
    R = rotation_from_vector(rng.normal(size=(rows, 2, 3)))
    true = rng.normal(size=(2, 3)) * 0.06
    way = rng.normal(size=(rows, 3))
    way *= apart / np.linalg.norm(way, axis=1, keepdims=True)
    way[:false] *= 2.0
    p = rng.normal(size=(rows, 2, 3)) * 0.3
    ends = np.einsum("neij,ej->nei", R, true)
    p[:, 1] = p[:, 0] + ends[:, 0] - ends[:, 1] - way + 2e-4 * rng.normal(size=(rows, 3))
    return R, p, true, np.tile(np.eye(2, dtype=bool), (rows, 1, 1))


@pytest.mark.slow
@pytest.mark.parametrize("false", slow_rest([0, 2]))
def test_two_markers_that_touch_are_found_from_far_off(false):
    found = []
    for seed in range(10):
        R, p, true, own = met(seed, false=false)
        at = np.zeros((len(R), 2, 3))
        places = meeting_places(R, p, at, own, np.zeros(len(R), int), np.ones(len(R)))
        found.append(np.abs(places - true).max() < 3e-3)
    assert sum(found) >= 9


def test_a_marker_that_touches_a_known_one_at_told_distances_is_found():
    R, p, true, own = met(3)
    at = np.tile(true, (len(R), 1, 1))
    at[:, 0] = 0.0
    lengths = np.full(len(R), 0.03)
    places = meeting_places(R, p, at, own[:, :, :1], np.zeros(len(R), int), lengths)
    assert places == pytest.approx(true[:1], abs=1e-3)

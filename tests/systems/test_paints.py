"""Robots whose paints are not those of their description."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.stations.nico_station import NicoStation

pytestmark = pytest.mark.slow


def surfaces(sigma, seed=3):
    """Return the true surfaces of a robot: link -> colours, and pose in the left camera."""
    with NicoStation(replace(IMPERFECTIONS["thesis"], paint_sigma=sigma), seed) as station:
        found = station.surfaces_true(station.CreateDefaultContext())
    return {link: (one.colors, X_LF) for link, (one, X_LF) in found.items()}


def colors(found):
    return np.concatenate([own for own, _ in found.values()])


@pytest.fixture(scope="module")
def described():
    return surfaces(0.0)


@pytest.fixture(scope="module")
def painted():
    return surfaces(0.1)


def test_one_seed_has_one_set_of_colours_and_stands_where_it_stood(described, painted):
    assert np.array_equal(colors(painted), colors(surfaces(0.1)))
    for link, (_, X_LF) in described.items():
        assert np.array_equal(painted[link][1], X_LF)


def test_colours_differ_by_their_sigma_and_are_others_for_each_robot(described, painted):
    both = np.column_stack([colors(described), colors(painted)])
    both = np.unique(both[(both < 0.9).all(axis=1)], axis=0)  # paints that are not cut off at 1
    assert 0.05 < np.std(np.log(both[:, 3:] / both[:, :3])) < 0.15
    assert colors(painted).max() <= 1.0
    assert not np.array_equal(colors(painted), colors(surfaces(0.1, seed=4)))


def test_what_is_described_in_one_colour_stays_of_one_colour(described, painted):
    pairs = np.unique(np.column_stack([colors(described), colors(painted)]), axis=0)
    tape = 1  # is no paint of the description's
    assert len(pairs) <= len(np.unique(colors(described), axis=0)) + tape

"""Recordings of one body become one."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.joining import joined
from nico_selfmodel.errors import DataError
from nico_selfmodel.sessions.whole_body import whole_body_session
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS


@pytest.fixture(scope="module")
def days():
    return [whole_body_session(IMPERFECTIONS["clean"], 0, s, looks=3, hands=0) for s in (0, 1)]


def test_two_recordings_keep_every_sample_and_all_that_was_seen_at_it(days):
    first, second = days
    both = joined(first, second, "both")
    assert len(both.sample) == 6
    assert len(set(both.sample.tolist())) == 6
    assert len(both.observations) == sum(len(day.observations) for day in days)
    later = both.select(np.arange(6) >= 3)
    assert np.array_equal(later.readings, second.readings)
    assert np.array_equal(later.observations.values, second.observations.values, equal_nan=True)
    assert np.array_equal(later.observations.pose, second.observations.pose)


def test_recordings_of_two_bodies_are_not_joined(days):
    first, second = days
    other = replace(second, markers=(replace(second.markers[0], name="a"), *second.markers[1:]))
    with pytest.raises(DataError, match="both must be of one body"):
        joined(first, other, "both")

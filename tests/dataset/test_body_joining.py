"""Recordings of one body become one."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_dataset import ObservationTable
from nico_selfmodel.dataset.body.joining import all_joined, joined
from nico_selfmodel.dataset.body.sensors import MarkerInfo, SensorInfo
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


def test_a_recording_in_degrees_joins_one_in_radians(days):
    first, second = days
    assert {j.encoder_unit for j in first.joints} == {"counts"}
    as_read = [replace(j, encoder_unit="rad", counts_per_turn=None, sign=1) for j in first.joints]
    turned = [replace(j, encoder_unit="deg", lower=-200.0, upper=200.0) for j in as_read]
    radians = replace(first, joints=tuple(as_read), readings=np.ones_like(first.readings))
    degrees = replace(second, joints=tuple(turned), readings=np.full(second.readings.shape, 90.0))
    both = joined(radians, degrees, "both")
    assert both.joints == radians.joints
    np.testing.assert_allclose(both.readings[:3], 1.0)
    np.testing.assert_allclose(both.readings[3:], np.pi / 2.0)


def test_recordings_of_two_bodies_are_not_joined(days):
    first, second = days
    last = len(second.joints) - 1
    moved = tuple(replace(j, name="a") if i == last else j for i, j in enumerate(second.joints))
    on = {second.joints[last].name: "a"}
    markers = tuple(replace(m, on=on.get(m.on, m.on)) for m in second.markers)
    other = replace(second, joints=moved, markers=markers)
    with pytest.raises(DataError, match="both must be of one body"):
        joined(first, other, "both")


def test_recordings_with_other_sensors_and_markers_have_all_of_them_together(days):
    first, second = days
    new = SensorInfo("tracker", "points")
    ball = MarkerInfo("ball", second.joints[-1].name)
    table = ObservationTable([0, 1], [0, 0], [0, 0], [-1, -1], [[0.1, 0.2, 0.3] + [np.nan] * 3] * 2)
    tracked = replace(second, sensors=(new,), markers=(ball,), observations=table)
    both = joined(tracked, first, "both")
    assert [s.name for s in both.sensors] == ["tracker", *(s.name for s in first.sensors)]
    assert both.markers == (ball, *first.markers)
    later = both.select(np.arange(6) >= 3)
    seen = {first.markers[m].name for m in first.observations.marker.tolist()}
    assert {both.markers[m].name for m in later.observations.marker.tolist()} == seen
    assert np.array_equal(later.observations.values, first.observations.values, equal_nan=True)
    assert len(all_joined([tracked, first, second], "three").sample) == 9


def test_a_recording_that_is_given_twice_is_refused(days):
    first, second = days
    with pytest.raises(DataError, match=r"recordings 1 .*, 3 .* are one and the same"):
        all_joined([first, second, replace(first, name="copy")], "all")


def test_a_name_that_means_something_else_is_refused_with_what_differs(days):
    first, second = days
    lens = (
        {**second.sensors[0].lens, "fx": 1.0} if second.sensors[0].lens else {"fx": 1.0, "fy": 1.0}
    )
    other = replace(second, sensors=(replace(second.sensors[0], lens=lens), *second.sensors[1:]))
    with pytest.raises(DataError, match=r"has 'lens' .* what has one name must be the same"):
        joined(first, other, "both")
    there = replace(
        second.markers[0], on="world" if second.markers[0].on != "world" else "neck_yaw"
    )
    other = replace(second, markers=(replace(there, xyz=None), *second.markers[1:]))
    with pytest.raises(DataError, match="give it another name"):
        joined(first, other, "both")


def test_a_guess_that_differs_is_the_first_ones(days):
    first, second = days
    told = replace(second.sensors[0], X_LS=np.eye(4), sigma=0.7)
    other = replace(second, sensors=(told, *second.sensors[1:]))
    assert joined(first, other, "both").sensors[0].sigma == first.sensors[0].sigma

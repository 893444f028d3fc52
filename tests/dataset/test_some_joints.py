"""The part of a recording that is about some joints."""

import numpy as np
import pytest

from nico_selfmodel.dataset.body.some_joints import of_joints
from nico_selfmodel.errors import DataError
from nico_selfmodel.sessions.whole_body import whole_body_session
from nico_selfmodel.systems.looking import HEAD_JOINTS
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS


@pytest.fixture(scope="module")
def whole():
    return whole_body_session(IMPERFECTIONS["clean"], 0, 0, looks=3, hands=1)


def test_of_a_head_its_cameras_and_the_room_are_left_with_what_they_saw(whole):
    head = of_joints(whole, HEAD_JOINTS)
    assert head.joint_names == HEAD_JOINTS
    assert np.array_equal(head.readings, whole.readings[:, :6])
    assert [info.name for info in head.sensors] == [info.name for info in whole.sensors]
    assert {info.on for info in head.markers} == {"world"}

    def rows(data):
        table = data.observations
        names, seeing = ([item.name for item in items] for items in (data.markers, data.sensors))
        parts = zip(table.pose, table.marker, table.sensor, table.values[:, :2], strict=True)
        return {(p, names[m], seeing[s], *v) for p, m, s, v in parts}

    room = {row for row in rows(whole) if row[1].startswith("card")}
    assert len(room) < len(rows(whole))
    assert rows(head) == room


def test_joints_that_a_recording_does_not_have_are_named(whole):
    with pytest.raises(DataError, match="has no joints tail"):
        of_joints(whole, ["tail"])

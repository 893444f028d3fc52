"""A hand that no picture shows is said before more is recorded."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import DataError
from nico_selfmodel.sessions import whole_scenario
from nico_selfmodel.sessions.rendered_body import RenderedBody
from nico_selfmodel.sessions.whole_body import whole_body_session
from nico_selfmodel.sessions.whole_scenario import learn_whole
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS


@pytest.mark.slow
def test_a_hand_that_no_picture_shows_is_named_before_more_is_recorded(monkeypatch):
    recorded = []

    def record(self, name, session, looks, hands, **_):
        recorded.append(name)
        data = whole_body_session(IMPERFECTIONS["thesis"], 3, session, looks=4, hands=2)
        names = [marker.name for marker in data.markers]
        left = [i for i, marker in enumerate(names) if marker.startswith("left_")]
        table = data.observations.select(~np.isin(data.observations.marker, left))
        return replace(data, observations=table)

    def look_about(robot, looks, progress):
        return robot.record("looks", 0, looks, 0), {}

    monkeypatch.setattr(RenderedBody, "record", record)
    monkeypatch.setattr(whole_scenario, "look_about", look_about)
    monkeypatch.setattr(whole_scenario, "with_lenses", lambda data, lenses: data)
    with pytest.raises(DataError, match=r"no picture shows left_hand_fiducial.*left hand"):
        learn_whole("thesis", 3, arms=("left",))
    assert recorded == ["looks", "hands"]

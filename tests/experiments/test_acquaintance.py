"""Robots that learn their cameras and arm: of which little is seen, and that cannot."""

import numpy as np
import pytest

from nico_selfmodel.errors import DataError, EstimationError
from nico_selfmodel.planning.visible_workspace import SPARE
from nico_selfmodel.sessions import camera_scenario
from nico_selfmodel.sessions.camera_scenario import Counts, watch_hand
from nico_selfmodel.sessions.mirrors import acquaintance
from nico_selfmodel.sessions.mirrors.acquaintance import acquainted
from nico_selfmodel.sessions.rendered_nico import FIDUCIAL, RenderedNico
from nico_selfmodel.systems.looking import touching_arm
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

WORLD = IMPERFECTIONS["thesis"]


@pytest.mark.slow
def test_a_robot_whose_hand_no_pose_of_fifteen_shows_goes_on_until_some_do():
    nico = RenderedNico(WORLD, 1968, (FIDUCIAL,), arm=touching_arm(FIDUCIAL))
    with pytest.raises(DataError, match="no rows"):
        nico.record("test", 2, 0, 12)
    seen = nico.record("test", 2, 0, 12, spare=5.0)
    assert len(np.unique(seen.sample)) >= 5


@pytest.mark.parametrize(("wanted", "spare"), [(12, 5.0), (48, SPARE), (100, SPARE)])
def test_sixty_poses_to_judge_by_are_planned_at_least(monkeypatch, wanted, spare):
    planned = []

    class Nico:
        def board_views(self, *_, **__): ...

        def record(self, *_, **how):
            planned.append(how.get("spare", SPARE))

    class Cameras:
        rig = None

    monkeypatch.setattr(camera_scenario, "calibrate_cameras", lambda *_: Cameras)
    watch_hand(Nico(), Counts(test=wanted))  # type: ignore[arg-type]
    assert planned == [SPARE, spare]


def test_a_robot_that_cannot_learn_its_arm_is_named(monkeypatch):
    def fails(*_):
        raise DataError("the data set has no rows; expected at least one")

    monkeypatch.setattr(acquaintance, "learn_six_joints", fails)
    with pytest.raises(EstimationError, match="robot 7 did not learn its arm: the data set has no"):
        acquainted(WORLD, (7,))

"""Whose cameras a robot at work may be watched with."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.sessions.watching import Watching
from nico_selfmodel.sessions.watching_body import WatchingBody
from nico_selfmodel.systems.looking import looking_arm
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

from ..true_nico import true_body, true_model

ARM = looking_arm("fiducial")


def test_a_body_that_learned_with_its_head_turned_elsewhere_is_refused():
    held = {**ARM.held, "neck_yaw": ARM.held["neck_yaw"] + 0.1}
    model = replace(true_model(ARM, "clean", 3), robot={**ARM.source, "held": held})
    with pytest.raises(ModelError, match=r"learned with neck_yaw at .* deg, and this Nico"):
        Watching(model, IMPERFECTIONS["clean"], 3)


@pytest.mark.slow
def test_a_whole_body_that_knows_itself_expects_its_hand_and_the_room_where_they_are_seen():
    model = true_body("clean", 3)
    with WatchingBody(model, IMPERFECTIONS["clean"], 3, recording=True) as watching:
        shown = watching.visit_random_poses(2)
        page = watching.view.html()
        followed = []
        watching.run(followed.append, 0.2)
    assert set(shown[0]) == {"right hand", "left hand", "room"}
    seen = np.array([error for one in shown for error in one.values()])
    assert np.isfinite(seen).any(axis=0).all()
    assert np.nanmax(seen) < 1.0
    assert followed[0].keys() == shown[0].keys()
    assert page.lstrip().lower().startswith("<!doctype html>")


def test_a_body_that_does_not_know_the_markers_of_its_hands_is_not_shown():
    model = true_body("clean", 3)
    tree = model.tree.with_markers(model.tree.markers[4:])
    with pytest.raises(ModelError, match=r"not know the markers right_hand_fiducial_0, .* --head"):
        WatchingBody(replace(model, tree=tree), IMPERFECTIONS["clean"], 3)

"""Whose cameras a robot at work may be watched with."""

from dataclasses import replace

import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.sessions.watching import Watching
from nico_selfmodel.systems.looking import looking_arm
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

from ..true_nico import true_model

ARM = looking_arm("fiducial")


def test_a_body_that_learned_with_its_head_turned_elsewhere_is_refused():
    held = {**ARM.held, "neck_yaw": ARM.held["neck_yaw"] + 0.1}
    model = replace(true_model(ARM, "clean", 3), robot={**ARM.source, "held": held})
    with pytest.raises(ModelError, match=r"learned with neck_yaw at .* deg, and this Nico"):
        Watching(model, IMPERFECTIONS["clean"], 3)

"""Poses of a whole body that would tell most are chosen in view, and tell more than others."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_result import body_model
from nico_selfmodel.model.self_model import ParameterCovariance
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import WORLD
from nico_selfmodel.planning.next_body_poses import choose_next_body_poses
from nico_selfmodel.sessions.whole_body import whole_body_session
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

from .simulated_trees import one_arm


@pytest.fixture(scope="module")
def learned():
    train = whole_body_session(IMPERFECTIONS["thesis"], 1, 0, looks=40, hands=40)
    return body_model(calibrate_tree(train, effects=())), train


@pytest.mark.slow
def test_chosen_poses_lie_between_recorded_ones_and_lessen_the_error(learned):
    model, train = learned
    marker = "left_hand_fiducial"
    few, more = (
        choose_next_body_poses(model, train, n, np.random.default_rng(0), marker=marker)
        for n in (3, 12)
    )
    assert more.readings.shape == (12, 18)
    low, high = train.readings.min(axis=0), train.readings.max(axis=0)
    assert ((more.readings >= low) & (more.readings <= high)).all()
    assert few.sigma_before == more.sigma_before < 10.0
    assert more.sigma_after < few.sigma_after < few.sigma_before


def test_poses_of_a_body_before_a_tracker_are_chosen_by_places():
    data = one_arm(1, joints=3, markers=2, poses=25).data
    model = body_model(calibrate_tree(data, effects=()))
    few, more = (choose_next_body_poses(model, data, n, np.random.default_rng(0)) for n in (3, 12))
    assert few.unit == "m"
    assert more.sigma_after < few.sigma_after < few.sigma_before == more.sigma_before < 2e-3


def test_a_body_that_carries_no_marker_is_told_what_to_do():
    made = one_arm(1, joints=3, markers=2, poses=25)
    covariance = ParameterCovariance(("joint0.gear",), np.eye(1))
    room = tuple(replace(marker, on=WORLD) for marker in made.tree.markers)
    model = BodyModel("arm", replace(made.tree, markers=room), np.ones(3), covariance)
    names = ", ".join(marker.name for marker in room)
    with pytest.raises(
        ModelError, match=f"on the body: it carries none, and knows {names} in the room.*fix one to"
    ):
        choose_next_body_poses(model, made.data, 3, np.random.default_rng(0))


@pytest.mark.slow
def test_what_cannot_be_chosen_is_said(learned):
    model, train = learned
    rng = np.random.default_rng(0)
    with pytest.raises(ModelError, match=r"it carries right_hand_fiducial.*choose one"):
        choose_next_body_poses(model, train, 3, rng, marker="card0_0")
    with pytest.raises(ModelError, match="has no covariance"):
        choose_next_body_poses(replace(model, covariance=None), train, 3, rng)
    table = train.observations
    hidden = [m.on == "world" for m in train.markers]
    room = replace(train, observations=table.select(np.array(hidden)[table.marker]))
    with pytest.raises(DataError, match="has no view of"):
        choose_next_body_poses(model, room, 3, rng)

"""A whole Nico learns itself: lenses and head from a room, arms where the head looks, then all.

The head that was learned from the room follows each hand.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.joining import joined
from nico_selfmodel.dataset.body.some_joints import of_joints
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.cameras.camera_adjustment import CameraCalibration
from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
from nico_selfmodel.estimation.tree.tree_calibration import TreeCalibration, calibrate_tree
from nico_selfmodel.estimation.tree.tree_result import body_model
from nico_selfmodel.estimation.tree.tree_setup import Wishes
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.sessions.body_truth import mechanics_left
from nico_selfmodel.sessions.progress import Stage, telling
from nico_selfmodel.sessions.rendered_body import QUICK, RenderedBody
from nico_selfmodel.sessions.room_lenses import lenses_of, look_about
from nico_selfmodel.sessions.whole_recording import WholeRecording, with_lenses
from nico_selfmodel.systems.looking import HEAD_JOINTS
from nico_selfmodel.systems.simulated.imperfections import Imperfections
from nico_selfmodel.systems.tracking.shared_search import corner_names

_INTRINSICS = ("fx", "fy", "cx", "cy", "k1", "k2", "k3")
"""Of each lens, free when everything is learned together."""
_LOOKS, _TEST_LOOKS = 40, 8
"""Poses in which the head looks about the room, and of those held out."""
_HANDS, _TEST_HANDS = 90, 25
"""Poses of each hand before the cameras: of fewer, joint noise hides what sags; and held out."""


@dataclass(frozen=True, eq=False)
class WholeScenario:
    """What was recorded and learned."""

    lenses: Mapping[str, CameraCalibration]
    """Each camera alone, from the cards in the room, before anything else was known."""
    looks: BodyDataset
    """The room, while the head turned."""
    train: BodyDataset
    """That, then the hands."""
    test: BodyDataset
    """Another day's, for judging only."""
    found: TreeCalibration
    """Everything together."""
    mechanics: Mapping[str, float]
    """Mean error in the test's images that no learning takes away, by the joint of what carries the
    markers [px]: of a body that knew itself exactly."""


def learn_whole(
    world: Imperfections | str,
    seed: int = 0,
    *,
    arms: Sequence[str] = ("right", "left"),
    stage: Stage | None = None,
) -> WholeScenario:
    """Let a whole Nico look about a room and at its hands, and learn itself from the pictures.

    Args:
        seed: Which robot.
        arms: Which arms move: `right`, `left`, none of them for the head alone.

    Raises:
        ModelError: If the head sees nothing of a hand.
        DataError: If too little was seen.
        EstimationError: If no body explains it.
    """
    whole = WholeRecording(tuple(arms))
    robot = RenderedBody(world, seed, whole, QUICK)
    # What cannot be seen is said before anything is recorded.
    whole.plan(1, 1, np.random.default_rng(seed))
    looks, alone = look_about(robot, _LOOKS, telling(stage, "looking about the room"))
    lenses = lenses_of(alone)
    train = with_lenses(looks, lenses)
    head = _learned_head(train) if arms else None
    if arms:
        seen = robot.record(
            "hands",
            1,
            0,
            _HANDS,
            lenses=lenses,
            learned=head,
            progress=telling(stage, "looking at its hands"),
        )
        _require_hands(seen, whole)
        train = joined(train, seen, f"whole_nico_{seed}")
    test = robot.record(
        "test",
        2,
        _TEST_LOOKS,
        _TEST_HANDS if arms else 0,
        lenses=lenses,
        learned=head,
        progress=telling(stage, "more poses, kept for judging"),
    )
    telling(stage, "learning head and arms together")(0, 1)
    found = calibrate_tree(train, test=test, wishes=_free_lenses(lenses))
    telling(stage, "learning head and arms together")(1, 1)
    left = mechanics_left(robot.ground_truth, test)
    return WholeScenario(alone, looks, train, test, found, left)


def _learned_head(looks: BodyDataset) -> BodyModel:
    """Learn the head from a room alone, so that it can follow a hand: as if nothing bent."""
    return body_model(calibrate_tree(of_joints(looks, HEAD_JOINTS), effects=()))


def _require_hands(seen: BodyDataset, whole: WholeRecording) -> None:
    """Refuse a recording in which a hand was never seen, before more is recorded.

    Raises:
        DataError: If there is such a hand.
    """
    names = [marker.name for marker in seen.markers]
    found = {names[i] for i in np.unique(seen.observations.marker).tolist()}
    for side, marker in whole.hands.items():
        if not found & set(corner_names(marker)):
            raise DataError(
                f"no picture shows {marker}, though the poses were planned to show it: something "
                f"on the {side} hand may hide it, learn without that arm (--arms)"
            )


def _free_lenses(lenses: Mapping[str, Camera]) -> Wishes:
    freed = frozenset(f"{name}.{part}" for name in lenses for part in _INTRINSICS)
    return Wishes(FixedParameters(freed=freed))

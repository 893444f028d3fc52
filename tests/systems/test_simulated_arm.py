"""A simulated arm gives a learner what a real one would, and no more."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS, imperfections_named
from nico_selfmodel.systems.simulated.mechanics import Mechanics
from nico_selfmodel.systems.simulated.robot import SimulatedRobot

ARM = ArmDescription.named("nico")


def body(world="thesis", seed=0, session=0, **changes):
    flaws = replace(IMPERFECTIONS[world], **changes)
    return SimulatedRobot.under_motion_capture(ARM, flaws, seed, session)


def middle(arm):
    return np.array([0.5 * (joint.lower + joint.upper) for joint in arm.joints])


def test_one_seed_and_session_is_one_history():
    first, second = body(seed=3, session=4), body(seed=3, session=4)
    for _ in range(5):
        a, b = first.move_and_measure(middle(first)), second.move_and_measure(middle(second))
        assert np.array_equal(a.points["hand"], b.points["hand"])


def test_another_session_is_the_same_body_on_another_day():
    quiet = {"play": 0.0, "sag": 0.0, "wobble": 0.0, "marker_sigma": 0.0, "dropout_share": 0.0}
    a, b = body(seed=3, session=0, **quiet), body(seed=3, session=1, **quiet)
    assert a.move_and_measure(middle(a)).points["hand"] == pytest.approx(
        b.move_and_measure(middle(b)).points["hand"]
    )
    noisy = body(seed=3, session=0), body(seed=3, session=1)
    seen = [arm.move_and_measure(middle(arm)).points["hand"] for arm in noisy]
    assert not np.array_equal(*seen)


def test_backlash_leaves_a_joint_behind_by_its_half_width_on_the_side_from_which_it_came():
    half = np.radians(0.5)
    flaws = replace(IMPERFECTIONS["clean"], backlash=half)
    drives = Mechanics.build(ARM, flaws, 0, np.random.default_rng(0))
    start = 0.5 * (drives.lower + drives.upper)
    q = drives.dragged(start)
    assert q == pytest.approx(drives.servos.to_joint(start))
    for step in (0.1, -0.1):
        asked = drives.servos.to_joint(start) + step
        q = drives.dragged(drives.servos.to_encoder(asked), q)
        assert q == pytest.approx(asked - half * np.sign(step))


def test_commands_stop_at_the_stops():
    arm = body()
    far = arm.move_and_measure(np.full(4, 1e9)).encoders
    assert np.array_equal(far, [joint.upper for joint in arm.joints])


@pytest.mark.parametrize("command", [[0.0, 0.0], [np.nan] * 4, [np.inf] * 4])
def test_a_command_that_is_none_is_refused(command):
    with pytest.raises(ValueError, match="4 finite counts"):
        body().move_and_measure(command)


def test_a_lost_marker_is_nowhere():
    arm = body(dropout_share=1.0)
    assert arm.move_and_measure(middle(arm)).points["hand"] is None


def test_nothing_public_holds_the_truth():
    arm = body("clean", seed=1)
    public = {name for name in dir(arm) if not name.startswith("_")}
    doors = {"faults", "ground_truth"}
    builders = {"under_motion_capture", "with_cameras"}
    assert (
        public == {"joints", "markers", "relive", "move_and_measure", "sensor"} | doors | builders
    )
    assert {name for name in vars(arm) if "__" not in name} == {"sensor", "_rng"}


def test_play_moves_the_hand_and_not_the_encoders():
    arm = body("clean", play=np.radians(1.0))
    observations = [arm.move_and_measure(middle(arm)) for _ in range(20)]
    assert len({tuple(s.encoders) for s in observations}) == 1
    spread = np.std([s.points["hand"] for s in observations], axis=0)
    assert 1e-4 < np.linalg.norm(spread) < 1e-2


def test_sag_is_the_same_every_time():
    still, sagging = body("clean"), body("clean", sag=np.radians(2.0))
    a, b = (arm.move_and_measure(middle(arm)).points["hand"] for arm in (still, sagging))
    assert np.linalg.norm(a - b) > 1e-4
    assert np.array_equal(b, sagging.move_and_measure(middle(sagging)).points["hand"])


def test_an_arm_without_stops_cannot_be_simulated():
    with pytest.raises(ValueError, match="finite"):
        SimulatedRobot.under_motion_capture(
            replace(ARM, upper=np.full(4, np.inf)), IMPERFECTIONS["clean"], 0
        )


def test_a_world_that_does_not_exist_is_explained():
    with pytest.raises(ValueError, match="clean, thesis"):
        imperfections_named("moon")

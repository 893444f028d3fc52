"""A Nico on a torso that turns: which robot it is, and what its pictures tell of its body."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.geometry.transform import inverse
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.plant.body_description import built_frame_name
from nico_selfmodel.sessions.rendered_nico import FIDUCIAL, RenderedNico
from nico_selfmodel.sessions.turning import NECK, TORSO, look_while_turning
from nico_selfmodel.systems.looking import (
    ALL_JOINTS,
    TORSO_JOINTS,
    looking_body,
    touching_arm,
    turning_body,
)
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.simulated.trunk import limbs_of, trunk_of
from nico_selfmodel.systems.stations.whole_nico import WholeNico


def built(body, seed=7):
    return WholeNico.build(body, IMPERFECTIONS["thesis"], seed, NICO_CAMERAS)


def test_with_the_torso_at_zero_it_is_the_robot_that_has_none():
    without, turns = built(looking_body()), built(turning_body())
    one, other = without.mechanics, turns.mechanics
    q = np.random.default_rng(1).uniform(-0.3, 0.3, len(ALL_JOINTS))
    motions = (
        TreeMotion.at(one.tree, q[None]),
        TreeMotion.at(other.tree, np.append(np.zeros(len(TORSO_JOINTS)), q)[None]),
    )
    for kind in ("markers", "sensors"):
        for a, b in zip(getattr(one.tree, kind), getattr(other.tree, kind), strict=True):
            there = [m.poses(item) for m, item in zip(motions, (a, b), strict=True)]
            assert there[0] == pytest.approx(there[1], abs=1e-12)
    own = [without.body.joints.index(name) for name in turns.body.joints[len(TORSO_JOINTS) :]]
    first = len(TORSO_JOINTS)
    assert np.array_equal(one.servos.offset[own], other.servos.offset[first:])
    assert np.array_equal(one.servos.gear[own], other.servos.gear[first:])
    held = [turns.body.held.get(name, 0.0) for name in ALL_JOINTS]
    assert one.rest + held == pytest.approx(other.rest[first:], abs=1e-12)
    assert np.array_equal(one.lower[own], other.lower[first:])
    assert one.largest_torque == other.largest_torque


def test_torsos_differ_from_robot_to_robot_and_from_their_description():
    frames = [built(turning_body(), seed).mechanics.tree.X_PJ[0] for seed in (7, 8)]
    described = turning_body().tree.X_PJ[0]
    off = [np.linalg.norm(inverse(described) @ X - np.eye(4)) for X in frames]
    assert min(off) > 1e-4
    assert np.linalg.norm(frames[0] - frames[1]) > 1e-4


def test_the_torso_that_is_drawn_is_the_one_that_is_measured():
    nico = built(turning_body())
    drawn = nico.body.built(nico.mechanics.tree)
    context = drawn.plant.CreateDefaultContext()
    q = np.random.default_rng(2).uniform(-0.3, 0.3, len(nico.body.joints))
    drawn.move_joints(context, nico.body.joints, q)
    frames = [
        drawn.plant.GetFrameByName(built_frame_name(m), drawn.instance) for m in nico.body.markers
    ]
    places = np.array([frame.CalcPoseInWorld(context).translation() for frame in frames])
    rest = replace(
        nico.mechanics, rest=np.where(np.isin(np.arange(20), nico.mechanics.columns), 0, 0.0)
    )
    assert rest.points(q) == pytest.approx(places, abs=1e-12)


def test_a_body_whose_limbs_branch_at_its_root_has_no_trunk():
    assert trunk_of(looking_body().tree) == 0
    assert trunk_of(turning_body().tree) == len(TORSO_JOINTS)
    assert limbs_of(turning_body(), 2).tree.joints == looking_body().tree.joints
    assert pytest.approx(looking_body().tree.X_PJ) == limbs_of(turning_body(), 2).tree.X_PJ


@pytest.mark.slow
def test_what_stands_still_while_the_torso_turns_is_the_arm_and_nothing_while_the_neck_does():
    nico = RenderedNico(IMPERFECTIONS["thesis"], 21, (FIDUCIAL,), None, touching_arm(FIDUCIAL))
    q = nico.workspace.random_poses(1, np.random.default_rng(21))[0]
    looks = look_while_turning(nico.world, 21, dict(zip(nico.arm.joints, q, strict=True)))
    assert [(one.turned, one.side) for one in looks] == [
        (TORSO, "left"), (TORSO, "right"), (NECK, "left"), (NECK, "right"),
    ]  # fmt: skip
    for one in looks:
        right = (one.told.body & one.body_true).sum() + (one.told.room & one.room_true).sum()
        wrong = (one.told.body & one.room_true).sum() + (one.told.room & one.body_true).sum()
        assert wrong <= 0.02 * right
        assert right > 40
        assert one.body_true.any() == (one.turned == TORSO)
    torso = looks[0]
    assert (torso.told.body & torso.body_true).sum() >= 0.5 * torso.body_true.sum()

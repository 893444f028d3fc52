"""A hand looked at by a head that stands still, and by one that turned elsewhere since."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.planning.body_poses import BodyView
from nico_selfmodel.planning.visible_workspace import RENDERED
from nico_selfmodel.sessions.whole_body import whole_body_session, whole_nico
from nico_selfmodel.systems.looking import ARM_JOINTS, HEAD_JOINTS, looking_body
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

LIMITS = replace(RENDERED, touching=True)
HAND = "right_hand_fiducial"
ARM = ARM_JOINTS["right"]


def poses_seen(moving, held, count, rng):
    """Angles of some joints at which both cameras see the hand, the others held. (count, k)."""
    body = looking_body(*moving)
    body = replace(body, held={**body.held, **held})
    return BodyView(body, (), LIMITS).poses([HAND], 1, count, rng)


def looked_at(heads, count, rng):
    """Angles of all joints: hands before heads that stand still, then before heads that turned."""
    still, turned = [], []
    for head in poses_seen((*HEAD_JOINTS, *ARM), {}, heads, rng)[:, : len(HEAD_JOINTS)]:
        for arm in poses_seen(ARM, dict(zip(HEAD_JOINTS, head, strict=True)), count, rng):
            elsewhere = poses_seen(HEAD_JOINTS, dict(zip(ARM, arm, strict=True)), 1, rng)[0]
            for kept, angles in ((still, head), (turned, elsewhere)):
                kept.append(np.concatenate([angles, arm, np.zeros(len(ARM))]))
    return np.array(still), np.array(turned)


def pixels(tree, motion):
    """Where both cameras see the hand. Shape (N, 4)."""
    p_WM = motion.pose_of(tree.markers[tree.marker_index(HAND)])[1].T
    out = []
    for sensor in tree.sensors:
        R, p = motion.pose_of(sensor)
        X_CW = inverse(transform(R.transpose(2, 0, 1), p.T))
        p_CM = apply(X_CW, p_WM)
        out.append(tree.lenses[sensor.name].at(np.eye(4)).project(p_CM))
    return np.hstack(out)


def mean_error(found, nico, angles, rng):
    """Mean distance of the hand in the images from where the body expects it [px]."""
    mechanics = nico.mechanics
    encoders = np.round(np.array([mechanics.servos.to_encoder(q) for q in angles]))
    there = [mechanics.angles(mechanics.servos.to_joint(row), rng) for row in encoders]
    seen = pixels(mechanics.tree, TreeMotion.at(mechanics.tree, np.array(there)))
    factor = np.array([joint.si_per_unit for joint in found.data.joints])
    off = pixels(found.tree, TreeMotion.at(found.tree, encoders * factor)) - seen
    return np.nanmean(np.linalg.norm(off.reshape(-1, 2, 2), axis=2))


@pytest.mark.slow
def test_a_head_that_turned_elsewhere_expects_the_hand_as_well_as_one_that_stands_still():
    world, seed = IMPERFECTIONS["thesis"], 3
    train = whole_body_session(world, seed, 0, looks=50, hands=60)
    found = calibrate_tree(train, effects=None)
    nico, _ = whole_nico(world, seed)
    rng = np.random.default_rng(7)
    still, turned = looked_at(12, 15, rng)
    assert mean_error(found, nico, turned, rng) <= 1.2 * mean_error(found, nico, still, rng)

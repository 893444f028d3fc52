"""Postures in which a robot looks at itself in a mirror leave most of its body to be judged."""

from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import EstimationError
from nico_selfmodel.planning.visible_workspace import VisibleWorkspace
from nico_selfmodel.sessions.looks.look_poses import look_poses
from nico_selfmodel.systems.looking import touching_arm


@pytest.fixture(scope="module")
def workspace():
    return VisibleWorkspace.of(touching_arm("fiducial"))


class Looks:
    """Before a mirror that shows less of the body, the farther the elbow is bent."""

    def __init__(self, workspace, left=1.0, right=1.0, clearance=lambda q: 1.0):
        arm = workspace.arm
        stops = np.degrees([arm.lower, arm.upper]).T
        joints = [JointInfo(j, "deg", None, *at) for j, at in zip(arm.joints, stops, strict=True)]
        self.body = SimpleNamespace(joints=joints)
        self._sides, self._elbow = (left, right), arm.joints.index("right_elbow")
        self.clearance = clearance

    def share(self, readings):
        """Return what one posture leaves, of all that there is."""
        return 1.0 - abs(readings[self._elbow]) / 180.0

    def judged_at(self, readings):
        count = 1000.0 * self.share(readings)
        return tuple(np.arange(1000) < side * count for side in self._sides)


@pytest.mark.slow
def test_postures_leave_nine_tenths_of_what_the_best_leaves_and_the_best_comes_first(workspace):
    looks = Looks(workspace)
    found = look_poses(looks, workspace, np.random.default_rng(0))
    shares = np.array([looks.share(one) for one in found])
    assert 1 < len(found) < 16
    assert (np.diff(shares) <= 1e-3).all()
    assert (shares >= 0.899 * shares[0]).all()


def test_the_camera_that_judges_less_counts(workspace):
    looks = Looks(workspace, left=1.0, right=0.0)
    with pytest.raises(EstimationError, match="none leaves anything of the body to be judged"):
        look_poses(looks, workspace, np.random.default_rng(0))


def test_no_posture_touches_the_body_or_comes_near_the_glass(workspace):
    def clearance(readings):
        return 0.1 if readings[0] > -60.0 else 0.04

    looks = Looks(workspace, clearance=clearance)
    found = look_poses(looks, workspace, np.random.default_rng(0))
    assert (found[:, 0] > -60.0).all()
    assert not any(workspace.body.collides(np.radians(one)) for one in found)
    near = Looks(workspace, clearance=lambda _: 0.04)
    with pytest.raises(EstimationError, match="of 0 postures"):
        look_poses(near, workspace, np.random.default_rng(0))

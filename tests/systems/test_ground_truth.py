"""What instruments beside a robot know of mirrors, and the robot does not."""

import numpy as np
import pytest

from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.planning.visible_workspace import VisibleWorkspace
from nico_selfmodel.systems.looking import looking_arm
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.stations.nico_instance import NicoInstance

ARM = looking_arm("fiducial")
X_BM = np.array(
    [[-0.17, -0.42, 0.89, 0.31], [-0.98, 0.07, -0.16, -0.20], [0.0, -0.91, -0.42, 0.07],
     [0.0, 0.0, 0.0, 1.0]]
)  # fmt: skip


def glass():
    """Return a glass about half a metre before the chest, its axes made orthonormal."""
    X = X_BM.copy()
    u, _, vt = np.linalg.svd(X[:3, :3])
    X[:3, :3] = u @ vt
    return X


def test_ground_truth_says_where_a_glass_stands_before_the_true_camera():
    X = glass()
    body = NicoInstance.build(ARM, IMPERFECTIONS["thesis"], 1, NICO_CAMERAS)
    mirror = body.ground_truth.mirror(X)
    # Points of the glass, and one in front of it, as the motion tracker has them.
    points = apply(X, np.array([[0.0, 0.0, 0.0], [0.2, 0.1, 0.0], [-0.1, 0.2, 0.0], [0, 0, -0.1]]))
    p_LQ = body.ground_truth.locate(apply(body.X_TB, points))
    assert mirror.in_front_by(p_LQ) == pytest.approx([0.0, 0.0, 0.0, 0.1], abs=1e-9)


def test_a_true_head_is_not_where_the_description_has_it():
    X = glass()
    designed = VisibleWorkspace.of(ARM).rig.left.X_WC
    X_LM = inverse(designed) @ X
    true = NicoInstance.build(ARM, IMPERFECTIONS["thesis"], 1, NICO_CAMERAS).ground_truth.mirror(X)
    turned = np.degrees(np.arccos(np.clip(-X_LM[:3, 2] @ true.normal, -1.0, 1.0)))
    assert 0.2 < turned < 15.0

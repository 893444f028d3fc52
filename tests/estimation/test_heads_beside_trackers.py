"""A camera on a pan-tilt head beside a tracker that never sees the head, and no description."""

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.dataset.body.sensors import SensorInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.tree.tree_motion import TreeMotion

from ..slow_rest import slow_rest
from .simulated_trees import LENS, Simulated, assembled, looking_at, observed, serial, tags, turned

ARM = ("j1", "j2", "j3", "j4")


def head_and_hand(seed, of_eye, poses=70):
    """A neck of two joints and an arm; a tracker sees a ball, an eye some markers."""
    rng = np.random.default_rng(seed)
    arm, frames = serial(rng, ARM, "world", 0.5)
    tilted = turned(rng, 3, 0) @ transform(rotation_from_vector([np.pi / 2, 0, 0]), [0.03, 0, 0.06])
    neck = [LinkJoint("pan", parent="world"), LinkJoint("tilt", parent="pan")]
    joints, frames = [*neck, *arm], [transform(np.eye(3), [-0.2, 0.3, 0.8]), tilted, *frames]
    markers, attached = tags(rng, "hand", ARM[-1], 4)
    still = TreeMotion.at(assembled(joints, frames, [], [], [], [], {}), np.zeros((1, 6)))
    tilt, hand = still.tree.joints.index("tilt"), still.tree.joints.index(ARM[-1])
    X_WT = transform(still.R_WL[tilt, :, :, 0], still.p_WL[tilt, :, 0])
    X_WC = looking_at(X_WT[:3, 3] + [0.05, 0.02, 0.1], still.p_WL[hand, :, 0])
    lens = dict(LENS.named_values)
    sensors = [
        SensorInfo("tracker", "points"),
        SensorInfo("eye", "camera", on="tilt", image_size=LENS.image_size, lens=lens),
    ]
    places = [np.eye(4), inverse(X_WT) @ X_WC]
    tree = assembled(joints, frames, markers, attached, sensors, places, {"eye": LENS})
    q = rng.uniform(-0.4, 0.4, size=(poses, 6)) * np.where(np.arange(6) < 2, 0.6, 2.0)
    sigma = {"points": 1e-4, "camera": 0.3}
    data = observed(
        tree, joints, markers, sensors, q, rng, joint_sigma=np.radians(0.05), sigma=sigma
    )
    table = data.observations
    own = np.where(table.sensor == 0, table.marker == 0, np.isin(table.marker, of_eye))
    return Simulated(tree, with_rows(data, own), q)


def with_rows(data, own):
    """The same recording with some of its observations."""
    parts = {key: getattr(data, key) for key in data.__dataclass_fields__}
    return BodyDataset(**parts | {"observations": data.observations.select(own)})


@pytest.mark.parametrize(
    ("seed", "of_eye"),
    slow_rest([(1, (1, 2, 3)), (2, (0, 1, 2, 3)), (3, (0,)), (4, (1, 2, 3))], plain=1),
)
def test_a_head_is_told_by_what_its_camera_sees_of_the_tracked_hand(seed, of_eye):
    """Of markers that the tracker sees, too, and of others of which it sees none."""
    true = head_and_hand(seed, of_eye)
    first = np.arange(70) < 50
    found = calibrate_tree(true.data.select(first), test=true.data.select(~first), effects=())
    verdict = judge(found)
    assert verdict.status == "PASS", verdict.reasons
    q = np.random.default_rng(9).uniform(-0.2, 0.2, size=(20, 6))
    for m in of_eye:
        there, seen = (in_eye(tree, q, m) for tree in (true.tree, found.tree))
        assert np.linalg.norm(there - seen, axis=1).max() < 3e-3


def in_eye(tree, q, marker):
    """Where a marker is in the eye's frame. Shape (N, 3)."""
    motion = TreeMotion.at(tree, q)
    eye = next(sensor for sensor in tree.sensors if sensor.name == "eye")
    (R, p), p_WM = motion.pose_of(eye), motion.pose_of(tree.markers[marker])[1]
    return np.einsum("jin,jn->ni", R, p_WM - p)


def test_a_head_whose_camera_saw_too_little_is_refused_by_its_joints_names():
    data = head_and_hand(1, (1, 2, 3)).data
    table = data.observations
    few = (table.sensor == 0) | (table.pose < 3)
    with pytest.raises(DataError, match="eye, carried by pan, tilt, saw 9 markers that"):
        calibrate_tree(with_rows(data, few))

"""One camera in a hand that looks at a room of which some places are known."""

import numpy as np
import pytest

from nico_selfmodel.dataset.body.sensors import MarkerInfo, SensorInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.tree.body_tree import Attached
from nico_selfmodel.model.tree.tree_motion import TreeMotion

from .simulated_trees import LENS, assembled, looking_at, observed, serial

NAMES = ("j1", "j2", "j3")


def looked_around(known, poses=70):
    """A camera on an arm of three joints before twenty markers, of which the first are known."""
    rng = np.random.default_rng(8)
    joints, frames = serial(rng, NAMES, "world", 0.5)
    places = np.array([1.2, 0.0, 0.2]) + rng.uniform(-0.6, 0.6, size=(20, 3))
    markers = [
        MarkerInfo(f"room{k}", "world", tuple(p) if k < known else None)
        for k, p in enumerate(places.tolist())
    ]
    attached = [
        Attached(m.name, -1, transform(np.eye(3), p)) for m, p in zip(markers, places, strict=True)
    ]
    lens = dict(LENS.named_values)
    camera = SensorInfo("eye", "camera", on="j3", image_size=LENS.image_size, lens=lens)
    still = assembled(joints, frames, [], [], [], [], {})
    motion = TreeMotion.at(still, np.zeros((1, 3)))
    X_WL = transform(motion.R_WL[2, :, :, 0], motion.p_WL[2, :, 0])
    X_LC = inverse(X_WL) @ looking_at(X_WL[:3, 3], [1.2, 0.0, 0.2])
    tree = assembled(joints, frames, markers, attached, [camera], [X_LC], {"eye": LENS})
    q = rng.uniform(-0.35, 0.35, size=(poses, 3))
    how = {"joint_sigma": np.radians(0.05), "sigma": {"camera": 0.3}}
    return places, observed(tree, joints, markers, [camera], q, rng, **how)


@pytest.mark.slow
def test_markers_of_unknown_place_are_found_by_a_camera_that_moves():
    places, data = looked_around(known=14)
    first = np.arange(70) < 50
    found = calibrate_tree(data.select(first), test=data.select(~first), effects=())
    verdict = judge(found)
    assert verdict.status == "PASS", verdict.reasons
    sigma = dict(zip(found.uncertainty.names, found.uncertainty.sigma, strict=True))
    for k in range(14, 20):
        off = found.tree.markers[k].X_LA[:3, 3] - places[k]
        assert np.abs(off / [sigma[f"room{k}.{axis}"] for axis in "xyz"]).max() < 4.0
        assert np.abs(off).max() < 0.05


def test_cameras_that_all_move_in_an_unknown_room_are_told_so():
    _, data = looked_around(known=0)
    with pytest.raises(DataError, match="no camera stands in the world, of eye, and nothing"):
        calibrate_tree(data)

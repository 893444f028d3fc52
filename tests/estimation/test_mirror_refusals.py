"""Data and bodies that no mirror can be learned from."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import DataError, ModelError, NotConvergedError, NotIdentifiableError
from nico_selfmodel.estimation.mirrors.mirror import calibrate_mirrors
from nico_selfmodel.model.self_model import SelfModel

from .mirror_scenes import CHAIN, RIG, body, poses, recording


def test_cameras_that_were_exchanged_are_suspected():
    data = recording(poses(12))
    swapped = replace(data, pixels=data.pixels[:, [2, 3, 0, 1]])
    with pytest.raises(NotConvergedError, match="left and right exchanged"):
        calibrate_mirrors(swapped, body())


def test_data_of_another_body_are_refused():
    data = recording(poses(3))
    renamed = replace(data.joints[0], name="other")
    with pytest.raises(DataError, match="joints"):
        calibrate_mirrors(replace(data, joints=(renamed, *data.joints[1:])), body())
    with pytest.raises(DataError, match=r"480 pixels, the images of data set .* have 1280 x 960"):
        calibrate_mirrors(replace(data, image_size=(1280, 960)), body())
    with pytest.raises(DataError, match="does not know; it knows hand"):
        calibrate_mirrors(replace(data, marker=np.full(3, "tool")), body())
    with pytest.raises(ValueError, match="no loss"):
        calibrate_mirrors(data, body(), loss="median")
    with pytest.raises(ValueError, match="joint_sigma"):
        calibrate_mirrors(data, body(), joint_sigma=-0.1)


def test_one_sighting_by_one_camera_is_not_enough():
    data = recording(poses(1))
    pixels = data.pixels.copy()
    pixels[:, 2:] = np.nan
    with pytest.raises(NotIdentifiableError, match="1 reflection seen by one camera alone"):
        calibrate_mirrors(replace(data, pixels=pixels), body())


def test_a_hand_on_the_glass_tells_nothing_of_it():
    q = poses(300, 1)
    on_glass = replace(recording(q), pixels=RIG.project(CHAIN.forward(q)))
    with pytest.raises(DataError, match="on the glass"):
        calibrate_mirrors(on_glass.select(np.isfinite(on_glass.pixels).all(axis=1)), body())


def test_a_body_without_cameras_or_without_an_arm_cannot_look_into_a_mirror():
    data = recording(poses(3))
    with pytest.raises(ModelError, match="no cameras"):
        calibrate_mirrors(data, body(cameras={}))
    with pytest.raises(ModelError, match="no pair of cameras"):
        calibrate_mirrors(data, body(cameras={"left": RIG.left}))
    cameras = SelfModel("cameras", cameras={"left": RIG.left, "right": RIG.right})
    with pytest.raises(ModelError, match="no arm"):
        calibrate_mirrors(data, cameras)

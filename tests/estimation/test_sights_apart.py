"""Pixels that the cameras which are said to have seen them cannot have seen."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.body.sights_apart import SightsApart
from nico_selfmodel.estimation.body.stereo_points import StereoPoints
from nico_selfmodel.estimation.results.calibration_result import CAUSE, FAILURE, WARNING
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model import SelfModel

COUNT = 80
SIZE = (640, 480)
EXCHANGED = [2, 3, 0, 1]


def rig():
    left = Camera(600.0, 600.0, 320.0, 240.0, SIZE)
    return StereoRig(left, left.at(transform(np.eye(3), [0.06, 0.0, 0.0])))


def seen(noise=0.5):
    """Return pixels of points before two cameras."""
    rng = np.random.default_rng(1)
    p = rng.uniform([-0.15, -0.12, 0.4], [0.15, 0.12, 0.6], (COUNT, 3))
    pixels = rig().project(p) + noise * rng.standard_normal((COUNT, 4))
    joints = (JointInfo("turn", "rad"),)
    readings = rng.uniform(-1.0, 1.0, (COUNT, 1))
    return Dataset("seen", joints, np.arange(COUNT), readings, pixels=pixels, image_size=SIZE)


def with_pixels(change, rows=slice(None), data=None):
    """Return what was seen with some rows' pixels changed."""
    data = data or seen()
    pixels = data.pixels.copy()
    pixels[rows] = change(pixels[rows])
    return replace(data, pixels=pixels)


def severities(data):
    return [finding.severity for finding in SightsApart.of(data, rig()).findings()]


def test_nothing_is_said_of_sights_that_meet():
    data = seen()
    sights = SightsApart.of(data, rig())
    assert sights.findings() == []
    assert len(sights.without(data)) == COUNT


def test_noise_of_detections_is_none_that_is_told():
    # Chance of 1 in 600 that one of them is apart by more than 5 px.
    assert severities(seen(noise=1.2)) == []


def test_sights_more_than_five_pixels_from_one_point_are_apart():
    """A right camera's v that is off by d leaves d / sqrt(2) of the four pixels together."""

    def apart(by):
        off = with_pixels(lambda px: px + np.array([0.0, 0.0, 0.0, by]), data=seen(noise=0.0))
        return SightsApart.of(off, rig()).apart

    assert not apart(4.7 * np.sqrt(2.0)).any()
    assert apart(5.3 * np.sqrt(2.0)).all()


def test_exchanged_sides_are_called_so():
    data = with_pixels(lambda pixels: pixels[:, EXCHANGED])
    model = SelfModel("eyes", cameras=dict(zip(("left", "right"), rig().cameras, strict=True)))
    with pytest.raises(DataError, match="left and right are exchanged in the pixels 80 of 80"):
        StereoPoints.of(model, data)


@pytest.mark.parametrize(
    "change",
    [
        lambda pixels: pixels[:, [1, 0, 3, 2]],
        lambda pixels: pixels + np.array([0.0, 0.0, 0.0, 12.0]),
        lambda pixels: np.zeros_like(pixels),
    ],
    ids=["u and v", "a turned camera", "zeros where nothing was seen"],
)
def test_pixels_of_other_cameras_are_refused_with_a_hint(change):
    data = with_pixels(change)
    with pytest.raises(DataError, match=r"miss each other, or meet behind them, .*seen by these"):
        SightsApart.of(data, rig()).without(data)


def test_more_than_a_quarter_apart_fail_and_fewer_are_left_out_with_a_warning():
    few, many = slice(None, None, 8), slice(None, None, 3)
    zeros = with_pixels(np.zeros_like, few)
    assert severities(zeros) == [WARNING]
    assert len(SightsApart.of(zeros, rig()).without(zeros)) == COUNT - COUNT // 8
    assert severities(with_pixels(np.zeros_like, many)) == [CAUSE]


def test_a_camera_that_is_knocked_in_the_middle_is_told_with_its_sample():
    def knocked(px, noise=0.5):
        return with_pixels(
            lambda p: p + np.array([0.0, 0.0, 2.0, px]), slice(50, None), seen(noise)
        )

    (finding,) = SightsApart.of(knocked(4.0), rig()).findings()
    assert finding.severity == FAILURE
    assert "moved against each other after sample 49" in finding.text
    # Less than a pixel, or less than what the points scatter by anyway, says nothing.
    assert severities(knocked(1.2, noise=0.1)) == []
    assert severities(knocked(2.0, noise=1.2)) == []


def test_what_one_camera_saw_alone_tells_nothing():
    data = with_pixels(lambda pixels: pixels + np.array([np.nan, np.nan, 0.0, 99.0]))
    assert severities(data) == []
    assert len(SightsApart.of(data, rig()).without(data)) == COUNT

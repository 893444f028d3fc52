"""Arm and cameras learned together where lenses are fisheyes or rational: as well as any."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.arm.evaluation import evaluate
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.body.body import calibrate_body
from nico_selfmodel.estimation.body.body_options import BodyOptions
from nico_selfmodel.estimation.body.stereo_points import StereoPoints
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.observations.hand_rows import HandPixels
from nico_selfmodel.estimation.observations.pixel_observations import PixelObservations
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model_file import load_model, save_model

from ..slow_rest import slow_rest
from .simulated_bodies import Truth, body, learned, scenario

BENDS = {"fisheye": {"k1": 0.02, "k2": -0.01}, "rational": {"k1": 0.7, "k2": 0.1, "k4": 0.9}}


PAIRS = {kind: (kind, kind) for kind in BENDS} | {"mixed": ("polynomial", "fisheye")}
BENDS["polynomial"] = {"k1": -0.1}


def wide(camera, kind):
    """Return a camera in the same place, with another lens and as many pixels to a degree."""
    inside = {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy", "image_size")}
    return Camera(**inside, **BENDS[kind], lens=kind, X_WC=camera.X_WC)


def through(kinds, rig, pixels):
    """Return where wide cameras see the rays of pixels. Shape (..., 4)."""
    flat = pixels.reshape(-1, 4)
    seen = [
        wide(camera, kind).pixels_of(camera.undistort(flat[:, k : k + 2]).T).T
        for camera, kind, k in zip(rig.cameras, kinds, (0, 2), strict=True)
    ]
    return np.hstack(seen).reshape(pixels.shape)


@pytest.fixture(scope="module", params=list(PAIRS))
def seen(request):
    """Return the cameras' lenses, the cameras learned, and what they recorded."""
    kinds, known = PAIRS[request.param], scenario()
    rig = Truth.of(body()).rig
    boards, test_boards = (
        replace(views, pixels=through(kinds, rig, views.pixels))
        for views in (known.boards, known.test_boards)
    )
    train, test = (
        replace(data, pixels=through(kinds, rig, data.pixels)) for data in (known.train, known.test)
    )
    lens = dict(zip(("left", "right"), kinds, strict=True))
    cameras = calibrate_cameras(boards, CameraOptions(lens=lens)).self_model("cameras")
    return kinds, cameras, train, test, boards, test_boards


@pytest.mark.slow
def test_a_body_is_learned_as_well_as_through_any_lens(seen, tmp_path):
    kinds, cameras, train, test, boards, test_boards = seen
    found = calibrate_body(
        train, cameras, boards, BodyOptions(), test=test, test_boards=test_boards
    )
    assert judge(found).status == judge(learned()).status
    plain, error = (
        evaluate(one.model, scenario().test).statistics.mean for one in (learned(), found)
    )
    assert error < 1.15 * plain
    assert found.model.rig.lenses == kinds
    save_model(found.model, tmp_path / "body.yaml")
    again = load_model(tmp_path / "body.yaml")
    assert again.rig.values == pytest.approx(found.model.rig.values)


@pytest.mark.slow
def test_an_arm_is_learned_through_wide_cameras(seen):
    _, cameras, train, *_ = seen
    stereo = StereoPoints.of(cameras, train)
    arm = stereo.complete(calibrate_kinematics(stereo.train, loss="none", starts=3))
    plain = StereoPoints.of(scenario().cameras, scenario().train)
    other = calibrate_kinematics(plain.train, loss="none", starts=3)
    errors = [evaluate(one.model, scenario().test).statistics.mean for one in (arm, other)]
    assert errors[0] < 1.15 * errors[1]
    names = {name for name in cameras.covariance.names if name.endswith("k4")}
    assert names <= set(arm.model.covariance.names)


@pytest.mark.parametrize("kind", slow_rest(["rational", "fisheye"]))
def test_derivatives_by_wide_cameras_agree_with_differences(kind):
    truth = Truth.of(body())
    rig = StereoRig(*(wide(camera, kind) for camera in truth.rig.cameras))
    observations = PixelObservations.from_dataset(scenario().train)
    block = HandPixels(observations, truth.parameters, kind)
    x = np.concatenate([truth.parameters.values, rig.values])
    _, jacobian = block.evaluate(x)
    for i in range(len(truth.parameters.values), len(x)):
        step = 1e-6 * max(1.0, abs(x[i])) * (np.arange(len(x)) == i)
        numeric = (block.evaluate(x + step)[0] - block.evaluate(x - step)[0]) / (2.0 * step[i])
        scale = np.abs(numeric).max() + 1e-6
        assert jacobian[i] / scale == pytest.approx(numeric / scale, abs=1e-5), block.names[i]

"""Cameras that were known before, held against boards that others are learned from."""

import re
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.estimation.cameras.known_cameras import KnownCameras, other_scale
from nico_selfmodel.estimation.cameras.pair_checks import baseline
from nico_selfmodel.estimation.judging import judge, to_json
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.self_model import SelfModel
from tests.estimation.seen_by_many import rig_of, seen_by_two

MOVED = transform(rotation_from_vector([0.3, -0.1, 0.2]), [1.0, 2.0, -0.5])


def scene(seed=0):
    rng = np.random.default_rng((seed, 8))
    rig = rig_of(3, rng)
    return rig.cameras, seen_by_two(rig, rng)


def assessed(cameras, views, test=None):
    known = SelfModel("as built", cameras=cameras)
    return CameraAssessment.from_calibration(calibrate_cameras(views), CameraOptions(), test, known)


@pytest.mark.slow
def test_the_truth_leaves_what_is_learned_leaves_wherever_its_world_is():
    cameras, views = scene()
    found = assessed({n: c.at(MOVED @ c.X_WC) for n, c in cameras.items()}, views)
    document = to_json(found, judge(found))
    before = document["before"]
    assert before["on"] == "train"
    assert before["pixels"]["rms"] == pytest.approx(document["train"]["pixels"]["rms"], rel=0.03)
    change = before["changes"]["cam1.pose.x"]
    assert abs(change["change"]) < 4.0 * change["sigma"]
    assert not any("times as far apart" in words for words in found.warnings)


@pytest.mark.slow
def test_a_lens_that_was_changed_is_seen_in_errors_and_numbers():
    cameras, views = scene(1)
    train, test = views.split(0.2, 0)
    old = {n: replace(c, fx=1.02 * c.fx, fy=1.02 * c.fy) for n, c in cameras.items()}
    found = assessed(old, train, test)
    document = to_json(found, judge(found))
    before = document["before"]
    assert before["on"] == "test"
    assert before["pixels"]["rms"] > 3.0 * document["test"]["pixels"]["rms"]
    change = before["changes"]["cam0.fx"]
    assert change["change"] == pytest.approx(-0.02 * old["cam0"].fx, abs=6.0 * change["sigma"])


@pytest.mark.slow
def test_squares_of_another_size_are_suspected_by_name():
    cameras, views = scene(2)
    large = replace(views, p_GQ=views.p_GQ * 1.1)
    (words,) = [w for w in assessed(cameras, large).warnings if "times as far apart" in w]
    assert "1.100 times as far apart as 'as built' had them" in words
    assert re.search(r"squares (60|59.99|60.01) mm in place of 66 mm", words)


@pytest.mark.slow
def test_a_camera_that_was_moved_is_no_wrong_square():
    cameras, views = scene(3)
    away = np.array(cameras["cam2"].X_WC)
    away[0, 3] += 0.2
    found = assessed(cameras | {"cam2": cameras["cam2"].at(away)}, views)
    assert not any("times as far apart" in words for words in found.warnings)


@pytest.mark.slow
def test_other_cameras_and_sizes_are_refused():
    cameras, views = scene(4)
    with pytest.raises(ModelError, match="lacks the camera cam2: it has cam0, cam1"):
        assessed({n: cameras[n] for n in ("cam0", "cam1")}, views)
    small = {n: replace(c, image_size=(640, 480)) for n, c in cameras.items()}
    with pytest.raises(DataError, match="has 640 x 480 pixels, the photographs have 960 x 720"):
        assessed(small, views)


def test_some_cameras_of_a_larger_rig_are_compared_in_their_own_frame():
    cameras, views = scene(5)
    found = assessed(cameras, views.pair("cam1", "cam2").placeable())
    document = to_json(found, judge(found))
    assert document["before"]["pixels"]["rms"] < 0.4
    for name in ("rx", "ry", "rz", "x", "y", "z"):
        change = document["before"]["changes"][f"cam2.pose.{name}"]
        assert abs(change["change"]) < 5.0 * change["sigma"], name


def test_what_noise_may_do_to_a_baseline_is_no_wrong_square():
    rng = np.random.default_rng((6, 8))
    rig = rig_of(2, rng)
    views = seen_by_two(rig, rng, boards=5, sigma=3.0)
    calibration = calibrate_cameras(views, CameraOptions(loss="none"))
    apart = baseline(
        calibration.pair("cam0", "cam1").X_LR[:3, 3],
        calibration.uncertainty,
        views.cameras,
    )
    away = calibration.cameras[1].X_WC.copy()
    away[:3, 3] *= 1.0 + 3.0 * apart.sigma / apart.value + 0.011  # below five sigma
    known = {"cam0": calibration.cameras[0], "cam1": calibration.cameras[1].at(away)}
    assert 3.0 * apart.sigma / apart.value > 0.011  # so that sigma decides
    held = KnownCameras.on(SelfModel("loose", cameras=known), views, held_out=False)
    assert other_scale(held, calibration) is None

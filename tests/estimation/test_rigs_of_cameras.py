"""Rigs of any number of cameras, connected by boards that two of them see at a time."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.cameras.board_accuracy import cross_validate_cameras
from nico_selfmodel.estimation.cameras.board_residuals import BoardResiduals
from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.estimation.cameras.lenses.lens_choice import lens_of
from nico_selfmodel.estimation.cameras.rig_start import rig_links
from nico_selfmodel.estimation.judging import judge, to_json
from nico_selfmodel.geometry.transform import inverse
from nico_selfmodel.model.cameras.rig_parameters import rig_names, rig_units, rig_values
from nico_selfmodel.model.self_model_file import load_model, save_model
from nico_selfmodel.viz.reports.cameras import camera_report
from tests.estimation.seen_by_many import rig_error, rig_of, seen_by_two


def scene(seed, count=4, lens="polynomial", **kind):
    rng = np.random.default_rng((seed, 4))
    rig = rig_of(count, rng, lens)
    return rig, seen_by_two(rig, rng, **kind)


def standard_scores(rig, found, lens="polynomial"):
    """Return (estimate - truth) / sigma of every free parameter."""
    names = rig_names(tuple(rig.cameras), lens)
    truth = dict(zip(names, rig_values(tuple(rig.cameras.values())), strict=True))
    learned = dict(zip(names, rig_values(found.cameras), strict=True))
    sigma = found.uncertainty.sigma
    return np.array([(learned[n] - truth[n]) / s for n, s in zip(found.names, sigma, strict=True)])


@pytest.mark.slow
def test_four_cameras_are_found_without_noise():
    rig, views = scene(1, sigma=0.0)
    found = calibrate_cameras(views)
    assert rig_error(dict(zip(rig.cameras, found.cameras, strict=True)), rig).max() < 1e-7
    assert found.names[-6:] == tuple(f"cam3.pose.{n}" for n in ("rx", "ry", "rz", "x", "y", "z"))
    assert (
        len(rig_units(4)) == len(rig_names(("a", "b", "c", "d"))) == len(rig_values(found.cameras))
    )


MIXED = ("fisheye", "polynomial", "polynomial")
SIZES = ((960, 720), (1280, 960), (640, 480))


def mixed(seed, **kind):
    """A fisheye and two polynomial lenses, with images of three sizes."""
    rng = np.random.default_rng((seed, 5))
    rig = rig_of(3, rng, MIXED, SIZES)
    return rig, seen_by_two(rig, rng, **kind)


def test_cameras_of_several_kinds_are_found_without_noise():
    rig, views = mixed(1, sigma=0.0)
    lens = dict(zip(views.cameras, MIXED, strict=True))
    found = calibrate_cameras(views, CameraOptions(lens=lens))
    assert rig_error(dict(zip(rig.cameras, found.cameras, strict=True)), rig).max() < 1e-7
    assert [camera.lens for camera in found.cameras] == list(MIXED)
    assert [camera.image_size for camera in found.cameras] == list(SIZES)


@pytest.mark.slow
def test_lenses_of_cameras_that_are_not_alike_are_chosen_one_by_one():
    _, views = mixed(2)
    choice = lens_of(views, CameraOptions(lens="auto"))
    assert choice.lens == "cam0=fisheye,cam1=polynomial,cam2=polynomial"
    assert choice.as_plain()["kind"] == choice.lens
    # One lens for all is held against these, too.
    assert lens_of(views, CameraOptions(lens="fisheye")).rival == choice.lens
    assert lens_of(views, CameraOptions(lens="polynomial")).better is not None
    asked = CameraOptions.from_text(lens=choice.lens)
    assert calibrate_cameras(views, asked).cost == pytest.approx(choice.calibration.cost, rel=0.01)


@pytest.mark.slow
def test_sigmas_cover_cameras_of_several_kinds():
    scores = []
    for seed in range(24):
        rig, views = mixed(100 + seed)
        lens = dict(zip(views.cameras, MIXED, strict=True))
        held = {"cam0.k3": 0.0, "cam0.k4": 0.0}
        options = CameraOptions(lens=lens, pinned=held)
        scores.append(standard_scores(rig, calibrate_cameras(views, options), MIXED))
    assert np.sqrt(np.mean(np.square(scores))) == pytest.approx(1.0, abs=0.2)
    assert np.mean(np.abs(scores) < 1.0) == pytest.approx(0.683, abs=0.08)


@pytest.mark.slow
@pytest.mark.parametrize("lens", ["polynomial", "fisheye"])
def test_sigmas_cover_cameras_that_see_boards_two_at_a_time(lens):
    plain = {"k3": 0.0, "k4": 0.0} if lens == "fisheye" else {}
    scores = []
    for seed in range(12):
        rig, views = scene(100 + seed, lens=lens)
        options = CameraOptions(lens=lens, pinned=plain)
        scores.append(standard_scores(rig, calibrate_cameras(views, options), lens))
    assert np.sqrt(np.mean(np.square(scores))) == pytest.approx(1.0, abs=0.2)
    assert np.mean(np.abs(scores) < 1.0) == pytest.approx(0.683, abs=0.08)


def test_derivatives_by_every_camera_agree_with_differences():
    rig, views = scene(2, count=3, boards=3)
    X_LG = calibrate_cameras(views).X_LG
    block = BoardResiduals(views, X_LG, 0.3)
    x = block.start_of(tuple(rig.cameras.values()), X_LG)
    _, by_shared, _ = block.evaluate_parts(x)
    for k, name in enumerate(block.shared_names):
        step = 1e-6 * max(abs(x[k]), 1.0)
        up, down = (block.evaluate_parts(x + s * np.eye(len(x))[k] * step)[0] for s in (1, -1))
        slope = (up - down) / (2.0 * step)
        scale = np.abs(slope).max() + 1e-6
        assert by_shared[:, k] / scale == pytest.approx(slope / scale, abs=2e-5), name


@pytest.mark.slow
def test_a_rig_in_another_order_is_the_same_rig():
    _, views = scene(3)
    found = calibrate_cameras(views)
    order = ("cam2", "cam0", "cam3", "cam1")
    pixels = np.concatenate([views.of_camera(name) for name in order], axis=2)
    other = calibrate_cameras(replace(views, cameras=order, pixels=pixels))
    assert other.cost == pytest.approx(found.cost, rel=1e-9)
    for name in order:
        one, two = found.pair("cam1", name), other.pair("cam1", name)
        assert pytest.approx(one.X_LR, abs=1e-6) == two.X_LR


def test_links_take_the_pairs_with_most_boards_and_name_what_is_apart():
    _, views = scene(4, boards=4)
    assert rig_links(views) == (("cam0", "cam1"), ("cam1", "cam2"), ("cam2", "cam3"))
    pixels = np.array(views.pixels)
    pixels[4:8] = np.nan  # all boards between cam1 and cam2
    with pytest.raises(EstimationError, match="one of cam0, cam1 and to one of cam2, cam3"):
        rig_links(replace(views, pixels=pixels))


@pytest.mark.slow
def test_what_is_left_out_still_connects_the_rig():
    _, views = scene(5, boards=6)
    everything = np.ones(len(views), dtype=bool)
    left = cross_validate_cameras(calibrate_cameras(views), CameraOptions(), everything)
    assert left.shape == views.pixels.shape
    assert np.sqrt(np.nanmean(left**2)) < 0.4
    few = views.select(np.arange(len(views)) % 6 < 3)
    learned = calibrate_cameras(few)
    assert len(cross_validate_cameras(learned, CameraOptions(), np.ones(len(few), dtype=bool))) == 0


@pytest.mark.slow
def test_a_rig_is_judged_pair_by_pair_and_kept(tmp_path):
    rig, views = scene(6)
    train, test = views.split(0.2, 0)
    calibration = calibrate_cameras(train)
    assessment = CameraAssessment.from_calibration(calibration, CameraOptions(), test)
    document = to_json(assessment, judge(assessment))
    assert document["method"] == "cameras"
    assert document["status"] == "PASS"
    pairs = document["pairs"]
    assert [pair["cameras"] for pair in pairs] == [[f"cam{k}", f"cam{k + 1}"] for k in range(3)]
    for pair in pairs:
        truth = [rig.cameras[name].X_WC[:3, 3] for name in pair["cameras"]]
        off = pair["baseline"]["value"] - np.linalg.norm(truth[0] - truth[1])
        assert abs(off) < 4.0 * pair["baseline"]["sigma"]
        assert pair["epipolar_px"]["pixels"]["mean"] < 0.4
    model = calibration.self_model("rig")
    save_model(model, tmp_path / "rig.yaml")
    again = load_model(tmp_path / "rig.yaml")
    assert list(again.cameras) == list(rig.cameras)
    assert pytest.approx(model.cameras["cam3"].X_WC) == again.cameras["cam3"].X_WC


@pytest.mark.slow
def test_a_camera_that_was_knocked_between_pictures_is_no_rigid_pair():
    _, views = scene(7)
    pixels = np.array(views.pixels)
    pixels[30:, :, 6:] += 25.0  # cam3, in half of its pictures
    with pytest.raises(EstimationError, match="no rigid pair"):
        calibrate_cameras(replace(views, pixels=pixels), CameraOptions(loss="none"))


@pytest.mark.slow
def test_baselines_between_later_cameras_have_their_own_sigma():
    _, views = scene(8)
    found = calibrate_cameras(views)
    assert np.allclose(inverse(found.cameras[0].X_WC), np.eye(4))
    assessment = CameraAssessment.from_calibration(found)
    document = to_json(assessment, judge(assessment))
    last = document["pairs"][-1]["baseline"]["sigma"]
    whole = np.sqrt(sum(document["parameters"][f"cam3.pose.{n}"]["sigma"] ** 2 for n in "xyz"))
    assert 0.0 < last < whole


@pytest.mark.slow
def test_two_cameras_of_any_name_are_a_pair_with_sigma_and_report():
    rig, views = scene(9, count=2)
    found = calibrate_cameras(views)
    assessment = CameraAssessment.from_calibration(found)
    document = to_json(assessment, judge(assessment))
    assert document["method"] == "stereo"
    apart = document["parameters"]["baseline"]
    truth = np.linalg.norm(rig.cameras["cam1"].X_WC[:3, 3])
    assert 0.0 < apart["sigma"] < 2e-3
    assert abs(apart["value"] - truth) < 4.0 * apart["sigma"]
    html = camera_report(assessment, document).html()
    assert "cam1" in html
    assert "first camera&#39;s frame" in html or "first camera's frame" in html

"""Cameras and arm learned one after the other, then together; what is kept, and what is told."""

import json
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.cli.learn.by_cameras import write_scenario
from nico_selfmodel.cli.option_groups import Output
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.folder import content_hash, load_dataset
from nico_selfmodel.errors import NotConvergedError
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.experiments.projected_nico import ProjectedNico
from nico_selfmodel.experiments.refinement import simulated_scenario
from nico_selfmodel.model.self_model_file import load_model
from nico_selfmodel.sessions import body_scenario as body_lesson
from nico_selfmodel.sessions.body_scenario import refine
from nico_selfmodel.sessions.camera_scenario import CameraScenario, learn_arm, nominal_with
from nico_selfmodel.systems.looking import looking_arm
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.viz.scene.scene import load_scene

MARKER = "fiducial"


def marked(data: Dataset) -> Dataset:
    """Return data without points measured from outside, the hand named as cameras name it."""
    unmeasured = np.full_like(data.p_WH_measured, np.nan)
    return replace(data, marker=np.full(len(data), MARKER), p_WH_measured=unmeasured)


@pytest.fixture(scope="module")
def recorded():
    world = IMPERFECTIONS["clean"].with_noise(play_deg=0.5)
    return simulated_scenario(ProjectedNico.tracked_by(), world, 0, random_poses=40)


@pytest.fixture(scope="module")
def cameras(recorded):
    """What was learned one after the other."""
    found = calibrate_cameras(recorded.boards)
    train, test = marked(recorded.train), marked(recorded.test)
    arm = learn_arm(train, test, found, nominal_with(looking_arm(MARKER), MARKER), "nico")
    return CameraScenario(recorded.boards, found, {MARKER: arm})


@pytest.fixture(scope="module")
def scenario(cameras, recorded):
    return refine(cameras, MARKER, recorded.test_boards)


@pytest.fixture
def undrawn(monkeypatch):
    """Spare the figures and the interactive scene, which other tests look at."""
    monkeypatch.setattr("nico_selfmodel.viz.figures.plot_style.image_bytes", lambda *_: b"<svg/>")
    monkeypatch.setattr("nico_selfmodel.viz.reports.page.static_html", lambda _: "")


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_the_refined_body_is_kept_with_covariance_and_told_beside_what_was_before(
    scenario, tmp_path
):
    assert scenario.accepted
    document = write_scenario(scenario, MARKER, Output(tmp_path / "nico"))
    kept = load_model(tmp_path / "nico")
    assert kept.parameters.values.tolist() == scenario.refined.model.parameters.values.tolist()
    assert {"left.fx", "right.pose.x", "right_elbow.r"} <= set(kept.covariance.names)
    assert document == json.loads((tmp_path / "nico" / "result.json").read_text())
    told = document["refinement"]
    assert told["accepted"]
    assert told["reasons"] == []
    assert told["before"]["pixels"]["mean"] == scenario.arm.seen.pixel_statistics.mean
    assert told["after"] == document["test"]
    assert told["boards"]["held_out"]
    before = scenario.arm.model.rig.baseline
    assert document["before"]["changes"]["baseline"]["before"] == pytest.approx(before)
    page = (tmp_path / "nico" / "report.html").read_text()
    assert "What learning together changed" in page
    names = {path.name for path in (tmp_path / "nico").iterdir()}
    assert {"nico_learned.urdf", "recordings", "scene.json"} <= names
    again = load_dataset(tmp_path / "nico" / "recordings" / "train")
    assert content_hash(again) == content_hash(scenario.arm.train)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_boards_that_lie_about_their_size_make_it_refused_and_the_arm_before_is_kept(
    cameras, recorded, tmp_path
):
    wrong = replace(recorded.boards, p_GQ=1.03 * recorded.boards.p_GQ)
    scenario = refine(replace(cameras, views=wrong), MARKER, recorded.test_boards)
    assert not scenario.accepted
    assert scenario.model is scenario.arm.model
    document = write_scenario(scenario, MARKER, Output(tmp_path / "nico"))
    assert document["status"] == "PASS"
    told = document["refinement"]
    assert not told["accepted"]
    assert "lost the scale" in " ".join(told["reasons"])
    assert told["kept"] == "arm learned after the cameras"
    assert load_model(tmp_path / "nico").rig.baseline == scenario.arm.model.rig.baseline
    page = (tmp_path / "nico" / "report.html").read_text()
    assert "refined together, and that was refused" in page
    assert "lost the scale" in page


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_refinement_without_an_end_is_told_too(cameras, recorded, tmp_path, monkeypatch):
    def endless(*_, **__):
        raise NotConvergedError("no plausible cameras fit the hand")

    monkeypatch.setattr(body_lesson, "calibrate_body", endless)
    scenario = refine(cameras, MARKER, recorded.test_boards)
    document = write_scenario(scenario, MARKER, Output(tmp_path / "nico"))
    assert document["refinement"]["reasons"] == ["no plausible cameras fit the hand"]
    assert document["refinement"]["after"] is None
    assert document["status"] == "PASS"


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_what_was_learned_by_sight_stands_upright_in_both_scenes(scenario, tmp_path):
    """The robot's own z is up, though its world is its left camera's frame."""
    write_scenario(scenario, MARKER, Output(tmp_path / "together"))
    refused = replace(scenario, verdict=replace(scenario.verdict, status="FAIL"))
    write_scenario(refused, MARKER, Output(tmp_path / "apart"))
    for name in ("together", "apart"):
        items = {item.path: item for item in load_scene(tmp_path / name).items}
        height = {p: items[p].X_WI[2, 3] for p in ("robot/base/0", "robot/chest/0", "robot/head/0")}
        assert height["robot/base/0"] < height["robot/chest/0"] < height["robot/head/0"]
        sideways = items["robot/head/0"].X_WI[:2, 3] - items["robot/chest/0"].X_WI[:2, 3]
        assert np.linalg.norm(sideways) < 0.05
        # The camera's y axis points down, but for the head's own turn.
        assert items["floor/measuring_frame"].X_WI[2, 1] < -0.7

"""The report and scene of a body, and the folder of a changed self-model."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.cli.result_files import write_with_report
from nico_selfmodel.estimation.body.body import calibrate_body
from nico_selfmodel.estimation.body.body_options import BodyOptions
from nico_selfmodel.estimation.judging import judge, to_json
from nico_selfmodel.experiments.projected_nico import ProjectedNico
from nico_selfmodel.experiments.refinement import simulated_scenario
from nico_selfmodel.model.self_model_file import load_model
from nico_selfmodel.result_folder.writing import urdf_file, write_result
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.viz.figures.workspace_map import workspace_map
from nico_selfmodel.viz.reports.body import body_report
from nico_selfmodel.viz.scene.body_scene import accuracy_at, body_scene
from nico_selfmodel.viz.scene.scene import load_scene


@pytest.fixture(scope="module")
def scenario():
    world = IMPERFECTIONS["clean"].with_noise(play_deg=0.5)
    return simulated_scenario(ProjectedNico.tracked_by(), world, 0, random_poses=40)


@pytest.fixture(scope="module")
def found(scenario):
    train = scenario.train.pixels.copy()
    train[70] += 40.0
    spoilt = replace(scenario.train, pixels=train)
    return calibrate_body(
        spoilt,
        scenario.cameras,
        scenario.boards,
        test=scenario.test,
        test_boards=scenario.test_boards,
    )


@pytest.fixture(scope="module")
def document(found):
    return to_json(found, judge(found))


@pytest.fixture(scope="module")
def folder(found, document, tmp_path_factory):
    """The result folder, written once for all that look into it."""
    place = tmp_path_factory.mktemp("results") / "body"
    write_with_report(place, found.model, body_report(found, document))
    return place


@pytest.mark.slow
def test_the_folder_holds_model_report_scene_numbers_and_urdf(found, document, folder):
    names = {path.name for path in folder.iterdir()}
    assert names == {
        "self_model.yaml",
        "result.json",
        "report.html",
        "residuals.csv",
        "scene.json",
        "cameras_learned.urdf",
    }
    assert load_model(folder).covariance.names == found.model.covariance.names
    assert json.loads((folder / "result.json").read_text()) == document
    assert len(load_scene(folder).items) == len(body_scene(found).items)


@pytest.mark.slow
def test_the_report_shows_the_numbers_of_the_document_and_loads_nothing(document, folder):
    html = (folder / "report.html").read_text(encoding="utf-8")
    page = re.sub(r'srcdoc="[^"]*"', "", html)
    for value in (
        document["test"]["pixels"]["mean"],
        document["test"]["position_mm"]["rms"],
        document["boards"]["after"]["edge_mm"]["sd"],
        document["workspace"]["learned_mm"]["mean"],
        document["parameters"]["right.fx"]["value"],
        document["before"]["pixels"]["mean"],
        document["before"]["changes"]["baseline"]["before"],
    ):
        assert f'data-value="{value}"' in page
    assert "PASS" in page
    assert not re.search(r'(?:src|href)="(?!data:|#)', page)
    assert "Outliers, left out of all but the held-out errors" in page


@pytest.mark.slow
def test_a_body_without_boards_says_so_and_has_no_board_table(scenario, monkeypatch):
    monkeypatch.setattr("nico_selfmodel.viz.figures.plot_style.image_bytes", lambda *_: b"<svg/>")
    found = calibrate_body(
        scenario.train, scenario.cameras, None, BodyOptions("intrinsics-fixed", "unanchored")
    )
    verdict = judge(found)
    html = body_report(found, to_json(found, verdict)).html()
    assert "Do the cameras still measure" not in html
    assert "right.pose.x" in html
    assert "holds the scale" in html


@pytest.mark.slow
def test_the_scene_shows_every_inlier_and_the_outlier(found):
    scene = body_scene(found)
    items = {item.path: item for item in scene.items}
    assert len(items["hand/known_to"].centers) == int((~found.outliers).sum())
    assert len(items["hand/outliers"].centers) == 1
    assert {"cameras/left/outline", "cameras/right/outline"} <= set(items)
    # The scene looks along x where the left camera looks along z.
    ahead = found.train.p_LH_predicted[~found.outliers][:, 2]
    assert items["hand/known_to"].centers[:, 0] == pytest.approx(ahead)


@pytest.mark.slow
def test_the_map_has_one_scale_and_says_what_more_data_would_cure(found):
    accuracy = accuracy_at(found)
    figure = workspace_map(accuracy)
    panels = figure.axes[:3]
    assert {ax.collections[0].norm.vmax for ax in panels} == {1e3 * accuracy.total.max()}
    assert f"{100.0 * accuracy.curable:.0f} %" in figure.get_suptitle()
    assert [len(ax.collections[0].get_offsets()) for ax in panels] == [len(accuracy.total)] * 3


def test_a_model_of_cameras_alone_has_no_urdf(scenario, tmp_path):
    assert urdf_file(scenario.cameras, tmp_path, None) == {}
    folder = write_result(tmp_path / "cameras", scenario.cameras, {"status": "PASS"})
    assert {path.name for path in folder.iterdir()} == {"self_model.yaml", "result.json"}
    assert np.isfinite(load_model(folder).rig.baseline)

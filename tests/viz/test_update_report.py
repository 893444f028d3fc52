"""The report on a tool, on new zeros, and on what `check` learned anew."""

import json
import re

import numpy as np
import pytest

from nico_selfmodel.cli.result_files import write_with_report
from nico_selfmodel.estimation.body.body import calibrate_body
from nico_selfmodel.estimation.judging import judge, to_json
from nico_selfmodel.estimation.monitoring.health import check_health
from nico_selfmodel.estimation.monitoring.relearning import relearn_cause, since_change
from nico_selfmodel.estimation.monitoring.tool import calibrate_tool, of_tip, rezero, with_marker
from nico_selfmodel.estimation.monitoring.update_evaluation import evaluate_update
from nico_selfmodel.estimation.monitoring.update_result import (
    relearned_result,
    rezero_result,
    tool_result,
)
from nico_selfmodel.experiments.projected_nico import ProjectedNico
from nico_selfmodel.experiments.refinement import simulated_scenario
from nico_selfmodel.model.self_model_file import load_model
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.viz.figures.over_time.health_plot import health_plot
from nico_selfmodel.viz.reports.updates import update_report
from nico_selfmodel.viz.scene.scene import load_scene
from nico_selfmodel.viz.scene.update_scene import update_scene

from ..estimation.joined_data import joined_data

WORLD = IMPERFECTIONS["clean"].with_noise(play_deg=0.5)
TOOL = np.array([0.025, 0.0, -0.08])
SLIPPED = "right_shoulder_roll"


@pytest.fixture(scope="module")
def model():
    scenario = simulated_scenario(ProjectedNico.tracked_by(), WORLD, 0, random_poses=40)
    return calibrate_body(scenario.train, scenario.cameras, scenario.boards).model


def poses(count, change=lambda body: None, shift=None, session=1):
    """Record random poses of the body, changed."""
    protocol = ProjectedNico.tracked_by()
    body = protocol.robot(WORLD, 0, session=session)
    change(body)
    rng = np.random.default_rng(session)
    return protocol.record(body, "poses", protocol.random_poses(count, rng, shift))


@pytest.fixture(scope="module")
def tool(model):
    train, test = (
        poses(count, lambda body: body.faults.take_tool(TOOL), TOOL, session)
        for count, session in ((12, 2), (15, 3))
    )
    found = calibrate_tool(model, train, tool="driver", test=test)
    parts = (of_tip(model, data, "driver") for data in (train, test))
    evaluation = evaluate_update(with_marker(model, "driver"), found.update, *_both(*parts))
    return evaluation, judge(found), to_json(tool_result(found, evaluation), judge(found))


def _both(train, test):
    return train, "pixels", test


@pytest.fixture(scope="module")
def zeros(model):
    data = poses(5, lambda body: body.faults.restart(4), session=4)
    found = rezero(model, data)
    evaluation = evaluate_update(model, found.update, data)
    verdict = judge(found)
    return evaluation, verdict, to_json(rezero_result(found, evaluation), verdict)


@pytest.fixture(scope="module")
def relearned(model):
    slipped = poses(15, lambda body: body.faults.slip(SLIPPED, np.radians(3.0)), session=6)
    data = joined_data(poses(10, session=5), slipped)
    health = check_health(model, data)
    update = relearn_cause(model, data, health)
    evaluation = evaluate_update(model, update, since_change(model, data, health))
    result = relearned_result(update, health.diagnoses[0].hypothesis.cause, evaluation)
    verdict = judge(result)
    return evaluation, verdict, to_json(result, verdict), health


def page_of(evaluation, document, health=None):
    html = update_report(evaluation, document, health).html()
    page = re.sub(r'srcdoc="[^"]*"', "", html)
    assert not re.search(r'(?:src|href)="(?!data:|#)', page)
    return page


@pytest.mark.slow
def test_a_tools_page_says_what_moved_and_what_it_was_worth_on_held_out_poses(tool):
    evaluation, verdict, document = tool
    page = page_of(evaluation, document)
    assert page.index(verdict.status) < page.index("What was learned")
    for value in (
        document["before"]["test"]["pixels"]["mean"],
        document["test"]["pixels"]["mean"],
        document["cross_validation"]["pixels"]["mean"],
        document["changes"]["hand.driver.x"]["before"],
        document["changes"]["hand.driver.x"]["after"],
        document["changes"]["hand.driver.x"]["sigma"],
    ):
        assert f'data-value="{value}"' in page
    assert document["before"]["test"]["pixels"]["mean"] > 50.0
    assert document["test"]["pixels"]["mean"] < 6.0
    assert "driver" in page
    assert "held out, before" in page


@pytest.mark.slow
def test_new_zeros_are_judged_by_poses_left_out_in_turn(zeros):
    evaluation, _, document = zeros
    assert document["status"] == "NOT_EVALUATED"
    found = document["cross_validation"]
    # Five poses, both cameras: one pose is left out at a time.
    assert found["n"] == 10
    assert document["train"]["pixels"]["mean"] < found["pixels"]["mean"] < 12.0
    assert document["before"]["train"]["pixels"]["mean"] > 3.0 * found["pixels"]["mean"]
    page = page_of(evaluation, document)
    assert "cross-validated, after" in page
    assert "Nothing was held out" in page
    shift = document["shift_deg"]["right_elbow"]
    assert f"{shift:+.2f}".replace("-", "−") + "°" in page


@pytest.mark.slow
def test_three_poses_are_left_out_one_by_one_and_one_pose_not_at_all(model):
    data = poses(3, lambda body: body.faults.restart(4), session=4)
    found = rezero(model, data)
    assert len(evaluate_update(model, found.update, data).cross_validation) == 6
    alone = poses(1, lambda body: body.faults.slip("right_elbow", 0.2), session=8)
    lone = rezero(model, alone, joints=("right_elbow",))
    evaluation = evaluate_update(model, lone.update, alone)
    assert evaluation.cross_validation is None
    verdict = judge(lone)
    document = to_json(rezero_result(lone, evaluation), verdict)
    assert document["cross_validation"] is None
    assert "too few poses for a cross-validation" in page_of(evaluation, document)


@pytest.mark.slow
def test_what_check_learned_anew_shows_what_told_it(relearned):
    evaluation, _, document, health = relearned
    page = page_of(evaluation, document, health)
    assert f"zero of {SLIPPED}" in page
    assert "What told that something had changed" in page
    assert f'data-value="{health.diagnoses[0].statistic}"' in page
    (change,) = document["changes"].values()
    assert abs(change["after"] - change["before"]) > 3.0 * change["sigma"]


@pytest.mark.slow
def test_the_plot_of_health_ends_its_statistic_at_the_alarm(relearned):
    *_, health = relearned
    above, below = health_plot(health).axes
    assert len(above.lines[0].get_xdata()) == len(health.nis)
    course, limit = below.lines[:2]
    assert len(course.get_xdata()) == health.alarm_at + 1
    assert course.get_ydata()[-1] > limit.get_ydata()[0] == health.threshold


@pytest.mark.slow
def test_a_healthy_body_has_a_plot_without_an_alarm(model):
    figure = health_plot(check_health(model, poses(20, session=9)))
    assert "20 poses fit" in figure.get_suptitle()


@pytest.mark.slow
def test_the_scene_shows_where_the_hand_was_thought_before_and_the_arm_as_it_was(relearned):
    evaluation, *_ = relearned
    items = {item.path: item for item in update_scene(evaluation).items}
    before, after = evaluation.held["train"]
    moved = items["hand/moved"]
    assert len(items["hand/now"].centers) == len(after.p_WH_predicted)
    assert moved.ends - moved.starts == pytest.approx(
        (after.p_WH_predicted - before.p_WH_predicted) @ _turn().T
    )
    assert any(path.startswith("before/arm/link") for path in items)
    assert {"cameras/left/outline", "cameras/right/outline"} <= set(items)


def _turn():
    """Return how the left camera's frame is turned in the scene."""
    return np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@pytest.mark.slow
def test_measured_points_make_a_page_too(model):
    protocol = ProjectedNico.tracked_by()
    body = protocol.robot(WORLD, 0, session=7)
    body.faults.restart(5)
    q = protocol.random_poses(6, np.random.default_rng(7))
    data = protocol.record(body, "points", q, observed=True)
    found = rezero(model, data, sensor="points")
    evaluation = evaluate_update(model, found.update, data, "points")
    verdict = judge(found)
    document = to_json(rezero_result(found, evaluation), verdict)
    assert "pixels" not in document["train"]
    assert "in space [mm]" in page_of(evaluation, document)


@pytest.mark.slow
def test_the_folder_holds_model_numbers_report_scene_and_urdf(tool, tmp_path):
    evaluation, _, document = tool
    folder = tmp_path / "held"
    write_with_report(folder, evaluation.after, update_report(evaluation, document))
    names = {path.name for path in folder.iterdir()}
    assert {"self_model.yaml", "result.json", "report.html", "scene.json"} <= names
    assert json.loads((folder / "result.json").read_text()) == document
    assert load_model(folder).markers == ("hand", "driver")
    assert load_scene(folder).paths == update_scene(evaluation).paths

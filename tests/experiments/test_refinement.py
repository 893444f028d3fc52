"""Chapter 8 beside the thesis: a small run, its tables, charts and documents."""

import json
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.experiments import refinement_report, tool_report, tool_use
from nico_selfmodel.experiments.irreducible_error import Limit
from nico_selfmodel.experiments.projected_nico import ProjectedNico
from nico_selfmodel.experiments.refinement import (
    CONDITIONS,
    row_of,
    run_refinement,
    simulated_scenario,
)
from nico_selfmodel.experiments.rendered_scenario import rendered_scenarios
from nico_selfmodel.experiments.rendered_tool import arm_with_tool
from nico_selfmodel.sessions.camera_scenario import Counts
from nico_selfmodel.sessions.rendered_nico import RenderedNico
from nico_selfmodel.systems.looking import looking_arm
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.stations.nico_instance import NicoInstance

from ..slow_rest import slow_rest

PLAY = IMPERFECTIONS["clean"].with_noise(play_deg=0.5)


@pytest.fixture(scope="module")
def refined():
    return run_refinement(PLAY, individuals=1, trackers=("fiducial",))


@pytest.mark.slow
def test_the_anchored_row_has_the_least_true_error_and_is_never_refused(refined):
    rows = {row.condition: row for row in refined.rows}
    assert set(rows) == set(CONDITIONS)
    best = rows["full, anchored"]
    assert best.refused == 0
    assert best.true_mm[0] < 2.6
    assert all(row.true_mm[0] > best.true_mm[0] for row in refined.rows if row is not best)
    assert best.edge_mm[1] <= best.edge_mm[0]
    assert best.own_mm[0] < rows["kinematics only"].own_mm[0]
    # The thesis, on its real robot: 1.99 mm and 2.61 px.
    assert best.own_mm[0] < 1.99
    assert best.px[0] < 2.61
    assert rows["full, as published"].refused >= 1


@pytest.mark.slow
def test_the_tables_stand_beside_the_thesis(refined, tmp_path):
    (table,) = refinement_report.report_of(refined).tables
    headings, rows = table.headings, table.rows
    assert len(rows) == len(CONDITIONS) + 1
    assert all(len(row) == len(headings) for row in rows)
    assert rows[0][1].endswith("/ 2.74 (1.39)")
    assert rows[2][6].endswith("/ 9.5, 5.6")
    refinement_report.report_of(refined).write(tmp_path / "out")
    document = json.loads((tmp_path / "out" / "result.json").read_text())
    assert document["individuals"] == 1
    assert document["thesis"]["fiducial"]["full, as published"]["own_mm"] == [1.99, 1.24]
    text = (tmp_path / "out" / "tables.md").read_text()
    assert "own 3D" in text
    assert {p.suffix for p in (tmp_path / "out").iterdir()} == {".json", ".md", ".png"}


def test_measures_that_some_bodies_lack_are_averaged_over_the_others():
    base = {
        "own_mm": (2.0, 1.0),
        "px": (3.0, 1.0),
        "pixel_sigma": 0.3,
        "joint_sigma_deg": 0.3,
        "refused": False,
        "seconds": 1.0,
    }
    row = row_of("fiducial", "full", [base, {**base, "edge_mm": (1.5, 1.2), "refused": True}])
    assert row.edge_mm == (1.5, 1.2)
    assert row.true_mm is None
    assert (row.refused, row.runs) == (1, 2)


@pytest.mark.slow
def test_lessons_may_come_from_elsewhere_one_body_after_the_other(tmp_path, monkeypatch):
    """As with `--rendered`; here the scenarios are simulated, so that nothing need be rendered."""
    some = {"full, anchored": CONDITIONS["full, anchored"]}
    monkeypatch.setattr("nico_selfmodel.experiments.refinement.CONDITIONS", some)
    asked, told = [], []

    def source(seed, trackers, stage):
        asked.append((seed, trackers))
        stage("training poses", 1, 1)
        scenario = simulated_scenario(ProjectedNico.tracked_by(), PLAY, seed, random_poses=40)
        unseen = replace(
            scenario.test, p_WH_measured=np.full_like(scenario.test.p_WH_measured, np.nan)
        )
        return {"fiducial": replace(scenario, test=unseen, links=None)}

    found = run_refinement(
        PLAY, 2, 4, ("fiducial",), lambda *words: told.append(words), rendered=source
    )
    assert asked == [(4, ("fiducial",)), (5, ("fiducial",))]
    assert ("body 2 of 2: training poses", 1, 1) in told
    assert found.rendered
    (row,) = found.rows
    assert (row.runs, row.true_mm, row.links_mm) == (2, None, None)
    refinement_report.report_of(found).write(tmp_path / "out")
    text = (tmp_path / "out" / "tables.md").read_text()
    assert "found in rendered pictures" in text
    assert "0 of 2 |" in text
    lost = replace(found, individuals=3)
    assert refinement_report.report_of(lost).tables[0].rows[0][-1] == "0 of 2, 1 without an end"
    assert not (tmp_path / "out" / "true.png").exists()


@pytest.mark.slow
def test_one_nico_records_for_all_trackers_through_rendered_pictures():
    counts = Counts(boards=6, circle=8, random=6, test=6, test_boards=3)
    found = rendered_scenarios(PLAY, 0, ("fiducial", "color"), None, counts)
    assert set(found) == {"fiducial", "color"}
    for scenario in found.values():
        assert len(scenario.boards) == 6
        assert len(scenario.test_boards) == 3
        assert not np.isfinite(scenario.train.p_WH_measured).any()
        assert np.isfinite(scenario.test.pixels).all(axis=1).sum() >= 6
    # Of four joints with half a degree of play nobody knows where they rest.
    assert 1.0 < found["fiducial"].limit.px[0] < 4.0
    assert found["color"].limit is None
    # What was measured from outside lies where the true left camera saw it.
    test, left = (
        found["fiducial"].test,
        NicoInstance.build(looking_arm(), PLAY, 0, NICO_CAMERAS).rig.left,
    )
    seen = left.at(np.eye(4)).project(test.p_WH_measured)
    assert np.nanmax(np.abs(seen - test.pixels[:, :2])) < 0.6
    assert found["fiducial"].links == pytest.approx((0.13, 0.14), abs=0.02)
    # Nobody can measure the middle of a patch of colour.
    assert found["color"].links is None
    assert not np.isfinite(found["color"].test.p_WH_measured).any()


@pytest.mark.slow
def test_the_mechanics_leave_play_and_the_tracker_and_no_body_does_better(refined):
    (limit,) = refined.limits
    best = {row.condition: row for row in refined.rows}["full, anchored"]
    assert 0.9 * best.px[0] < limit.px[0] < 1.02 * best.px[0]
    assert 0.8 * best.true_mm[0] < limit.true_mm[0] < 1.02 * best.true_mm[0]
    rows = refinement_report.report_of(refined).tables[0].rows
    assert rows[-1][0] == f"fiducial, {refinement_report.KNOWN}"
    assert rows[-1][2] == f"{limit.px[0]:.2f} ({limit.px[1]:.2f})"


@pytest.mark.parametrize("sag", slow_rest([2.0, 0.0]))
def test_a_body_without_play_that_knows_itself_is_left_with_its_tracker(sag):
    """0.3 px in each coordinate are 0.376 px on average; how a joint sags can be known."""
    world = replace(IMPERFECTIONS["clean"], play=0.0, sag=np.radians(sag))
    protocol = ProjectedNico.tracked_by()
    body = protocol.robot(world, 3)
    poses = protocol.random_poses(150, np.random.default_rng(0))
    data = protocol.record(body, "test", poses, observed=True)
    limit = Limit.of("fiducial", data, *body.ground_truth.expected(data.encoders))
    assert limit.px[0] == pytest.approx(0.376, rel=0.1)
    assert limit.true_mm[0] < 1e-6


def test_limits_of_individuals_are_averaged():
    one, other = (Limit("fiducial", (px, 1.0), (px - 1.0, 0.0)) for px in (2.0, 3.0))
    assert Limit.mean([one, other]) == Limit("fiducial", (2.5, 1.0), (1.5, 0.5))


def test_a_tool_is_where_the_finger_was_and_longer(tmp_path):
    bare, arm = looking_arm("finger_tip"), arm_with_tool(tmp_path)
    assert arm.markers == bare.markers
    assert arm.joints == bare.joints
    assert arm.chain.p_WH_zero - bare.chain.p_WH_zero == pytest.approx(tool_use.TOOL[None])
    # The tape has gone from the finger of that hand, and only from there.
    before, after = (one.urdf.read_text().count('"red_tape"') for one in (bare, arm))
    assert before - after == 1
    # All that an individual's arm is built from stays, so that it is the same body.
    chains = [NicoInstance.build(a, PLAY, 4, NICO_CAMERAS).mechanics.chain for a in (bare, arm)]
    assert chains[0].points == pytest.approx(chains[1].points)
    assert chains[0].directions == pytest.approx(chains[1].directions)


@pytest.mark.slow
def test_the_tip_of_a_tool_is_found_in_pictures(tmp_path):
    arm = arm_with_tool(tmp_path)
    nico = RenderedNico(PLAY, 0, ("finger_tip",), arm=arm)
    seen = nico.record("tip", 4, 0, 5, observed=True)
    assert len(seen) == 5
    left = NicoInstance.build(arm, PLAY, 0, NICO_CAMERAS).rig.left.at(np.eye(4))
    off = np.linalg.norm(left.project(seen.p_WH_measured) - seen.pixels[:, :2], axis=1)
    # The side of the tape that is seen is not its middle.
    assert off.max() < 3.0
    # Half a degree of play in four joints, 0.2 m away.
    expected, _ = nico.ground_truth.expected(seen.encoders, "finger_tip")
    assert np.linalg.norm(expected[:, :2] - seen.pixels[:, :2], axis=1).max() < 15.0


@pytest.mark.slow
def test_a_tool_may_come_from_pictures_and_then_nothing_restarts(tmp_path, monkeypatch):
    """As with `--rendered`; here the scenario is simulated, so that nothing need be rendered."""
    monkeypatch.setattr(tool_use, "COUNTS", (3,))
    monkeypatch.setattr(tool_report, "COUNTS", (3,))
    scenario = tool_use.simulated_tool_scenario(PLAY, 0)
    unseen = np.full_like(scenario.hand.p_WH_measured, np.nan)
    scenario = replace(scenario, hand=replace(scenario.hand, p_WH_measured=unseen))
    found = tool_use.run_tool(PLAY, 1, 7, rendered=lambda seed, _: scenario)
    assert found.rendered
    assert found.restart == ()
    rows = {row.what: row for row in found.tool}
    assert rows["hand before"].true_mm is None
    assert rows["tool, 3 poses, tip alone"].px[0] < 6.0 < rows["tool, nothing learned"].px[0]
    tool_report.report_of(found).write(tmp_path / "out")
    text = (tmp_path / "out" / "tables.md").read_text()
    assert "found in rendered pictures" in text
    assert "After a restart" not in text
    assert "| the thesis: tool, 52 poses | 7.42 (5.99) | 5.09 (3.09) | - | - |" in text


def test_a_tracker_that_is_none_is_refused():
    with pytest.raises(ValueError, match="no tracker 'touch'"):
        run_refinement(PLAY, trackers=("touch",))


@pytest.mark.slow
def test_a_tool_takes_three_poses_and_a_restart_five(tmp_path):
    told = []
    found = tool_use.run_tool(PLAY, individuals=1, progress=lambda *told_: told.append(told_))
    assert told == [("bodies learning", 1, 1)]
    tool = {row.what: row.true_mm[0] for row in found.tool}
    inside = {row.what: row.own_mm[0] for row in found.tool}
    # The thesis, every parameter of its arm retrained: 7.42 mm.
    assert inside["tool, 52 poses, tip alone"] < 7.42
    assert tool["tool, nothing learned"] > 70.0
    assert tool["tool, 3 poses, tip alone"] < 7.0
    assert tool["tool, 52 poses, all else too, as known"] < 4.0
    zeros = {row.what: row.true_mm[0] for row in found.restart}
    assert zeros["after the restart"] > 20.0
    assert zeros["zeros from 10 poses"] < 3.0
    tool_report.report_of(found).write(tmp_path / "out")
    text = (tmp_path / "out" / "tables.md").read_text()
    assert "7.42 (5.99)" in text
    document = json.loads((tmp_path / "out" / "result.json").read_text())
    assert np.isfinite(document["tool"][0]["true_mm"][0])
    assert (tmp_path / "out" / "tool.png").stat().st_size > 5000

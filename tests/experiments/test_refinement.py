"""Chapter 8 beside the thesis: a small run, its tables, charts and documents."""

import json

import numpy as np
import pytest

from nico_selfmodel.experiments import refinement_report, tool_use
from nico_selfmodel.experiments.refinement import CONDITIONS, row_of, run_refinement
from nico_selfmodel.systems import WORLDS

PLAY = WORLDS["clean"].with_noise(play_deg=0.5)


@pytest.fixture(scope="module")
def refined():
    return run_refinement(PLAY, individuals=1, trackers=("fiducial",))


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
    assert best.own_mm[0] < 2.74
    assert rows["full, as published"].refused >= 1


def test_the_tables_stand_beside_the_thesis(refined, tmp_path):
    headings, rows = refinement_report.table_rows(refined)
    assert len(rows) == len(CONDITIONS)
    assert all(len(row) == len(headings) for row in rows)
    assert rows[0][1].endswith("/ 2.74 (1.39)")
    assert rows[2][6].endswith("/ 9.5, 5.6")
    refinement_report.write_report(refined, tmp_path / "out")
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


def test_a_tracker_that_is_none_is_refused():
    with pytest.raises(ValueError, match="no tracker"):
        run_refinement(PLAY, trackers=("touch",))


def test_a_tool_takes_three_poses_and_a_restart_five(tmp_path):
    told = []
    found = tool_use.run_tool(PLAY, individuals=1, progress=lambda *told_: told.append(told_))
    assert told == [("bodies learning", 1, 1)]
    tool = {row.what: row.true_mm[0] for row in found.tool}
    assert tool["tool, nothing learned"] > 70.0
    assert tool["tool, 3 poses, tip alone"] < 7.0
    assert tool["tool, 52 poses, all else too, as known"] < 4.0
    zeros = {row.what: row.true_mm[0] for row in found.restart}
    assert zeros["after the restart"] > 20.0
    assert zeros["zeros from 10 poses"] < 3.0
    tool_use.write_report(found, tmp_path / "out")
    text = (tmp_path / "out" / "tables.md").read_text()
    assert "7.42 (5.99) mm" in text
    document = json.loads((tmp_path / "out" / "result.json").read_text())
    assert np.isfinite(document["tool"][0]["true_mm"][0])
    assert (tmp_path / "out" / "tool.png").stat().st_size > 5000

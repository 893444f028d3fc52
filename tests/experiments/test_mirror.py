"""The experiment of chapter 9, and the figures that mirrors must reach."""

import json

import numpy as np
import pytest

from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.mirrors.mirror import calibrate_mirrors
from nico_selfmodel.estimation.mirrors.mirror_cameras import fit_mirror_cameras
from nico_selfmodel.experiments import mirror, mirror_report
from nico_selfmodel.experiments.mirror_body import MIRRORS, learned_body, mirror_body


@pytest.fixture(scope="module")
def results():
    short = pytest.MonkeyPatch()
    short.setattr(mirror, "POSES", (10,))
    short.setattr(mirror_report, "POSES", (10,))
    short.setattr(mirror, "TEST_POSES", 30)
    yield mirror.run_mirror(2)
    short.undo()


@pytest.mark.slow
def test_the_experiment_has_a_row_for_every_mirror_and_number_of_poses(results):
    assert [(row.mirror, row.poses) for row in results.rows] == [(name, 10) for name in MIRRORS]
    assert [row.view for row in results.depth] == ["direct", *MIRRORS]
    assert 200.0 < results.arm_mm < 300.0


@pytest.mark.slow
def test_reflections_are_predicted_and_stereo_explains_the_rest(results):
    direct, *reflected = results.depth
    for row in reflected:
        assert row.pixels[0] <= 1.5 * direct.pixels[0]
        assert row.position_mm[0] < 50.0
        assert row.position_mm[0] < 1.6 * row.stereo_mm
        assert row.depth_mm > 2.0 * direct.depth_mm


@pytest.mark.slow
def test_tables_charts_and_json_are_written(results, tmp_path):
    mirror_report.report_of(results).write(tmp_path / "out")
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "result.json", "tables.md", "position.png", "pixels.png",
    }  # fmt: skip
    document = json.loads((tmp_path / "out" / "result.json").read_text("utf-8"))
    assert len(document["rows"]) == 3
    text = (tmp_path / "out" / "tables.md").read_text("utf-8")
    assert "| middle | 10 |" in text
    assert "stereo sets the limit" in text
    table, _ = mirror_report.report_of(results).tables
    headings, rows = table.headings, table.rows
    assert all(len(row) == len(headings) for row in rows)


@pytest.mark.slow
@pytest.mark.parametrize(("poses", "bound_px"), [(5, 1.1), (10, 1.0)])
def test_one_plane_reaches_its_bounds_over_ten_seeds(poses, bound_px):
    ours, free, angles, distances, flat = [], [], [], [], 0
    for seed in range(10):
        body = mirror_body(seed)
        found = calibrate_mirrors(
            body.watch("middle", poses, 1), body.calibrated(), test=body.watch("middle", 100, 2)
        )
        true, plane = body.ground_truth.mirrors["middle"], found.mirrors["middle"]
        ours.append(found.test.distances_px.mean())
        cameras = fit_mirror_cameras(found.solution.reflections)
        free.append(cameras.evaluate(found.test.reflections).distances_px.mean())
        angles.append(np.degrees(plane.angle_to(true)))
        distances.append(1e3 * abs(plane.distance - true.distance))
        flat += found.flatness["middle"].flat
    assert np.mean(ours) <= bound_px
    assert np.mean(ours) <= np.mean(free)
    assert flat == 10
    if poses == 5:
        assert np.mean(np.array(ours) < np.array(free)) >= 0.9
        assert np.mean(ours) < 0.9 * np.mean(free)
    else:
        assert np.mean(angles) <= 0.15
        assert np.mean(distances) <= 2.0


@pytest.mark.slow
@pytest.mark.parametrize("poses", [20, 50])
def test_one_plane_is_never_worse_than_two_free_cameras(poses):
    for pixel_sigma in (0.3, 2.0):
        ours, free = [], []
        for seed in range(10):
            body = mirror_body(seed, pixel_sigma=pixel_sigma)
            found = calibrate_mirrors(
                body.watch("middle", poses, 1),
                body.calibrated(),
                test=body.watch("middle", 100, 2),
            )
            ours.append(found.test.distances_px.mean())
            cameras = fit_mirror_cameras(found.solution.reflections)
            free.append(cameras.evaluate(found.test.reflections).distances_px.mean())
        assert np.mean(ours) <= np.mean(free)


@pytest.mark.slow
@pytest.mark.parametrize("radius", [3.0, -3.0])
def test_a_mirror_of_three_metres_radius_is_recognised_as_not_flat(radius):
    for seed in range(10):
        body = mirror_body(seed, radius=radius)
        found = calibrate_mirrors(body.watch("middle", 10, 1), body.calibrated())
        assert not found.flatness["middle"].flat
        assert judge(found).status == "FAIL"
        assert any("not flat" in reason for reason in judge(found).reasons)


@pytest.mark.slow
def test_bodies_that_learned_themselves_are_honest_about_their_mirrors():
    scores = []
    for seed in range(10):
        body = mirror_body(seed)
        model = learned_body(body)
        for name in MIRRORS:
            found = calibrate_mirrors(body.watch(name, 10, 8), model)
            plane = found.mirrors[name]
            miss = plane.values - body.ground_truth.mirrors[name].values
            scores.append(miss @ np.linalg.solve(plane.covariance, miss) / 3.0)
            assert found.flatness[name].flat
    assert 0.5 < np.mean(scores) < 2.0

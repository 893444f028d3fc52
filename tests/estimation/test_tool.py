"""A tool becomes part of the body, zeros come back; from pixels and from measured points."""

import json
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import DataError, ModelError, NotIdentifiableError
from nico_selfmodel.estimation.arm.evaluation import evaluate
from nico_selfmodel.estimation.judging import judge, to_json
from nico_selfmodel.estimation.monitoring.tool import calibrate_tool, rezero
from nico_selfmodel.model.self_model_file import load_model, save_model

from ..slow_rest import slow_rest
from .joined_data import joined_data
from .simulated_bodies import blinded, body, learned, only_cameras, poses

SHIFT = np.array([0.025, 0.0, -0.08])
REACH = float(np.linalg.norm(SHIFT))


@pytest.fixture(scope="module")
def model():
    return learned(0).model


@pytest.fixture(scope="module")
def tipped():
    """Return 60 poses that show a tool's tip, and what an outsider measured of it."""
    one = body()
    one.faults.take_tool(SHIFT)
    return poses(one, 60, shift=SHIFT)


def true_mm(model, data, marker="tool"):
    named = replace(data, marker=np.full(len(data), marker))
    return 1e3 * evaluate(model, named).statistics.mean


def points_only(data, sigma=1e-3):
    rng = np.random.default_rng(5)
    noisy = data.p_WH_measured + sigma * rng.normal(size=data.p_WH_measured.shape)
    return replace(data, pixels=None, p_WH_measured=noisy, point_sigma_m=sigma)


@pytest.mark.slow
@pytest.mark.parametrize("sensor", ["pixels", "points"])
@pytest.mark.parametrize("free", ["point", "body"])
def test_five_poses_place_the_tip(model, tipped, sensor, free):
    few, test = tipped.select(np.arange(5)), tipped.select(np.arange(20, 60))
    few = only_cameras(few) if sensor == "pixels" else points_only(few)
    found = calibrate_tool(model, few, sensor=sensor, free=free, test=test)
    assert found.tool == "tool"
    assert found.model.markers == ("hand", "tool")
    assert found.sensor == sensor
    assert true_mm(found.model, test) < 5.0
    assert found.reach == pytest.approx(REACH, abs=4.0 * found.reach_sigma)
    assert found.reach_sigma < 4e-3
    assert judge(found).status == "PASS"
    # The hand's own point, and the cameras, are what they were.
    assert found.model.parameters.values[-6:-3] == pytest.approx([0.0] * 3)
    if free == "point":
        assert found.model.rig.values == pytest.approx(model.rig.values, abs=1e-12)
        assert found.model.parameters.values[:-3] == pytest.approx(
            model.parameters.values, abs=1e-12
        )


def test_with_every_pose_nothing_beats_the_prior_of_the_body(model, tipped):
    train, test = tipped.select(np.arange(30)), tipped.select(np.arange(30, 60))
    alone = calibrate_tool(model, train, free="point", sensor="pixels")
    both = calibrate_tool(model, train, free="body", sensor="pixels")
    assert true_mm(both.model, test) < true_mm(alone.model, test) + 0.2
    before, after = (np.diag(m.covariance.matrix).sum() for m in (alone.model, both.model))
    assert after < before


def test_one_camera_is_enough_for_a_known_arm(model, tipped):
    few = blinded(only_cameras(tipped.select(np.arange(8))), slice(None), 1)
    found = calibrate_tool(model, few)
    assert true_mm(found.model, tipped.select(np.arange(20, 60))) < 6.0


def test_the_tip_is_learned_anew_under_its_own_name_and_survives_the_file(model, tipped, tmp_path):
    few = replace(only_cameras(tipped.select(np.arange(5))), marker=np.full(5, "screwdriver"))
    found = calibrate_tool(model, few)
    assert found.tool == "screwdriver"
    save_model(found.model, tmp_path / "m.yaml")
    again = load_model(tmp_path / "m.yaml")
    second = calibrate_tool(again, few, tool="screwdriver")
    assert second.model.markers == ("hand", "screwdriver")
    assert second.model.dh.p_NH[1] == pytest.approx(found.model.dh.p_NH[1], abs=1e-5)


def test_the_covariance_knows_that_body_and_tip_err_together(model, tipped):
    """The prediction of the tip is uncertain by both, and less than by each on its own."""
    found = calibrate_tool(model, only_cameras(tipped.select(np.arange(20))))
    names = found.model.covariance.names
    own = [names.index(f"hand.tool.{axis}") for axis in "xyz"]
    rest = [i for i in range(len(names)) if i not in own]
    matrix = found.model.covariance.matrix
    assert np.linalg.eigvalsh(matrix / np.outer(*[np.sqrt(np.diag(matrix))] * 2)).min() > -1e-9
    assert np.abs(matrix[np.ix_(own, rest)]).max() > 0.0
    together = found.model.predict(tipped.encoders, "tool").sigma
    apart = matrix.copy()
    apart[np.ix_(own, rest)] = 0.0
    apart[np.ix_(rest, own)] = 0.0
    loose = replace(found.model.covariance, matrix=apart)
    assert (
        together.mean()
        < replace(found.model, covariance=loose).predict(tipped.encoders, "tool").sigma.mean()
    )


def test_a_body_that_changed_too_is_noticed(model):
    one = body()
    one.faults.take_tool(SHIFT)
    one.faults.slip("right_shoulder_roll", np.radians(3.0))
    found = calibrate_tool(model, only_cameras(poses(one, 20, shift=SHIFT)))
    assert not found.update.fits
    verdict = judge(found)
    assert verdict.status == "FAIL"
    assert "no longer fits" in verdict.reasons[0]


def test_a_bare_hand_is_no_tool(model):
    found = calibrate_tool(model, only_cameras(poses(body(), 10)))
    assert any("no tool can be told from the bare hand" in r for r in found.reasons)
    assert judge(found).status == "FAIL"


def test_a_hand_that_hardly_moved_is_refused(model, tipped):
    still = tipped.select(np.zeros(1, dtype=int))
    rows = replace(
        still,
        sample=np.arange(1, 6),
        encoders=np.repeat(still.encoders, 5, axis=0),
        pixels=np.repeat(still.pixels, 5, axis=0),
        p_WH_measured=np.full((5, 3), np.nan),
        sweep=None,
        marker=None,
        mirror=None,
        extra={},
    )
    with pytest.raises(NotIdentifiableError, match=r"the hand moved by .* spread over the"):
        calibrate_tool(model, rows)


def test_what_does_not_suit_is_refused(model, tipped):
    few = only_cameras(tipped.select(np.arange(5)))
    with pytest.raises(DataError, match="no measured point"):
        calibrate_tool(model, replace(few, pixels=None))
    with pytest.raises(ValueError, match="free must be"):
        calibrate_tool(model, few, free="all")
    with pytest.raises(ValueError, match="no sensor"):
        calibrate_tool(model, few, sensor="touch")
    with pytest.raises(ValueError, match="no loss"):
        calibrate_tool(model, few, loss="l7")
    unobservable = replace(model, cameras={}, covariance=None)
    with pytest.raises(ModelError, match="no pair of cameras"):
        calibrate_tool(unobservable, few, sensor="pixels")


def test_an_outlier_among_the_poses_of_a_tool_is_left_out(model, tipped):
    few = only_cameras(tipped.select(np.arange(8)))
    pixels = few.pixels.copy()
    pixels[3] += [60.0, -40.0, -50.0, 30.0]
    found = calibrate_tool(model, replace(few, pixels=pixels))
    assert np.flatnonzero(found.update.outliers).tolist() == [3]
    assert true_mm(found.model, tipped.select(np.arange(20, 60))) < 5.0


def hardly_known(model, name, off, sigma):
    """Return a body with one parameter that is off, and known to be uncertain by about as much."""
    values, known = model.parameters.values.copy(), model.covariance
    values[model.parameters.names.index(name)] += off
    matrix, i = known.matrix.copy(), known.names.index(name)
    matrix[i, i] += sigma**2
    moved = model.parameters.with_values(values)
    return replace(model, table=moved.table, covariance=replace(known, matrix=matrix))


def test_what_the_arm_is_uncertain_by_is_no_contradiction(model, tipped):
    """An axis that is off is off alike in all poses: sound ones of a tip that turns about it."""
    loose = hardly_known(model, f"{model.joints[-2]}.alpha", np.radians(5.0), np.radians(3.0))
    for first in (0, 20, 40):
        found = calibrate_tool(loose, only_cameras(tipped.select(np.arange(first, first + 20))))
        assert found.update.fits, first
        assert not found.update.outliers.any(), first
        assert judge(found).status == "NOT_EVALUATED", judge(found).reasons


def test_an_outlier_is_left_out_though_the_arm_is_hardly_known(model, tipped):
    loose = hardly_known(model, f"{model.joints[-2]}.alpha", np.radians(5.0), np.radians(3.0))
    few = only_cameras(tipped.select(np.arange(12)))
    pixels = few.pixels.copy()
    pixels[3] += 60.0
    found = calibrate_tool(loose, replace(few, pixels=pixels))
    assert np.flatnonzero(found.update.outliers).tolist() == [3]


@pytest.mark.parametrize("sensor", ["pixels", "points"])
def test_five_poses_bring_the_zeros_back(model, sensor):
    one = body()
    one.faults.restart(7)
    few, test = poses(one, 5, seed=1), poses(one, 40, seed=2)
    assert 1e3 * evaluate(model, test).statistics.mean > 20.0
    few = only_cameras(few) if sensor == "pixels" else points_only(few)
    found = rezero(model, few, sensor=sensor)
    assert 1e3 * evaluate(found.model, test).statistics.mean < 4.0
    assert judge(found).status == "NOT_EVALUATED"
    change = np.random.default_rng((7, 11)).normal(0.0, np.radians(10.0), 4)
    assert found.shifts == pytest.approx(change, abs=np.radians(1.5))
    names = [f"{joint}.theta_offset" for joint in model.joints]
    free = [name in names for name in model.parameters.names]
    before, after = model.parameters.values, found.model.parameters.values
    assert after[~np.array(free)] == pytest.approx(before[~np.array(free)], abs=1e-12)
    assert set(names) <= set(found.model.covariance.names)


def test_only_the_joints_named_get_new_zeros(model):
    one = body()
    one.faults.slip("right_elbow", np.radians(5.0))
    found = rezero(model, only_cameras(poses(one, 6)), joints=("right_elbow",))
    assert found.shifts[:3] == pytest.approx([0.0] * 3)
    assert np.degrees(found.shifts[3]) == pytest.approx(5.0, abs=0.8)
    with pytest.raises(ValueError, match="no joint 'elbow'"):
        rezero(model, only_cameras(poses(one, 6)), joints=("elbow",))


def test_one_pose_leaves_zeros_open_and_names_them(model):
    with pytest.raises(NotIdentifiableError, match=r"right_.*theta_offset"):
        rezero(model, only_cameras(poses(body(), 1)))


def test_zeros_that_nothing_checks_are_refused(model):
    one = poses(body(), 1)
    with pytest.raises(DataError, match="3 numbers measured for 3 zeros leave none to check"):
        rezero(model, one, joints=model.joints[1:], sensor="points")
    rezero(model, one, joints=model.joints[2:], sensor="points")


@pytest.mark.parametrize("joint", slow_rest(["right_shoulder_roll", "right_elbow"]))
def test_readings_that_lost_a_turn_find_their_zeros(model, joint):
    def wrapped(data):
        column = data.joint_names.index(joint)
        lost = np.eye(4)[column] * data.joints[column].counts_per_turn
        return replace(data, encoders=data.encoders + lost)

    found = rezero(model, only_cameras(wrapped(poses(body(), 5))))
    assert found.update.fits
    assert np.all(np.abs(found.shifts) <= np.pi)
    again = wrapped(poses(body(), 30, seed=3))
    assert 1e3 * evaluate(found.model, again).statistics.mean < 5.0


def test_a_tip_is_learned_though_points_of_the_hand_are_seen_beside_it(model, tipped):
    few = points_only(tipped.select(np.arange(8)))
    hand = points_only(poses(body(), 8))
    tip = replace(few, marker=np.full(8, "pen"))
    own = replace(tip, p_WH_measured=hand.p_WH_measured, marker=np.full(8, "hand"))
    both = joined_data(tip, own)
    both = replace(both, sample=np.tile(tip.sample, 2))
    found, alone = calibrate_tool(model, both), calibrate_tool(model, tip)
    assert found.tool == "pen"
    assert found.model.markers == ("hand", "pen")
    assert found.reach == pytest.approx(alone.reach, rel=1e-9)
    with pytest.raises(ValueError, match=r"tracks no point 'nonsense'; there are pen, hand"):
        calibrate_tool(model, both, tool="nonsense")


@pytest.mark.slow
def test_zeros_where_all_was_set_aside_are_not_said_to_fit(model):
    data = points_only(poses(body(), 6))
    rng = np.random.default_rng(8)
    wrong = replace(data, p_WH_measured=rng.normal(0.0, 0.5, data.p_WH_measured.shape))
    found = rezero(model, wrong)
    reasons = " ".join(judge(found).reasons)
    assert "6 of 6 observations contradict what was learned" in reasons
    assert "misfit 0" not in reasons


@pytest.mark.slow
def test_zeros_of_another_body_do_not_fit(model):
    one = body()
    one.faults.bump_camera([0.03, 0.02, 0.0])
    found = rezero(model, only_cameras(poses(one, 10)))
    assert judge(found).status == "FAIL"


def test_the_documents_are_plain_numbers(model, tipped):
    found = calibrate_tool(
        model, only_cameras(tipped.select(np.arange(5))), test=only_cameras(tipped)
    )
    document = to_json(found, judge(found))
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert document["reach_mm"]["value"] == pytest.approx(1e3 * REACH, abs=12.0)
    assert set(document["parameters"]) == {f"hand.tool.{axis}" for axis in "xyz"}
    assert document["test"]["pixels"]["mean"] < 6.0
    again = rezero(model, only_cameras(poses(body(), 5)))
    document = to_json(again, judge(again))
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert document["body_fits"] is True

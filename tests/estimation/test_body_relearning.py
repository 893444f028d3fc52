"""What is learned anew in a whole body that is known: zeros after a restart, a tool in the hand."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import DataError, ModelError, NotIdentifiableError
from nico_selfmodel.estimation.judging import judge, to_json
from nico_selfmodel.estimation.monitoring.body_relearning import calibrate_body_tool, rezero_body
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_errors import errors_of
from nico_selfmodel.estimation.tree.tree_result import body_model
from nico_selfmodel.sessions.whole_body import whole_body_session
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

from .bodies_before_mirrors import knowing_body

CLEAN, TIP = IMPERFECTIONS["clean"], "right_finger_tip"


@pytest.fixture(scope="module")
def data():
    return whole_body_session(CLEAN, 5, 1, looks=2, hands=4)


@pytest.fixture(scope="module")
def body(data):
    return knowing_body(CLEAN, 5, data)


def shifted(body, data, **degrees):
    """A recording whose encoders' zeros are elsewhere."""
    readings = data.readings.copy()
    for joint, shift in degrees.items():
        i = body.tree.joints.index(joint)
        readings[:, i] += np.radians(shift) * body.tree.gear[i] / body.si_per_unit[i]
    return replace(data, readings=readings)


def without(body, marker):
    kept = tuple(m for m in body.tree.markers if m.name != marker)
    return replace(body, tree=body.tree.with_markers(kept))


@pytest.mark.slow
@pytest.mark.parametrize("shift", [{"left_elbow": 7.0}, {"neck_yaw": 130.0, "right_wrist": -20.0}])
def test_zeros_near_and_far_are_found_again(body, data, shift):
    update = rezero_body(body, shifted(body, data, **shift), list(shift))
    assert update.fits
    assert update.joints == tuple(shift)
    np.testing.assert_allclose(np.degrees(update.shifts), [-s for s in shift.values()], atol=0.6)
    assert np.isfinite(update.found.uncertainty.sigma).all()


def test_a_body_with_new_zeros_expects_what_is_seen(body, data):
    other = shifted(body, data, left_elbow=7.0)
    document = to_json(update := rezero_body(body, other, ["left_elbow"]), judge(update))
    assert document["method"] == "rezero"
    assert document["body_fits"]
    assert document["status"] == "NOT_EVALUATED"
    assert document["train"]["pixels"]["mean"] < 0.5 * document["before"]["train"]["pixels"]["mean"]
    assert document["shift_deg"]["left_elbow"] == pytest.approx(-7.0, abs=0.6)


@pytest.mark.slow
def test_a_zero_that_was_not_named_is_named(body, data):
    update = rezero_body(body, shifted(body, data, left_elbow=7.0), ["right_elbow"])
    assert not update.fits
    verdict = judge(update)
    assert verdict.status == "FAIL"
    assert any("the rest of the body no longer fits" in reason for reason in verdict.reasons)
    assert any("left_" in words for words in verdict.reasons)


def test_poses_that_leave_a_zero_open_are_refused_by_its_name(body, data):
    table = data.observations
    hands = [i for i, m in enumerate(data.markers) if m.on.startswith("left_")]
    unseen = replace(data, observations=table.select(~np.isin(table.marker, hands)))
    with pytest.raises(NotIdentifiableError, match=r"left_elbow\.rz"):
        rezero_body(body, unseen, ["left_elbow"])


def test_joints_beyond_all_that_was_seen_need_a_marker_and_no_more_poses(body, data):
    table = data.observations
    hands = [i for i, m in enumerate(data.markers) if m.on.startswith("left_")]
    unseen = replace(data, observations=table.select(~np.isin(table.marker, hands)))
    with pytest.raises(NotIdentifiableError) as refusal:
        rezero_body(body, unseen, ["left_elbow", "right_elbow"])
    assert "no number of poses tells `left_elbow.rz`, for these" in str(refusal.value)
    assert "a marker beyond them" in str(refusal.value)
    assert "--joint" in str(refusal.value)
    assert "more poses" not in str(refusal.value)


def test_what_has_no_zero_is_refused(body, data):
    with pytest.raises(ValueError, match="no joint 'elbow'"):
        rezero_body(body, data, ["elbow"])
    with pytest.raises(ModelError, match="does not say the noise"):
        rezero_body(replace(body, noise={}), data, ["left_elbow"])


def test_a_tip_that_the_body_does_not_know_becomes_part_of_it(body, data):
    update = calibrate_body_tool(without(body, TIP), data)
    (there,), (true,) = (
        [m.X_LA[:3, 3] for m in b.tree.markers if m.name == TIP] for b in (update.model, body)
    )
    off = there - true
    C = update.found.uncertainty.covariance
    assert update.tool == TIP
    assert off @ np.linalg.solve(C, off) < 16.3  # chi-square of three, one in a thousand
    assert np.linalg.norm(off) < 2e-3
    assert update.model.covariance is not None
    assert set(update.model.covariance.names) >= {f"{TIP}.{axis}" for axis in "xyz"}
    details = to_json(update, judge(update))
    assert details["reach_mm"]["from"] in {m.name for m in body.tree.markers}
    assert not details["known"]


def slipped(body, data, last, off):
    """A recording in which the tip sits elsewhere on its link after a sample [m]."""
    moved = tuple(
        replace(m, X_LA=m.X_LA + np.eye(4, k=3) * off) if m.name == TIP else m
        for m in body.tree.markers
    )
    here, there = (errors_of(tree, data) for tree in (body.tree, body.tree.with_markers(moved)))
    row, table = here.observations.row, data.observations
    part = np.append(0, row[1:] == row[:-1])
    values = np.array(table.values)
    values[row, part] += np.nan_to_num(there.residuals - here.residuals)
    late = data.sample[table.pose] > last
    values = np.where(late[:, None], values, table.values)
    return replace(data, observations=replace(table, values=values))


@pytest.mark.slow
def test_a_tip_that_slips_half_way_is_named_and_no_joint():
    data = whole_body_session(CLEAN, 5, 2, looks=2, hands=24)
    body, table = knowing_body(CLEAN, 5, data), data.observations
    shown = table.marker == [marker.name for marker in data.markers].index(TIP)
    last = np.median(data.sample[table.pose[shown]])
    sound = calibrate_body_tool(without(body, TIP), data, tool=TIP)
    assert sound.found.meanwhile is None
    spoilt = slipped(body, data, last, 0.004)
    verdict = judge(calibrate_body_tool(without(body, TIP), spoilt, tool=TIP))
    assert verdict.status == "FAIL"
    assert verdict.reasons[0].startswith(f"marker '{TIP}' slipped on its link by about ")
    assert not any("joint" in reason for reason in verdict.reasons)


def test_a_known_point_that_moved_is_learned_anew(body, data):
    moved = tuple(
        replace(m, X_LA=m.X_LA + np.eye(4, k=3) * 0.02) if m.name == TIP else m
        for m in body.tree.markers
    )
    wrong = replace(body, tree=body.tree.with_markers(moved))
    update = calibrate_body_tool(wrong, data, tool=TIP)
    assert update.fits
    assert to_json(update, judge(update))["known"]
    before, after = (
        next(m.X_LA[0, 3] for m in b.tree.markers if m.name == TIP) for b in (wrong, update.model)
    )
    assert before - after == pytest.approx(0.02, abs=2e-3)


def test_a_tip_that_nothing_tells_apart_is_asked_for(body, data):
    with pytest.raises(DataError, match="knows all of its markers; name it with --tool"):
        calibrate_body_tool(body, data)
    two = without(without(body, TIP), "left_finger_tip")
    with pytest.raises(DataError, match="it has right_finger_tip, left_finger_tip"):
        calibrate_body_tool(two, data)
    with pytest.raises(ValueError, match="no marker 'stick'"):
        calibrate_body_tool(body, data, tool="stick")


def test_a_tip_on_no_link_of_the_body_is_refused(body, data):
    joints = tuple("paw" if name == "right_wrist" else name for name in body.tree.joints)
    other = without(body, TIP)
    other = replace(other, tree=replace(other.tree, joints=joints))
    with pytest.raises(DataError, match="'right_wrist', which the body does not have"):
        calibrate_body_tool(other, data)


@pytest.mark.slow
def test_sigmas_of_new_zeros_cover_what_they_are_off():
    world, turned = IMPERFECTIONS["thesis"], 12.0
    off, fits = [], []
    for seed in (23, 24):
        train = whole_body_session(world, seed, 0, looks=40, hands=60)
        body = body_model(calibrate_tree(train, effects=()))
        for session in range(1, 9):
            seen = whole_body_session(world, seed, session, looks=3, hands=5)
            for joint in ("left_elbow", "neck_pitch", "right_shoulder_roll"):
                update = rezero_body(body, shifted(body, seen, **{joint: turned}), [joint])
                wrong = update.shifts[0] + np.radians(turned)
                off.append(wrong / update.found.uncertainty.sigma[0])
                fits.append(update.fits)
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.3
    assert np.mean(fits) > 0.85

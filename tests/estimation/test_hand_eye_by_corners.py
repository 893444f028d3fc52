"""A camera on a flange whose pose a controller tells, before corners of known place in the room."""

import re
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_dataset import BodyDataset, ObservationTable
from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.dataset.body.sensors import MarkerInfo, SensorInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.tree.contradictions import contradiction_words
from nico_selfmodel.estimation.tree.timing.moved_meanwhile import _fewest
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vectors_of
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.model.tree.tree_motion import TreeMotion

from ..slow_rest import slow_rest
from .simulated_trees import LENS, looking_at, one_arm, turned

CORNERS = 0.03 * np.array([[i, j, 0.0] for i in range(7) for j in range(5)])
PIXEL, TURN, SHIFT = 0.3, np.radians(0.05), 3e-4


def recorded(rng, poses=25, known=True, one_axis=False, moved=0.0):
    """A board in the room, and a camera on a flange whose poses are off by 0.05 deg and 0.3 mm."""
    X_FC, X_BW = turned(rng, 60.0, 90.0), turned(rng, 40.0, 700.0)
    eyes = [0.09, 0.06, -0.5] + 0.15 * rng.normal(size=(poses, 3))
    X_WC = np.stack([looking_at(eye, [0.09, 0.06, 0.0]) for eye in eyes])
    if one_axis:
        X_WC[:, :3, :3] = X_WC[0, :3, :3] @ rotation_from_vector(np.outer(eyes[:, 0], [0, 0, 3.0]))
    else:
        rolled = rotation_from_vector(0.2 * rng.normal(size=(poses, 3)))
        X_WC = X_WC @ transform(rolled, np.zeros(3))
    F = X_BW @ X_WC @ inverse(X_FC)
    told = F @ transform(
        rotation_from_vector(TURN * rng.normal(size=(poses, 3))),
        SHIFT * rng.normal(size=(poses, 3)),
    )
    rows = []
    for pose, X in enumerate(X_WC):
        board = CORNERS + np.array([moved if pose >= poses // 2 else 0.0, 0.0, 0.0])
        uv = LENS.at(np.eye(4)).project(apply(inverse(X), board))
        uv = uv + PIXEL * rng.normal(size=uv.shape)
        seen = np.isfinite(uv).all(axis=1) & ((uv > 0.0) & (uv < LENS.image_size)).all(axis=1)
        rows += [(pose, corner, *uv[corner]) for corner in np.flatnonzero(seen)]
    pose, corner, u, v = np.array(rows).T
    values = np.full((len(rows), 6), np.nan)
    values[:, 0], values[:, 1] = u, v
    zero = np.zeros(len(rows), dtype=int)
    markers = tuple(
        MarkerInfo(f"c{k}", "world", tuple(xyz) if known else None)
        for k, xyz in enumerate(CORNERS.tolist())
    )
    info = SensorInfo(
        "camera",
        "camera",
        on="tcp",
        image_size=LENS.image_size,
        lens=dict(LENS.named_values),
    )
    data = BodyDataset(
        "hand-eye",
        (LinkJoint("tcp", motion="flange", encoder_unit="pose"),),
        markers,
        (info,),
        np.arange(poses),
        np.full((poses, 1), np.nan),
        ObservationTable(pose.astype(int), zero, corner.astype(int), zero - 1, values),
        np.hstack([told[:, :3, 3], rotation_vectors_of(told[:, :3, :3])])[:, None],
    )
    return X_FC, data


def error_of(found, X_FC):
    camera = found.tree.sensors[0]
    error = camera.X_LA[:3, 3] - X_FC[:3, 3]
    index = [found.uncertainty.names.index(f"camera.{axis}") for axis in "xyz"]
    C = found.uncertainty.covariance[np.ix_(index, index)]
    return error, float(error @ np.linalg.solve(C, error)) / 3.0


def test_a_camera_on_a_flange_is_placed_by_the_corners_it_sees():
    X_FC, data = recorded(np.random.default_rng(1), poses=30)
    first = np.arange(30) < 20
    found = calibrate_tree(data.select(first), test=data.select(~first))
    verdict = judge(found)
    assert verdict.status == "PASS", verdict.reasons
    error, score = error_of(found, X_FC)
    assert np.linalg.norm(error) < 1e-3
    assert score < 4.0


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "status"), [(1.0, "NOT_EVALUATED"), (1.02, "FAIL")])
def test_a_target_in_the_room_that_is_told_too_large_fails_by_its_factor(factor, status):
    _, data = recorded(np.random.default_rng(200))
    markers = (replace(m, xyz=tuple(factor * x for x in m.xyz or ())) for m in data.markers)
    verdict = judge(calibrate_tree(replace(data, markers=tuple(markers)), effects=()))
    assert verdict.status == status
    if factor > 1.0:
        told = verdict.reasons[0].split("target on 'world' is told ")[1].split()[0]
        assert float(told) == pytest.approx(factor, abs=0.01)


def test_a_target_in_the_room_that_is_told_too_large_fails_before_ten_poses():
    """Its size had been taken for noise of the flange."""
    _, data = recorded(np.random.default_rng(1), poses=10)
    markers = (replace(m, xyz=tuple(1.03 * x for x in m.xyz or ())) for m in data.markers)
    verdict = judge(calibrate_tree(replace(data, markers=tuple(markers)), effects=()))
    told = re.match(r"target on 'world' is told (\S+) \+- .* apart, not 30.9\)", verdict.reasons[0])
    assert told, verdict.reasons
    assert float(told[1]) == pytest.approx(1.03, abs=0.01)


@pytest.mark.parametrize("seed", slow_rest(range(4), plain=1))
def test_a_board_that_is_moved_after_eight_of_sixteen_pictures_is_named(seed):
    for moved in (0.0, 0.008):
        rng = np.random.default_rng((seed, 12))
        said = judge(calibrate_tree(recorded(rng, poses=16, moved=moved)[1])).reasons
        assert any("moved by about" in one and "sample 7" in one for one in said) == (moved > 0)


def test_poses_of_a_flange_that_are_wrong_are_not_asked_for_another_joint(monkeypatch):
    found = calibrate_tree(recorded(np.random.default_rng(3), poses=12)[1])
    monkeypatch.setattr(contradiction_words, "read_wrongly", lambda *_: {"tcp": (3, 12)})
    (wrong,) = (one.text for one in contradiction_words.contradiction_findings(found))
    assert wrong.startswith("poses of flange 'tcp' would be wrong in 3 of 12 poses: check units")
    assert "which way they go" in wrong


def test_pictures_of_fewer_than_six_corners_tell_no_whole_poses():
    _, data = recorded(np.random.default_rng(0), poses=12)
    for corners, poses in ((6, 10), (5, 20)):
        few = data.of_rows(data.observations.marker < corners)
        assert _fewest(few) == poses
    unknown = tuple(replace(marker, xyz=None) for marker in data.markers)
    tags = replace(data, markers=unknown)
    assert _fewest(tags) == 20


@pytest.mark.slow
def test_a_board_that_is_moved_before_a_camera_on_a_flange_is_named():
    _, data = recorded(np.random.default_rng(1), poses=40, moved=0.004)
    (reason,) = judge(calibrate_tree(data, effects=())).reasons
    said = "what carries markers in the room moved by about "
    assert float(reason.split(said)[1].split()[0]) == pytest.approx(4.0, rel=0.2)
    assert "after sample 19" in reason


@pytest.mark.slow
def test_the_place_of_a_camera_on_a_flange_is_as_sure_as_it_says():
    scores = []
    for seed in range(100, 130):
        X_FC, data = recorded(np.random.default_rng(seed), poses=20)
        scores.append(error_of(calibrate_tree(data), X_FC)[1])
    assert 0.7 < np.mean(scores) < 1.4


@pytest.mark.slow
def test_a_camera_on_a_flange_is_placed_by_corners_nobody_knows_the_places_of():
    X_FC, data = recorded(np.random.default_rng(2), poses=30, known=False)
    first = np.arange(30) < 20
    found = calibrate_tree(data.select(first), test=data.select(~first))
    verdict = judge(found)
    assert verdict.status == "PASS", verdict.reasons
    error, score = error_of(found, X_FC)
    assert np.linalg.norm(error) < 3e-3
    assert score < 4.0


@pytest.mark.slow
def test_a_camera_that_stands_before_a_flange_is_placed_by_tags_on_it():
    rng = np.random.default_rng(4)
    sim = one_arm(4, joints=6, markers=4, poses=40, sensor="camera", joint_sigma=np.zeros(6))
    flange = TreeMotion.at(sim.tree, sim.readings_true)
    F = transform(flange.R_WL[5].transpose(2, 0, 1), flange.p_WL[5].T)
    F = F @ transform(rotation_from_vector(TURN * rng.normal(size=(40, 3))), np.zeros(3))
    data = replace(
        sim.data,
        joints=(LinkJoint("tcp", motion="flange", encoder_unit="pose"),),
        markers=tuple(replace(marker, on="tcp") for marker in sim.data.markers),
        readings=np.full((40, 1), np.nan),
        approach=None,
        flanges=np.hstack([F[:, :3, 3], rotation_vectors_of(F[:, :3, :3])])[:, None],
    )
    found = calibrate_tree(data.of_rows(data.observations.sensor == 0))
    off = found.tree.sensors[0].X_LA[:3, 3] - sim.tree.sensors[0].X_LA[:3, 3]
    assert np.linalg.norm(off) < 4e-3


def test_few_corners_nobody_knows_the_places_of_do_not_tell_a_hand_eye_calibration():
    _, data = recorded(np.random.default_rng(2), known=False)
    few = np.isin(data.observations.marker, [0, 1]) & (data.observations.pose < 3)
    with pytest.raises(DataError, match="or each of some tags from many poses"):
        calibrate_tree(data.of_rows(few))


@pytest.mark.slow
def test_the_lens_of_a_camera_that_moves_is_learned_before_corners_of_known_place():
    X_FC, data = recorded(np.random.default_rng(1), poses=30)
    first = np.arange(30) < 20
    data = replace(data, sensors=(replace(data.sensors[0], lens=None),))
    found = calibrate_tree(data.select(first), test=data.select(~first), effects=())
    assert judge(found).status == "PASS"
    assert found.tree.lenses["camera"].fx == pytest.approx(LENS.fx, rel=5e-3)
    assert np.linalg.norm(error_of(found, X_FC)[0]) < 2e-3


def test_few_corners_in_a_sample_do_not_tell_the_lens_of_a_camera_that_moves():
    _, data = recorded(np.random.default_rng(5))
    few = data.of_rows(data.observations.marker % 8 == 0)
    sensors = (replace(data.sensors[0], lens=None),)
    with pytest.raises(DataError, match="six markers or more at known places in a sample"):
        calibrate_tree(replace(few, sensors=sensors))


@pytest.mark.slow
def test_turns_about_one_axis_before_corners_leave_a_direction_open():
    _, data = recorded(np.random.default_rng(4), one_axis=True)
    verdict = judge(calibrate_tree(data))
    assert verdict.status == "FAIL"
    assert verdict.reasons[0].startswith("all turns of 'tcp' are about one axis")


def test_a_flange_that_hardly_turned_before_corners_is_refused():
    _, data = recorded(np.random.default_rng(3))
    with pytest.raises(DataError, match="the flange hardly turned"):
        calibrate_tree(replace(data, flanges=np.repeat(np.asarray(data.flanges)[:1], 25, axis=0)))

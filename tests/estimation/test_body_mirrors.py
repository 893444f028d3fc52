"""Mirrors that a moving head sees its hands in are planes in the body's world."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.joining import joined
from nico_selfmodel.errors import DataError, ModelError, NotIdentifiableError
from nico_selfmodel.estimation.judging import judge, to_json
from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
from nico_selfmodel.estimation.tree.mirrors.body_mirrors import calibrate_body_mirrors
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.estimation.tree.tree_result import body_model
from nico_selfmodel.estimation.tree.tree_setup import Wishes
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.self_model import ParameterCovariance
from nico_selfmodel.model.tree.body_model import load_body, save_body
from nico_selfmodel.model.tree.standing_mirror import StandingMirror
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import DEFAULT_MIRROR
from nico_selfmodel.sessions.mirrors.whole_nico_before_mirrors import session_before_mirrors
from nico_selfmodel.sessions.whole_body import whole_body_session
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

from .bodies_before_mirrors import deviation, knowing_body

CLEAN, THESIS = IMPERFECTIONS["clean"], IMPERFECTIONS["thesis"]
STIFF = replace(THESIS, sag=0.0, wobble=0.0, wobble_share=0.0)
PLACES = {"near": DEFAULT_MIRROR, "aside": Mirror.from_values([0.3, 0.0, 0.4])}


@pytest.fixture(scope="module")
def looked():
    """A Nico without noise before two mirrors, and the body that it is."""
    seen = session_before_mirrors(CLEAN, 0, 0, PLACES, poses=6, pixel_sigma=1e-3)
    return seen, knowing_body(CLEAN, 0, seen.data, 1e-3)


@pytest.mark.slow
def test_a_head_that_moves_sees_one_plane_in_the_world(looked):
    seen, body = looked
    found = calibrate_body_mirrors(seen.data, body)
    assert [mirror.name for mirror in found.model.tree.mirrors] == ["aside", "near"]
    for name, plane in seen.planes_true.items():
        learned = found.model.tree.mirror(name).plane
        assert np.linalg.norm(np.cross(learned.normal, plane.normal)) < 1e-5
        assert learned.offset == pytest.approx(plane.offset, abs=1e-5)
    assert not found.found.solution.outliers.any()


@pytest.mark.slow
@pytest.mark.parametrize("radius", [3.0, -3.0])
def test_glass_that_is_bent_is_called_so_before_a_head_that_moves(looked, radius):
    seen, body = looked
    glass = {"near": DEFAULT_MIRROR}
    plate = MirrorPlate(radius=radius)
    bent = session_before_mirrors(CLEAN, 0, 0, glass, poses=6, pixel_sigma=1e-3, plate=plate)
    near = seen.data.of_rows(np.isin(seen.data.observations.mirror, ["", "near"]))
    flat = calibrate_body_mirrors(near, body).found
    assert flat.flatness["near"].flat
    assert to_json(flat, judge(flat))["mirrors"]["near"]["flatness"]["flat"]
    found = calibrate_body_mirrors(bent.data, body).found
    assert found.flatness["near"].by_chance < 1e-9
    verdict = judge(found)
    assert verdict.status == "FAIL"
    assert any("mirror 'near' is not flat" in reason for reason in verdict.reasons)


def test_one_pose_does_not_tell_whether_a_glass_is_flat(looked):
    seen, body = looked
    pose = seen.data.observations.pose
    one = seen.data.select(np.arange(len(seen.data.sample)) == pose.min())
    found = calibrate_body_mirrors(one, body, name="before a mirror").found
    assert found.name == "before a mirror"
    assert set(found.flatness.values()) == {None}
    assert any("too few poses to test whether" in words for words in judge(found).warnings)


@pytest.mark.slow
@pytest.mark.parametrize("radius", [None, 5.0, -5.0])
def test_flat_glass_is_called_flat_and_five_metres_bent_by_bodies_that_sag(radius):
    chances = []
    for seed in range(8):
        plate = MirrorPlate(radius=radius)
        glass = {"glass": DEFAULT_MIRROR}
        seen = session_before_mirrors(THESIS, seed, 1, glass, poses=20, plate=plate)
        known = knowing_body(THESIS, seed, seen.data)
        chances.append(calibrate_body_mirrors(seen.data, known).found.flatness["glass"].by_chance)
    if radius is None:
        assert min(chances) > 1e-3
    else:
        assert max(chances) < 1e-3


@pytest.mark.slow
def test_wrong_rows_are_found_out(looked):
    seen, body = looked
    table = seen.data.observations
    rows = np.flatnonzero(table.mirror == "near")[::8]
    values = np.array(table.values)
    values[rows, :2] += [40.0, -30.0]
    spoilt = replace(seen.data, observations=replace(table, values=values))
    found = calibrate_body_mirrors(spoilt, body)
    assert set(rows) <= set(np.flatnonzero(found.found.solution.outliers))
    plane = seen.planes_true["near"]
    assert found.model.tree.mirror("near").plane.offset == pytest.approx(plane.offset, abs=1e-4)


def before_two(seed, off, poses=10):
    """Return a Nico before a mirror and before the same, which was moved, as one recording."""
    moved = Mirror.from_values(DEFAULT_MIRROR.values + off)
    first, second = (
        session_before_mirrors(STIFF, seed, k, {"glass": mirror}, poses=poses).data
        for k, mirror in enumerate((DEFAULT_MIRROR, moved))
    )
    return joined(first, second, "both"), int(first.sample.max())


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 4])
@pytest.mark.parametrize("off", [(0.0, 0.0, 0.005), (0.005, 0.0, 0.0)])
def test_a_mirror_that_was_moved_in_between_is_named_and_no_joint(seed, off):
    data, last = before_two(seed, np.array(off))
    verdict = judge(calibrate_body_mirrors(data, knowing_body(STIFF, seed, data)).found)
    assert verdict.status == "FAIL"
    assert verdict.reasons[0].startswith("mirror 'glass' moved by about ")
    assert f"after sample {last}: learn from one part alone" in verdict.reasons[0]
    assert not any("joint" in reason for reason in verdict.reasons)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "poses"), [(3, 10), (4, 10), (5, 10), (3, 6)])
def test_of_a_mirror_that_stood_still_nothing_is_said(seed, poses):
    data, _ = before_two(seed, np.zeros(3), poses)
    assert calibrate_body_mirrors(data, knowing_body(STIFF, seed, data)).found.meanwhile is None


@pytest.mark.slow
def test_sigmas_of_planes_are_honest_where_the_body_is_exact():
    total = []
    for seed in range(6):
        seen = session_before_mirrors(STIFF, seed, 0, {"glass": DEFAULT_MIRROR}, poses=8)
        found = calibrate_body_mirrors(seen.data, knowing_body(STIFF, seed, seen.data))
        chi, angle = deviation(found.model, "glass", seen.planes_true["glass"])
        total.append(chi)
        assert angle < np.radians(0.15)
    # 18 degrees of freedom: 1 and 99.9 % of the distribution.
    assert 7.0 < sum(total) < 42.3


@pytest.mark.slow
def test_errors_of_the_body_count_and_move_the_plane_as_their_covariance_says(looked):
    seen, body = looked
    names, sigma = ("right_eye_pan.rx", "left_wide_camera.ry"), 1e-3
    known = ParameterCovariance(names, sigma**2 * np.eye(2))
    data = seen.data.of_rows(np.isin(seen.data.observations.mirror, ["", "near"]))
    cameras = {sensor.name: 0.3 for sensor in body.tree.sensors}
    noisy = replace(body, noise={**dict.fromkeys(body.tree.joints, 6e-3), **cameras})
    exact = calibrate_body_mirrors(data, noisy).model
    found = calibrate_body_mirrors(data, replace(noisy, covariance=known)).model
    planes = found.tree.mirror("near").names
    assert found.covariance.names == (*names, *planes)
    C = found.covariance.matrix
    alone = exact.covariance.matrix
    assert (np.diag(C)[2:] >= np.diag(alone) * (1.0 - 1e-6)).all()
    parameters = TreeParameters(body.tree)
    for k, name in enumerate(names):
        values = parameters.values_of(body.tree)
        values[parameters.index[name]] += 0.1 * sigma
        moved = replace(noisy, covariance=known, tree=parameters.tree_of(values))
        other = calibrate_body_mirrors(data, moved).model.tree.mirror("near")
        step = found.tree.mirror("near").values_of(other.plane) - found.tree.mirror("near").values
        expected = C[2:, k] / C[k, k] * 0.1 * sigma
        assert step == pytest.approx(expected, abs=0.2 * np.abs(expected).max())


@pytest.mark.slow
def test_a_body_keeps_its_mirrors_in_its_file(looked, tmp_path):
    seen, body = looked
    near = seen.data.of_rows(np.isin(seen.data.observations.mirror, ["", "near"]))
    found = calibrate_body_mirrors(near, body, test=near, name="with a mirror")
    save_body(found.model, tmp_path / "body.yaml")
    again = load_body(tmp_path / "body.yaml")
    (one,), (two,) = again.tree.mirrors, found.model.tree.mirrors
    assert one.values.tolist() == two.values.tolist()
    assert one.facing.tolist() == two.facing.tolist()
    assert again.covariance.names[-3:] == Mirror.names_of("near")
    # Another mirror is learned beside it, the same one anew in its place.
    both = calibrate_body_mirrors(seen.data, again).model
    assert sorted(m.name for m in both.tree.mirrors) == ["aside", "near"]
    assert len(set(both.covariance.names)) == len(both.covariance.names) == 6
    document = to_json(found.found, judge(found.found))
    assert document["mirrors"]["near"]["poses"] == 6
    assert document["parameters"]["mirror.near.distance"]["free"]


def test_what_cannot_be_a_mirror_is_refused(looked):
    seen, body = looked
    data, table = seen.data, seen.data.observations
    with pytest.raises(ModelError, match="no cameras"):
        calibrate_body_mirrors(data, replace(body, tree=replace(body.tree, lenses={})))
    with pytest.raises(DataError, match="has no reflection"):
        calibrate_body_mirrors(data.of_rows(table.mirror == ""), body)
    few = data.of_rows(np.flatnonzero(table.mirror == "near")[:1])
    with pytest.raises(NotIdentifiableError, match="'near' is unobservable: 1 reflection does not"):
        calibrate_body_mirrors(few, body)
    strange = replace(data, markers=(replace(data.markers[0], name="tail"), *data.markers[1:]))
    with pytest.raises(DataError, match="both must be of one robot"):
        calibrate_body_mirrors(strange, body)
    with pytest.raises(DataError, match="was seen in mirrors: a body is learned from"):
        calibrate_tree(data.of_rows(table.mirror != ""))
    with pytest.raises(DataError, match="took part in reflections alone"):
        calibrate_tree(data)


def test_what_is_seen_behind_a_camera_is_no_mirror(looked):
    """Lines of sight the other way: of cameras turned about, their pictures upside down."""
    seen, body = looked
    turned = tuple(
        replace(s, X_LA=s.X_LA @ np.diag([-1.0, 1.0, -1.0, 1.0])) for s in body.tree.sensors
    )
    table = seen.data.observations
    middle = np.array([body.tree.lenses[sensor.name].cy for sensor in body.tree.sensors])
    values = np.array(table.values)
    values[:, 1] = 2.0 * middle[table.sensor] - values[:, 1]
    flipped = replace(seen.data, observations=replace(table, values=values))
    with pytest.raises(DataError, match="would be behind the cameras"):
        calibrate_body_mirrors(flipped, replace(body, tree=replace(body.tree, sensors=turned)))


def test_tilts_are_told_from_the_axis_that_a_mirror_faces_most():
    floor = StandingMirror("floor", Plane(np.array([0.0, 0.6, 0.8]), -0.3))
    assert floor.facing.tolist() == [0.0, 0.0, 1.0]
    assert np.linalg.norm(floor.values[:2]) == pytest.approx(np.arccos(0.8))
    again = floor.with_values(floor.values)
    assert again.plane.normal == pytest.approx(floor.plane.normal)
    assert again.plane.offset == -0.3
    with pytest.raises(ValueError, match="must have unit length"):
        StandingMirror("bent", Plane(np.array([0.0, 0.6, 0.7]), 1.0))


@pytest.fixture(scope="module")
def everything():
    """A recording without noise of room and hands, and of hands in a mirror."""
    direct = whole_body_session(CLEAN, 1, 0, looks=30, hands=30)
    mirrored = session_before_mirrors(CLEAN, 1, 1, {"glass": DEFAULT_MIRROR}, poses=8)
    return joined(direct, mirrored.data, "both"), mirrored.planes_true["glass"]


@pytest.mark.slow
def test_a_body_and_a_mirror_are_learned_together(everything):
    data, plane = everything
    found = calibrate_tree(data, effects=())
    chi, angle = deviation(body_model(found), "glass", plane)
    assert chi < 16.3
    assert angle < np.radians(0.02)
    pins = FixedParameters.from_text([f"mirror.glass.distance={plane.offset!r}"], [])
    held = calibrate_tree(data, effects=(), wishes=Wishes(pins))
    assert held.tree.mirror("glass").plane.offset == plane.offset


@pytest.mark.slow
@pytest.mark.parametrize("seed", [10, 15])
def test_ten_poses_place_a_mirror_before_a_body_that_learned_itself(seed):
    """What is wanted of the whole body: 0.1 deg and 0.5 mm, where the head is."""
    body = body_model(
        calibrate_tree(whole_body_session(THESIS, seed, 0, looks=60, hands=80), effects=())
    )
    seen = session_before_mirrors(THESIS, seed, 5, {"glass": DEFAULT_MIRROR}, poses=10)
    found, plane = calibrate_body_mirrors(seen.data, body).model, seen.planes_true["glass"]
    head, here = np.array([0.085, 0.0, 0.48]), found.tree.mirror("glass").plane
    assert deviation(found, "glass", plane)[1] < np.radians(0.1)
    assert here.distance_to(head) == pytest.approx(plane.distance_to(head), abs=5e-4)

"""Mirrors inferred from the hand's reflections: recovery, honesty, and what is said of bad data."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from nico_selfmodel.errors import DataError, NotIdentifiableError
from nico_selfmodel.estimation.judging import judge, to_json
from nico_selfmodel.estimation.mirrors.mirror import calibrate_mirrors, evaluate_mirrors
from nico_selfmodel.estimation.mirrors.mirror_cameras import fit_mirror_cameras
from nico_selfmodel.estimation.mirrors.mirror_findings import grazing_angles, mirror_findings
from nico_selfmodel.estimation.mirrors.mirror_solution import solve_mirrors, start_mirrors
from nico_selfmodel.estimation.mirrors.reflections import ReflectionNoise, Reflections
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig, reflected_projection
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel

from ..slow_rest import slow_rest
from .mirror_scenes import CHAIN, MIRROR, RIG, SECOND, angle_deg, body, poses, recording, together

mirrors = st.builds(
    lambda x, y, d: Mirror.from_values([*np.radians([x, y]), d]),
    st.floats(-15.0, 15.0),
    st.floats(-15.0, 15.0),
    st.floats(0.42, 0.7),
)


@pytest.mark.slow
@given(mirrors, st.integers(1, 8))
@settings(max_examples=12)
def test_a_mirror_is_found_exactly_from_any_number_of_exact_poses(mirror, count):
    data = recording(poses(count, 3, mirror), MirrorRig(RIG, mirror), sigma=0.0)
    found = calibrate_mirrors(data, body()).mirrors["glass"]
    assert_allclose(found.values, mirror.values, atol=1e-8)


@given(mirrors)
@settings(max_examples=15)
def test_the_closed_form_start_is_exact_without_noise(mirror):
    data = recording(poses(3, 4, mirror), MirrorRig(RIG, mirror), sigma=0.0)
    (start,) = start_mirrors(Reflections.from_dataset(data, body()))
    assert_allclose(start.values, mirror.values, atol=1e-7)


@pytest.mark.slow
@given(mirrors)
@settings(max_examples=8)
def test_one_camera_alone_finds_a_mirror_by_the_law_of_reflection(mirror):
    data = recording(poses(6, 5, mirror), MirrorRig(RIG, mirror), sigma=0.0)
    pixels = data.pixels.copy()
    pixels[:, 2:] = np.nan
    found = calibrate_mirrors(replace(data, pixels=pixels), body()).mirrors["glass"]
    assert_allclose(found.values, mirror.values, atol=1e-7)


def test_several_mirrors_are_learned_at_once():
    data = together(
        recording(poses(12, 1)),
        recording(poses(12, 2, SECOND), MirrorRig(RIG, SECOND), "wall", first=101),
    )
    test = recording(poses(12, 3), seed=1)
    found = calibrate_mirrors(data, body(), test=test)
    assert tuple(found.mirrors) == ("glass", "wall")
    assert angle_deg(found.mirrors["glass"]) < 0.2
    assert angle_deg(found.mirrors["wall"], SECOND) < 0.2
    assert tuple(found.model.mirrors) == ("glass", "wall")
    document = to_json(found, judge(found))
    true = np.degrees(MIRROR.angle_to(SECOND))
    assert document["angles_deg"]["glass, wall"] == pytest.approx(true, abs=0.3)


def test_mirrors_of_other_names_are_kept():
    known = body(mirrors={"wall": SECOND})
    found = calibrate_mirrors(recording(poses(5)), known, name="twice").model
    assert tuple(found.mirrors) == ("wall", "glass")
    assert found.name == "twice"
    assert found.mirrors["wall"] is SECOND


def test_what_was_known_of_a_replaced_plane_is_forgotten():
    names = (*Mirror.names_of("glass"), "left.fx", *Mirror.names_of("wall"))
    known = body(mirrors={"glass": SECOND, "wall": SECOND})
    known = replace(known, covariance=ParameterCovariance(names, 1e-6 * np.eye(7)))
    found = calibrate_mirrors(recording(poses(8)), known)
    assert found.model.covariance.names == ("left.fx", *Mirror.names_of("wall"))
    assert angle_deg(found.model.mirrors["glass"]) < 0.3


def test_an_arm_in_another_world_gives_the_same_mirror(tmp_path):
    data = recording(poses(10))
    moved = np.eye(4)
    moved[:3, 3] = [0.3, -0.1, 0.2]
    rig = RIG.moved(np.linalg.inv(moved))
    model = body()
    elsewhere = replace(
        model,
        table=replace(model.dh, X_W0=moved @ model.dh.X_W0),
        cameras={"left": rig.left, "right": rig.right},
    )
    here, there = (calibrate_mirrors(data, m).mirrors["glass"] for m in (model, elsewhere))
    assert_allclose(there.values, here.values, atol=1e-7)


def test_poses_seen_by_one_camera_count_too():
    data = recording(poses(12, 2))
    pixels = data.pixels.copy()
    pixels[2:8, 2:] = np.nan
    pixels[8:, :2] = np.nan
    found = calibrate_mirrors(replace(data, pixels=pixels), body())
    assert angle_deg(found.mirrors["glass"]) < 0.3
    assert len(found.train.distances_px) == 14
    assert len(found.train.distances) == 2


def test_outliers_are_named_and_do_no_harm():
    data = recording(poses(20, 3))
    pixels = data.pixels.copy()
    pixels[[4, 11]] += [25.0, -10.0, 25.0, -10.0]
    found = calibrate_mirrors(replace(data, pixels=pixels), body())
    assert data.sample[found.solution.outliers].tolist() == [5, 12]
    assert angle_deg(found.mirrors["glass"]) < 0.2
    spoiled = calibrate_mirrors(replace(data, pixels=pixels), body(), loss="none")
    assert angle_deg(spoiled.mirrors["glass"]) > 2.0 * angle_deg(found.mirrors["glass"])


@pytest.mark.slow
@pytest.mark.parametrize("covariance", [False, True])
def test_the_covariance_of_a_plane_is_honest(covariance):
    rng, scores = np.random.default_rng(8), []
    model = body(covariance)
    for seed in range(30):
        data = recording(poses(10, seed), sigma=0.3, play=np.radians(0.2), seed=seed)
        inliers = _misled(model, rng) if covariance else model
        noise = ReflectionNoise(0.3, np.radians(0.2) / np.sqrt(3.0))
        reflections = Reflections.from_dataset(data, inliers)
        (mirror,) = solve_mirrors(reflections, (MIRROR,), noise).mirrors
        miss = mirror.values - MIRROR.values
        scores.append(miss @ np.linalg.solve(mirror.covariance, miss) / 3.0)
        assert mirror.normal_sigma > 0.0
    assert 0.6 < np.mean(scores) < 1.6


def _misled(model: SelfModel, rng: np.random.Generator) -> SelfModel:
    """Return the body as wrong as its covariance says."""
    names, matrix = model.covariance.names, model.covariance.matrix
    draw = rng.normal(size=len(names)) * np.sqrt(np.diag(matrix))
    values = model.parameters.values.copy()
    sides = dict(zip(model.rig.names, model.rig.values, strict=True))
    for name, off in zip(names, draw, strict=True):
        if name in sides:
            sides[name] += off
        else:
            values[model.parameters.names.index(name)] += off
    arm = model.parameters.with_values(values)
    v = np.array(list(sides.values()))
    left = Camera.from_values(v[:10], RIG.left.image_size)
    pose = transform(rotation_from_vector(v[20:23]), v[23:])
    right = Camera.from_values(v[10:20], RIG.right.image_size, pose)
    cameras = {"left": left, "right": right}
    return replace(model, table=arm.table, servo_map=arm.servos, cameras=cameras)


@pytest.mark.slow
def test_an_uncertain_arm_makes_an_uncertain_mirror_that_more_poses_do_not_cure():
    data = recording(poses(40))
    plain = calibrate_mirrors(data, body())
    shared = calibrate_mirrors(data, body(True))
    assert shared.mirrors["glass"].normal_sigma > 2.0 * plain.mirrors["glass"].normal_sigma
    few = calibrate_mirrors(data.select(np.arange(10)), body(True))
    assert shared.mirrors["glass"].normal_sigma > 0.5 * few.mirrors["glass"].normal_sigma
    assert any("no covariance" in word for word in judge(plain).warnings)
    assert not any("no covariance" in word for word in judge(shared).warnings)


def test_a_part_of_the_arm_that_nothing_tells_does_not_hide_what_lengths_are_uncertain_by():
    # A bearing's place that moves no point may be known to kilometres: beside its variance those
    # of lengths and angles are rounding.
    data, model = recording(poses(40)), body(True)
    sigma = np.append(np.sqrt(np.diag(model.covariance.matrix)), 7e3)
    alike = 0.3 * np.outer(sigma, sigma) + 0.7 * np.diag(sigma**2)
    names = (*model.covariance.names, "left.p1")
    unseen = replace(data, pixels=np.where(np.arange(4) < 2, np.nan, data.pixels))
    bodies = [
        replace(model, covariance=ParameterCovariance(names[:k], alike[:k, :k]))
        for k in (len(names) - 1, len(names))
    ]
    plain, beside = (calibrate_mirrors(unseen, one).mirrors["glass"] for one in bodies)
    assert_allclose(beside.covariance, plain.covariance, rtol=1e-6)


@pytest.mark.slow
def test_mirrors_learned_through_one_body_err_as_their_common_covariance_says():
    rng, model = np.random.default_rng(9), body(True)
    data = together(
        recording(poses(30, 1), sigma=0.1),
        recording(poses(30, 2, SECOND), MirrorRig(RIG, SECOND), "wall", first=101, sigma=0.1),
    )
    off, apart, both = [], [], []
    for _ in range(40):
        found = calibrate_mirrors(data, _misled(model, rng))
        errors = np.concatenate([found.mirrors["glass"].values - MIRROR.values,
                                 found.mirrors["wall"].values - SECOND.values])  # fmt: skip
        planes = found.covariance.matrix[-6:, -6:]
        assert found.covariance.names[-6:] == (
            *Mirror.names_of("glass"),
            *Mirror.names_of("wall"),
        )
        off.append(errors)
        both.append(errors @ np.linalg.solve(planes, errors) / 6.0)
        alone = np.kron(np.eye(2), np.ones((3, 3))) * planes
        apart.append(errors @ np.linalg.solve(alone, errors) / 6.0)
    assert 0.6 < np.mean(both) < 1.5
    # What both have alike is as large as what either has by itself.
    seen = np.corrcoef(np.transpose(off))
    said = planes / np.sqrt(np.outer(np.diag(planes), np.diag(planes)))
    assert np.abs(said[:3, 3:]).max() > 0.5
    assert_allclose(seen[:3, 3:], said[:3, 3:], atol=0.35)


@pytest.mark.slow
def test_how_mirrors_err_with_the_cameras_is_known():
    model = body(True)
    found = calibrate_mirrors(recording(poses(30), sigma=0.0), model)
    known, step = found.covariance, 1e-4
    turn = rotation_from_vector([0.0, step, 0.0])
    X_LR = RIG.right.X_WC.copy()
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn @ X_LR[:3, :3], X_LR[:3, 3]
    wrong = replace(model, cameras={"left": RIG.left, "right": RIG.right.at(pose)})
    moved = calibrate_mirrors(recording(poses(30), sigma=0.0), wrong).mirrors["glass"]
    by_turn = (moved.values - found.mirrors["glass"].values) / step
    row = known.names.index("right.pose.ry")
    said = known.matrix[-3:, row] / known.matrix[row, row]
    assert_allclose(said, by_turn, rtol=0.15, atol=0.02 * np.abs(by_turn).max())


def test_one_pose_is_enough_and_says_how_little_it_is():
    found = calibrate_mirrors(recording(poses(1, 7)), body())
    assert angle_deg(found.mirrors["glass"]) < 3.0
    assert judge(found).status == "NOT_EVALUATED"
    assert any("rests on one pose" in word for word in judge(found).warnings)
    assert found.cross_validation is None
    assert found.flatness["glass"] is None
    assert found.mirrors["glass"].normal_sigma > np.radians(0.03)


@pytest.mark.slow
def test_poses_at_one_point_are_said_to_be_so():
    q = np.repeat(poses(1, 7), 12, axis=0) + 1e-4 * np.random.default_rng(0).normal(size=(12, 4))
    found = calibrate_mirrors(recording(q), body())
    assert any("of one point" in word for word in judge(found).warnings)
    spread = calibrate_mirrors(recording(poses(12, 7)), body())
    assert found.mirrors["glass"].normal_sigma > spread.mirrors["glass"].normal_sigma


def test_direct_views_called_reflections_are_recognised():
    q = poses(200, 1)
    direct = recording(q, RIG, sigma=0.3)
    seen = np.isfinite(direct.pixels).all(axis=1)
    with pytest.raises(DataError, match="show the hand itself"):
        calibrate_mirrors(direct.select(seen), body())


def test_reflections_without_a_mirrors_name_are_recognised():
    with pytest.raises(
        DataError, match=r"fit reflections in a mirror 4\d\d mm from the left camera"
    ):
        calibrate_mirrors(recording(poses(10), mirror=""), body())
    q = poses(200, 1)
    direct = recording(q, RIG, mirror="")
    with pytest.raises(DataError, match="its pixels show the hand directly"):
        calibrate_mirrors(direct.select(np.isfinite(direct.pixels).all(axis=1)), body())
    nonsense = np.random.default_rng(0).uniform(50, 400, (200, 4))
    nonsense = replace(direct, pixels=nonsense).select(np.arange(30))
    with pytest.raises(DataError, match="neither the hand nor its reflection"):
        calibrate_mirrors(nonsense, body())
    with pytest.raises(DataError, match="no pixels"):
        calibrate_mirrors(replace(direct, pixels=None), body())


def test_rows_whose_mirror_was_forgotten_are_listed():
    data = together(recording(poses(10)), recording(poses(4, 9), mirror="", seed=5, first=50))
    found = calibrate_mirrors(data, body())
    assert found.misplaced.tolist() == [50, 51, 52, 53]
    assert any("samples without a mirror's name" in word for word in judge(found).warnings)


def test_a_hand_behind_the_mirror_is_refused():
    # A thing seen nearer to the cameras than the hand is no reflection of it.
    q = poses(60, 2)
    p = CHAIN.forward(q)
    far = p[:, 2] > 0.2
    data = recording(q[far])
    data = replace(data, pixels=RIG.project(0.5 * p[far]))
    with pytest.raises(DataError, match="the hand lies behind mirror 'glass'"):
        calibrate_mirrors(data.select(np.isfinite(data.pixels).all(axis=1)), body())


def test_a_hand_behind_the_plane_in_some_poses_fails():
    mirror = Mirror.from_values([0.0, 0.0, 0.20])
    q = np.random.default_rng(1).uniform(-0.6, 0.6, (400, 4))
    behind = mirror.in_front_by(CHAIN.forward(q)) < -0.01
    front = mirror.in_front_by(CHAIN.forward(q)) > 0.03
    chosen = np.concatenate([q[front][:20], q[behind][:4]])
    # The projection knows no cheirality here: what a wrong arm would make of real pixels.
    pixels = reflected_projection(RIG.cameras, mirror.values, CHAIN.forward(chosen)).pixels
    data = replace(recording(chosen), pixels=pixels)
    verdict = judge(calibrate_mirrors(data, body(), loss="none"))
    assert verdict.status == "FAIL"
    assert any("behind mirror 'glass'" in reason for reason in verdict.reasons)


def test_a_mirror_seen_edge_on_fails():
    mirror = Mirror.from_values([np.radians(88.0), 0.0, 0.012])
    rng = np.random.default_rng(0)
    q = rng.uniform(-0.8, 0.8, (20000, 4))
    p = CHAIN.forward(q)
    shown = MirrorRig(RIG, mirror).project(p)
    sight = mirror.reflect(p)
    grazing = np.abs(sight @ mirror.normal) / np.linalg.norm(sight, axis=1)
    usable = np.isfinite(shown).all(axis=1) & (grazing < np.sin(np.radians(4.0)))
    away = mirror.in_front_by(p) > 0.0
    assert (usable & away).sum() >= 3
    data = recording(q[usable & away][:12], MirrorRig(RIG, mirror), sigma=0.0)
    model = body()
    reflections = Reflections.from_dataset(data, model)
    noise = ReflectionNoise(0.3, 0.0)
    solution = solve_mirrors(reflections, (mirror,), noise)
    good = calibrate_mirrors(recording(poses(10)), model)
    edge_on = replace(good, solution=solution)
    assert np.degrees(np.median(grazing_angles(edge_on))) < 5.0
    assert any("seen edge-on" in found.text for found in mirror_findings(edge_on))


def test_a_mirror_that_moved_between_recordings_fails():
    moved = Mirror.from_values([*np.radians([8.0, -9.0]), 0.49])
    test = recording(poses(20, 5, moved), MirrorRig(RIG, moved), seed=3)
    verdict = judge(calibrate_mirrors(recording(poses(20)), body(), test=test))
    assert verdict.status == "FAIL"
    assert "significantly above" in verdict.reasons[0]


def test_held_out_poses_decide_and_a_bound_is_kept():
    data, test = recording(poses(15)), recording(poses(30, 6), seed=2)
    found = calibrate_mirrors(data, body(), test=test)
    assert judge(found).status == "PASS"
    assert judge(found, require_test_px=2.0).status == "PASS"
    verdict = judge(found, require_test_px=0.05)
    assert verdict.status == "FAIL"
    assert "required at most 0.05 px" in verdict.reasons[0]
    without = calibrate_mirrors(data, body())
    assert "nothing was held out" in judge(without, require_test_px=1.0).reasons[0]


def test_an_arm_that_changed_since_it_was_learned_fails():
    model = body()
    slipped = model.servos.offset + np.array([0.0, 0.15, 0.0, 0.0])
    servos = replace(model.servos, offset=slipped)
    verdict = judge(calibrate_mirrors(recording(poses(20)), replace(model, servo_map=servos)))
    assert verdict.status == "FAIL"


def test_a_mirror_that_was_not_learned_cannot_be_evaluated():
    with pytest.raises(DataError, match="reflections in glass, which was not learned"):
        evaluate_mirrors(recording(poses(3)), body(), {"wall": SECOND})
    found = evaluate_mirrors(recording(poses(30)), body(), {"glass": MIRROR})
    assert found.pixel_statistics.mean < 0.6


def test_the_thesis_cameras_find_the_reflected_cameras():
    data = recording(poses(20), sigma=0.0)
    cameras = fit_mirror_cameras(Reflections.from_dataset(data, body()))
    virtual = MirrorRig(RIG, MIRROR).virtual
    for found, true in zip(cameras.cameras, virtual.cameras, strict=True):
        assert_allclose(found.X_WC, true.X_WC, atol=1e-6)
    shown = cameras.evaluate(Reflections.from_dataset(data, body()))
    assert shown.distances_px.max() < 1e-6
    assert shown.distances.max() < 1e-6
    with pytest.raises(NotIdentifiableError, match="too few for two cameras"):
        fit_mirror_cameras(Reflections.from_dataset(data.select([0, 1, 2]), body()))


@pytest.mark.slow
def test_one_plane_beats_two_free_cameras_where_poses_are_few():
    ours, theirs = [], []
    for seed in range(5):
        data = recording(poses(5, seed), sigma=0.3, play=np.radians(0.3), seed=seed)
        test = recording(poses(50, 50 + seed), sigma=0.3, play=np.radians(0.3), seed=100 + seed)
        found = calibrate_mirrors(data, body(), test=test)
        ours.append(found.test.distances_px.mean())
        cameras = fit_mirror_cameras(found.solution.reflections)
        theirs.append(cameras.evaluate(found.test.reflections).distances_px.mean())
    assert np.mean(ours) < 0.9 * np.mean(theirs)


def test_the_document_is_plain_data_with_everything_that_it_promises():
    data, test = recording(poses(15)), recording(poses(30, 6), seed=2)
    found = calibrate_mirrors(data, body(), test=test)
    document = to_json(found, judge(found))
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert document["train"]["n"] == 30
    assert document["test"]["n"] == 60
    assert set(document["test"]["pixels"]) == {"mean", "sd", "rms", "median", "p95", "max"}
    entry = document["parameters"]["mirror.glass.distance"]
    assert entry["free"]
    assert entry["unit"] == "m"
    assert entry["value"] == pytest.approx(0.48, abs=5e-3)
    assert document["parameters"]["mirror.glass.normal_z"]["free"] is False
    assert document["mirrors"]["glass"]["flatness"]["flat"] is True
    assert document["mirrors"]["glass"]["free_cameras"]["n"] == 30
    few = calibrate_mirrors(data.select([0, 1]), body())
    assert to_json(few, judge(few))["mirrors"]["glass"]["free_cameras"] is None


def test_reflections_of_one_mirror_can_be_taken_out():
    data = together(recording(poses(4)), recording(poses(3, 2), mirror="wall", first=10))
    both = Reflections.from_dataset(data, body(True))
    wall = both.of("wall")
    assert len(wall) == 3
    assert wall.mirrors == ("wall",)
    assert wall.sample.tolist() == [10, 11, 12]
    assert wall.shared.by_parameter.shape[0] == 3


@pytest.mark.parametrize("kind", slow_rest(["fisheye", "rational"]))
def test_wide_cameras_find_a_mirror_and_say_how_surely(kind):
    bends = {"fisheye": {"k1": 0.03, "k2": -0.01}, "rational": {"k1": 0.6, "k4": 0.8}}[kind]
    inside = {"fx": 500.0, "fy": 500.0, "cx": RIG.left.cx, "cy": RIG.left.cy}
    wide = [
        Camera(**inside, image_size=c.image_size, lens=kind, **bends, X_WC=c.X_WC)
        for c in RIG.cameras
    ]
    rig = StereoRig(*wide)
    model = body(cameras={"left": rig.left, "right": rig.right})
    seen = MirrorRig(rig, MIRROR)
    exact = recording(poses(5, 3), seen, sigma=0.0)
    assert calibrate_mirrors(exact, model).mirrors["glass"].values == pytest.approx(
        MIRROR.values, abs=1e-7
    )
    found = calibrate_mirrors(recording(poses(20, 4), seen), model).mirrors["glass"]
    off = found.values - MIRROR.values
    assert np.sqrt(np.mean(off**2 / np.diag(found.covariance))) < 2.5
    shown, h = reflected_projection(rig.cameras, MIRROR.values, CHAIN.forward(poses(4))), 1e-6
    for i in range(3):
        step = h * (np.arange(3) == i)
        ends = [
            reflected_projection(rig.cameras, MIRROR.values + s, CHAIN.forward(poses(4))).pixels
            for s in (step, -step)
        ]
        assert_allclose(
            shown.by_mirror[:, :, i], (ends[0] - ends[1]) / (2.0 * h), rtol=1e-5, atol=1e-3
        )

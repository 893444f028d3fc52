"""Any body by any sensors: one adjustment finds it, says how surely, and what contradicts it."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_dataset import BodyDataset, ObservationTable
from nico_selfmodel.dataset.body.body_folder import load_body_dataset, save_body_dataset
from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.dataset.body.sensors import MarkerInfo, SensorInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.judging import judge, result_of
from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
from nico_selfmodel.estimation.tree.body_prediction import predict_body
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.guesses.hand_eye import HandEye, only_axis
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_result import body_model
from nico_selfmodel.estimation.tree.tree_setup import Description, Wishes
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vectors_of
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.tree.body_model import load_body, save_body
from nico_selfmodel.model.tree.tree_motion import TreeMotion

from .simulated_trees import LENS, one_arm, turned, two_arms

KNOWN = [
    ("left_tag0", "left_tag1"),
    ("left_tag2", "left_tag3"),
    ("right_tag0", "right_tag1"),
    ("right_tag2", "right_tag4"),
    ("left_tag1", "left_tag5"),
]


def seen_by_first(tree, q):
    """Markers at poses in the first sensor's frame. Shape (markers, 3, N)."""
    motion = TreeMotion.at(tree, q)
    X = inverse(tree.sensors[0].X_LA)
    p = np.stack([motion.pose_of(marker)[1] for marker in tree.markers])
    return np.einsum("ij,mjn->min", X[:3, :3], p) + X[None, :3, 3, None]


def error_mm(learned, true, seed=0):
    q = np.random.default_rng(seed).uniform(-0.9, 0.9, size=(40, len(true.joints)))
    apart = seen_by_first(learned, q) - seen_by_first(true, q)
    return 1e3 * np.linalg.norm(apart, axis=1).mean()


def floor_of(calibration, data, true):
    """The same adjustment started at the truth."""
    residuals = TreeResiduals(TreeObservations.of(data), TreeParameters(true))
    setup = calibration.setup
    problem = TreeProblem(residuals, setup.free, setup.priors, alike=setup.alike)
    return problem.refine(residuals.parameters.values_of(true))


def from_first_camera(tree):
    """The same body with its first camera as the world."""
    X = inverse(tree.sensors[0].X_LA)
    X_PJ = np.where((tree.parent < 0)[:, None, None], X @ tree.X_PJ, tree.X_PJ)
    return replace(
        tree, X_PJ=X_PJ, sensors=tuple(replace(s, X_LA=X @ s.X_LA) for s in tree.sensors)
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, pytest.param(3, marks=pytest.mark.slow)])
def test_two_arms_are_found_from_nothing_but_tags_in_two_cameras(seed):
    sim = two_arms(seed, distances=KNOWN)
    train, test = sim.data.split(0.25, seed)
    found = calibrate_tree(train, test=test, seed=seed)
    true = from_first_camera(sim.tree)
    assert found.agreeing >= 2
    assert found.solution.cost == pytest.approx(floor_of(found, train, true).cost, rel=1e-5)
    assert error_mm(found.tree, true) < 4.0
    assert judge(found).status == "PASS"
    assert found.setup.scale_from == "ruler (known distances)"


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["fisheye", pytest.param("rational", marks=pytest.mark.slow)])
def test_two_arms_are_found_by_wide_cameras(kind, tmp_path):
    bends = {"fisheye": {"k1": 0.03, "k2": -0.01}, "rational": {"k1": 0.8, "k2": 0.1, "k4": 1.1}}
    wide = Camera(420.0, 420.0, 320.0, 240.0, (640, 480), lens=kind, **bends[kind])
    sim = two_arms(0, camera=wide, distances=KNOWN)
    found = calibrate_tree(sim.data, seed=0)
    true = from_first_camera(sim.tree)
    assert found.solution.cost == pytest.approx(floor_of(found, sim.data, true).cost, rel=1e-5)
    assert error_mm(found.tree, true) < 6.0
    save_body(body_model(found), tmp_path / "body.yaml")
    lenses = load_body(tmp_path / "body.yaml").tree.lenses
    assert {lens.lens for lens in lenses.values()} == {kind}
    save_body_dataset(sim.data, tmp_path / "data")
    again = load_body_dataset(tmp_path / "data")
    assert again.sensors[0].camera.values == pytest.approx(wide.values)


@pytest.mark.slow
def test_mislabelled_tags_are_left_out_and_named():
    sim = two_arms(1, distances=KNOWN)
    table, rng = sim.data.observations, np.random.default_rng(1)
    wrong = rng.choice(np.flatnonzero(table.other < 0), 25, replace=False)
    marker = table.marker.copy()
    marker[wrong] = marker[wrong] // 7 * 7 + (marker[wrong] + rng.integers(1, 7, 25)) % 7
    mixed = replace(sim.data, observations=replace(table, marker=marker))
    found = calibrate_tree(mixed, seed=1)
    assert found.solution.outliers[wrong].mean() > 0.9
    assert np.delete(found.solution.outliers, wrong).sum() <= 3
    assert error_mm(found.tree, from_first_camera(sim.tree)) < 4.0
    assert any("check their labels" in warning for warning in judge(found).warnings)


@pytest.mark.slow
def test_a_scale_that_nothing_tells_is_named():
    sim = two_arms(0, torso=0, poses=40)
    found = calibrate_tree(sim.data)
    assert found.setup.scale_from is None
    assert result_of(found).unobservable[0].startswith("scale: nothing in the data tells lengths")
    assert judge(found).status == "FAIL"
    baseline = np.linalg.norm(found.tree.sensors[1].X_LA[:3, 3])
    assert 0.1 < baseline < 10.0
    # No length is known, to nobody who uses the body either; what a camera sees of it is.
    model, q = body_model(found), np.random.default_rng(1).uniform(-0.5, 0.5, (5, 12))
    place = predict_body(model, q)
    assert (place.sigma > 0.5 * np.linalg.norm(place.p_FM, axis=2) / np.sqrt(3.0)).all()
    parameters = TreeParameters(model.tree)
    linear = TreeResiduals(TreeObservations.of(sim.data), parameters).linear(parameters.start)
    J = linear.J[[parameters.index[name] for name in model.covariance.names]]
    known = np.sqrt(np.einsum("ir,ij,jr->r", J, model.covariance.matrix, J))
    assert np.median(known) < 1.0  # px
    lengths = [n for n in found.uncertainty.names if n.endswith((".x", ".y", ".z"))]
    sigma = dict(zip(found.uncertainty.names, found.uncertainty.sigma, strict=True))
    assert np.isinf([sigma[name] for name in lengths]).all()


@pytest.mark.slow
def test_sensors_that_saw_nothing_stand_for_nothing():
    # A tracker that was listed and never used stood for the world: a division by zero.
    sim = two_arms(0, torso=0, tags_each=3, poses=25)
    told = {"image_size": (640, 480), "lens": dict(LENS.named_values)}
    idle = (SensorInfo("tracker", "points"), SensorInfo("third", "camera", **told))
    table = sim.data.observations
    moved = replace(table, sensor=table.sensor + len(idle))
    found = calibrate_tree(
        replace(sim.data, sensors=(*idle, *sim.data.sensors), observations=moved), effects=()
    )
    assert found.setup.world == "camera1"
    assert result_of(found).unobservable[0].startswith("scale: nothing in the data tells lengths")
    baseline = np.linalg.norm(found.tree.sensors[3].X_LA[:3, 3])
    assert 0.1 < baseline < 10.0


@pytest.mark.slow
def test_a_baseline_that_the_user_fixes_holds_the_scale():
    sim = two_arms(0, torso=0, poses=40)
    X = from_first_camera(sim.tree).sensors[1].X_LA
    pins = FixedParameters({f"camera2.{a}": float(v) for a, v in zip("xyz", X[:3, 3], strict=True)})
    found = calibrate_tree(sim.data, wishes=Wishes(pins))
    longest = "xyz"[int(np.argmax(np.abs(X[:3, 3])))]
    assert found.setup.scale_from == f"camera2.{longest}"
    assert found.tree.sensors[1].X_LA[:3, 3] == pytest.approx(X[:3, 3])
    assert error_mm(found.tree, from_first_camera(sim.tree)) < 6.0


@pytest.mark.slow
def test_one_length_that_the_user_fixes_holds_the_scale():
    sim = two_arms(0, torso=0, poses=40)
    X = from_first_camera(sim.tree).sensors[1].X_LA
    longest = "xyz"[int(np.argmax(np.abs(X[:3, 3])))]
    value = float(X["xyz".index(longest), 3])
    found = calibrate_tree(sim.data, wishes=Wishes(FixedParameters({f"camera2.{longest}": value})))
    assert found.setup.scale_from == f"camera2.{longest}"
    assert found.solution.converged
    assert judge(found).status == "NOT_EVALUATED"
    assert found.tree.sensors[1].X_LA[:3, 3] == pytest.approx(X[:3, 3], abs=5e-3)
    assert error_mm(found.tree, from_first_camera(sim.tree)) < 6.0


@pytest.mark.slow
def test_error_bars_speak_of_the_parameters_that_are_told():
    found = calibrate_tree(two_arms(0, distances=KNOWN, poses=40).data)
    assert found.parameters.values_of(found.tree) == pytest.approx(found.values, abs=1e-9)
    residuals = TreeResiduals(TreeObservations.of(found.data), found.parameters)
    problem = TreeProblem(residuals, found.setup.free, found.setup.priors, found.solution.noise)
    again = problem.refine(found.values, found.solution.outliers)
    one, two = (np.linalg.norm(s.whitened, axis=0) for s in (found.solution, again))
    assert one == pytest.approx(two, rel=0.02)


def described(sim, seed, degrees, millimetres):
    """The robot with every joint frame off, nothing known of tags and cameras."""
    rng = np.random.default_rng(seed)
    X_PJ = np.stack([X @ turned(rng, degrees, millimetres) for X in sim.tree.X_PJ])
    nothing = {
        key: tuple(replace(item, X_LA=np.eye(4)) for item in getattr(sim.tree, key))
        for key in ("markers", "sensors")
    }
    sigma = np.radians(degrees) / np.sqrt(3.0), 1e-3 * millimetres / np.sqrt(3.0)
    return Description(replace(sim.tree, X_PJ=X_PJ, **nothing), *sigma)


@pytest.mark.slow
def test_a_description_that_is_off_is_corrected_and_says_by_how_much():
    sim = two_arms(2, poses=40, distances=KNOWN)
    found = calibrate_tree(sim.data, description=described(sim, 2, 2.0, 10.0))
    assert error_mm(found.tree, sim.tree) < 5.0
    before = found.described.of_kind("camera")
    after = found.train.of_kind("camera")
    assert np.median(before) > 5.0 * np.median(after)
    changes = result_of(found).details["changes"]
    assert set(changes) == set(sim.tree.joints)
    assert 0.5 < np.median([change["turn_deg"] for change in changes.values()]) < 3.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 2])
def test_one_camera_and_ten_poses_are_enough_for_a_robot_that_is_described(seed):
    sim = one_arm(seed, joints=6, markers=5, poses=10, sensor="camera", joint_sigma=1e-3)
    data = replace(
        sim.data,
        sensors=sim.data.sensors[:1],
        observations=sim.data.observations.select(sim.data.observations.sensor == 0),
    )
    tree = replace(sim.tree, sensors=sim.tree.sensors[:1], lenses={"left": LENS})
    one = replace(sim, tree=tree)
    description = described(one, seed, 0.5, 1.0)
    found = calibrate_tree(data, description=description)
    residuals = TreeResiduals(TreeObservations.of(data), found.parameters)
    setup = found.setup
    problem = TreeProblem(residuals, setup.free, setup.priors, alike=setup.alike)
    floor = problem.refine(found.parameters.values_of(tree))
    assert found.solution.cost == pytest.approx(floor.cost, rel=1e-4)


def test_one_camera_cannot_tell_a_body_from_nothing():
    sim = one_arm(0, sensor="camera", markers=3)
    data = replace(
        sim.data,
        sensors=sim.data.sensors[:1],
        observations=sim.data.observations.select(sim.data.observations.sensor == 0),
    )
    with pytest.raises(DataError, match="one camera alone cannot tell a body from nothing"):
        calibrate_tree(data)


@pytest.mark.slow
def test_a_joint_that_slips_is_named_and_its_poses_stay():
    sim = one_arm(4, joints=5, markers=3, poses=100, slip=(2, 0.12, np.radians(1.2)))
    found = calibrate_tree(sim.data)
    slipped = found.solution.slipped
    assert slipped[:, 2].sum() >= 6
    assert np.delete(slipped, 2, axis=1).sum() <= 2
    assert np.degrees(found.solution.noise.joint[0]) == pytest.approx(0.2, rel=0.25)
    assert any("the encoder of 'j3' was off" in warning for warning in judge(found).warnings)


@pytest.mark.slow
def test_sensors_of_two_kinds_tell_one_body_together():
    sim = two_arms(5, distances=KNOWN, poses=40)
    q = sim.readings_true
    motion = TreeMotion.at(sim.tree, q)
    rng = np.random.default_rng(5)
    tag = sim.tree.marker_index("left_tag0")
    seen = motion.pose_of(sim.tree.markers[tag])[1].T + 2e-4 * rng.normal(size=(40, 3))
    old = sim.data.observations
    count = len(sim.data.sensors)
    tracked = ObservationTable(
        *(np.concatenate([getattr(old, key), new]) for key, new in (
            ("pose", np.arange(40)),
            ("sensor", np.full(40, count)),
            ("marker", np.full(40, tag)),
            ("other", np.full(40, -1)),
            ("values", np.hstack([seen, np.full((40, 3), np.nan)])),
        ))
    )  # fmt: skip
    sensors = (*sim.data.sensors, SensorInfo("tracker", "points"))
    found = calibrate_tree(replace(sim.data, sensors=sensors, observations=tracked))
    assert found.setup.world == "tracker"
    alone = calibrate_tree(sim.data)
    true = from_first_camera(sim.tree)
    assert error_mm(found.tree, true) < 1.2 * error_mm(alone.tree, true)


def hand_eye_poses(rng, count, *, turns=None):
    """Poses of a flange, and of a target on it in a sensor's frame, with 0.1 deg and 0.5 mm."""
    X, Z = (transform(rotation_from_vector(rng.normal(size=3)), rng.normal(size=3)) for _ in "xz")
    w = rng.normal(size=(count, 3)) if turns is None else rng.normal(size=(count, 1)) * turns
    F = transform(rotation_from_vector(w), 0.4 * rng.normal(size=(count, 3)))
    noise = transform(
        rotation_from_vector(np.radians(0.1) * rng.normal(size=(count, 3))),
        5e-4 * rng.normal(size=(count, 3)),
    )
    return X, Z, F, inverse(Z) @ F @ X @ noise


def flange_dataset(F, M):
    def six(poses):
        return np.hstack([poses[:, :3, 3], rotation_vectors_of(poses[:, :3, :3])])

    count = len(F)
    table = ObservationTable(
        np.arange(count), *(np.zeros(count, int),) * 2, np.full(count, -1), six(M)
    )
    return BodyDataset(
        "flange",
        (LinkJoint("tcp", motion="flange", encoder_unit="pose"),),
        (MarkerInfo("target", "tcp"),),
        (SensorInfo("camera", "poses"),),
        np.arange(count),
        np.full((count, 1), np.nan),
        table,
        six(F)[:, None],
    )


@pytest.mark.slow
def test_a_hand_eye_calibration_is_as_good_as_its_poses_and_says_so():
    turned_by, apart, scores = [], [], []
    for seed in range(30):
        X, _, F, M = hand_eye_poses(np.random.default_rng(seed), 20)
        found = calibrate_tree(flange_dataset(F, M))
        off = inverse(X) @ found.tree.markers[0].X_LA
        turned_by.append(np.degrees(np.linalg.norm(rotation_vectors_of(off[:3, :3]))))
        error = found.tree.markers[0].X_LA[:3, 3] - X[:3, 3]
        apart.append(1e3 * np.linalg.norm(error))
        index = [found.uncertainty.names.index(f"target.{a}") for a in "xyz"]
        C = found.uncertainty.covariance[np.ix_(index, index)]
        scores.append(error @ np.linalg.solve(C, error) / 3.0)
    assert np.median(turned_by) <= 0.05
    assert np.median(apart) <= 0.4
    assert 0.6 < np.mean(scores) < 1.5


def test_turns_about_one_axis_leave_the_place_along_it_open():
    rng = np.random.default_rng(3)
    axis = np.array([0.0, 0.6, 0.8])
    _, _, F, M = hand_eye_poses(rng, 20, turns=axis)
    verdict = judge(calibrate_tree(flange_dataset(F, M)))
    assert verdict.status == "FAIL"
    words = (
        "all turns of 'tcp' are about one axis, (0.00, 0.60, 0.80) in its base: how far 'target'"
    )
    assert verdict.reasons[0].startswith(f"{words} is shifted along it cannot be told from")
    assert "turned about a second axis" in verdict.reasons[0]
    two = F.copy()
    two[:3, :3, :3] = two[:3, :3, :3] @ rotation_from_vector([0.5, 0.0, 0.0])
    assert only_axis(F) == pytest.approx(axis, abs=0.01)
    assert only_axis(two) is None


def test_what_a_flange_that_turns_on_the_spot_about_one_axis_leaves_open_is_told():
    rng = np.random.default_rng(4)
    X, Z, F, _ = hand_eye_poses(rng, 20, turns=np.array([1.0, 0.0, 0.0]))
    F[:, :3, 3] = [0.3, 0.1, 0.5]
    reasons = judge(calibrate_tree(flange_dataset(F, inverse(Z) @ F @ X))).reasons
    assert any("all turns of 'tcp' are about one axis, (1.00, " in reason for reason in reasons)
    assert any("turned about it" in reason for reason in reasons)


@pytest.mark.parametrize("seed", range(8))
def test_the_shifts_of_a_flange_tell_how_a_target_is_turned_about_the_one_axis_of_its_turns(seed):
    X, _, F, M = hand_eye_poses(np.random.default_rng(seed), 20, turns=np.array([0.0, 0.6, 0.8]))
    found = HandEye.from_poses(F, M)
    off = rotation_vectors_of(found.X[:3, :3].T @ X[:3, :3])
    assert np.degrees(np.linalg.norm(off)) < 0.2
    assert found.misfit(F, M) < 0.02


@pytest.mark.parametrize("seed", [1, 12])
def test_turns_about_one_axis_are_not_taken_for_turns_that_were_written_otherwise(seed):
    F, M = hand_eye_poses(np.random.default_rng(seed), 30, turns=np.array([0.0, 0.6, 0.8]))[2:]
    reasons = judge(calibrate_tree(flange_dataset(F, M))).reasons
    assert reasons[0].startswith("all turns of 'tcp' are about one axis, (0.00, 0.60, 0.80) in its")


def test_a_flange_that_hardly_turned_is_refused():
    _, _, F, M = hand_eye_poses(np.random.default_rng(0), 5, turns=np.array([0.0, 0.0, 0.01]))
    with pytest.raises(DataError, match="the flange hardly turned"):
        calibrate_tree(flange_dataset(F, M))


@pytest.mark.parametrize("poses", [1, 2])
def test_too_few_poses_of_a_flange_are_counted(poses):
    _, _, F, M = hand_eye_poses(np.random.default_rng(0), poses)
    with pytest.raises(
        DataError, match=rf"too few poses of the flange \({poses} beside those held"
    ):
        calibrate_tree(flange_dataset(F, M))


@pytest.mark.slow
def test_cameras_that_contradict_each_other_are_named_first():
    sim = two_arms(0, distances=KNOWN, poses=40)
    table = sim.data.observations
    second = table.sensor == 1
    # The second camera's pictures are each of the pose after.
    pose = np.where(second, (table.pose + 1) % 40, table.pose)
    shifted = replace(sim.data, observations=replace(table, pose=pose))
    with pytest.raises(DataError, match="two cameras contradict each other"):
        calibrate_tree(shifted)


@pytest.mark.slow
def test_a_name_that_does_not_exist_is_refused_with_those_there_are():
    pins = FixedParameters({"camara2.x": 0.5})
    with pytest.raises(ValueError, match="no parameter 'camara2"):
        calibrate_tree(two_arms(0, distances=KNOWN, poses=30).data, wishes=Wishes(pins))


@pytest.mark.slow
@pytest.mark.parametrize("markers", [1, 2, 3, 7])
def test_error_bars_hold_however_many_markers_share_a_pose(markers):
    scores = [_score(seed, markers) for seed in range(100, 160)]
    assert 0.85 < np.mean(scores) < 1.2


def _score(seed, markers):
    """NEES / 3 of the first marker at fresh poses, mean of 20."""
    sim = one_arm(seed, joints=4 + seed % 4, markers=markers, poses=60 + seed % 60)
    found = calibrate_tree(sim.data)
    q = np.random.default_rng(seed + 10**6).uniform(-1.2, 1.2, size=(20, len(sim.tree.joints)))
    table = ObservationTable(
        np.arange(20), *(np.zeros(20, int),) * 2, np.full(20, -1),
        np.hstack([np.zeros((20, 3)), np.full((20, 3), np.nan)]),
    )  # fmt: skip
    fresh = replace(
        sim.data, sample=np.arange(20), readings=q, flanges=None, approach=None, observations=table
    )
    linear = TreeResiduals(TreeObservations.of(fresh), found.parameters).linear(found.values)
    true = seen_by_first(sim.tree, q)[0].T
    error = linear.r.reshape(20, 3) - true
    columns = [found.parameters.index[name] for name in found.uncertainty.names]
    J = linear.J[columns].T.reshape(20, 3, -1)
    C = J @ found.uncertainty.covariance @ np.swapaxes(J, 1, 2)
    return np.mean(np.sum(error * np.linalg.solve(C, error[:, :, None])[:, :, 0], axis=1)) / 3.0

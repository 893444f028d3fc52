"""Boards whose pose nobody reads tell lenses, cameras and mirrors, beside arms or alone."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from nico_selfmodel.dataset.body.body_dataset import BodyDataset, ObservationTable
from nico_selfmodel.dataset.body.body_folder import load_body_dataset, save_body_dataset
from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.dataset.body.sensors import MarkerInfo, SensorInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.judging import judge, result_of
from nico_selfmodel.estimation.noise.pose_groups import PoseGroups
from nico_selfmodel.estimation.noise.pose_noise import PoseNoise, PoseWhitening
from nico_selfmodel.estimation.tree.boards.board_pose import board_poses_seen
from nico_selfmodel.estimation.tree.boards.poses_apart import PosesApart
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_errors import beside_boards, errors_of
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_result import body_model
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.tree.body_model import load_body, save_body
from nico_selfmodel.model.tree.free_joints import body_alone

from .boards_in_hand import CORNERS, LENS, before_two_cameras, recorded, shape_mm
from .simulated_trees import two_arms

WALL = Plane(np.array([-0.6, 0.1, -np.sqrt(1.0 - 0.37)]), 1.1)


@pytest.fixture(scope="module")
def mirrored():
    return before_two_cameras(3, mirrors=(WALL,))


@pytest.fixture(scope="module")
def learned(mirrored):
    return calibrate_tree(mirrored.data)


@pytest.mark.slow
def test_exact_corners_give_back_lenses_cameras_mirrors_and_boards():
    held = before_two_cameras(0, sigma=0.0, mirrors=(WALL,))
    found = calibrate_tree(held.data)
    assert found.train.by_row().max() < 1e-4
    for name, camera in zip(("camera0", "camera1"), held.cameras, strict=True):
        assert_allclose(found.tree.lenses[name].values, camera.values, rtol=1e-4, atol=1e-4)
    assert_allclose(found.tree.sensors[1].X_LA, held.cameras[1].X_WC, atol=1e-6)
    assert_allclose(found.tree.mirror("m0").plane.normal, WALL.normal, atol=1e-6)
    assert_allclose(found.posed.X_flange[:, 0], held.X_WB, atol=1e-5)


def test_two_cameras_of_unknown_lens_and_a_mirror_are_learned_with_honest_sigmas(mirrored, learned):
    table = result_of(learned).parameters
    true = dict(zip([f"camera0.{n}" for n in ("fx", "fy")], LENS.values[:2], strict=True))
    X = mirrored.cameras[1].X_WC
    true |= {f"camera1.{n}": x for n, x in zip("xyz", X[:3, 3], strict=True)}
    for name, value in true.items():
        assert abs(table[name].value - value) < 4.0 * table[name].sigma
        assert 0.0 < table[name].sigma < (1.0 if "f" in name else 1e-3)
    assert learned.solution.noise.sensor == pytest.approx(0.2, rel=0.1)
    assert not learned.solution.outliers.any()


WIDE = {
    "fisheye": {"k1": 0.02, "k2": -0.01, "k3": 0.003, "k4": -0.0005},
    "rational": {"k1": 0.8, "k2": 0.12, "k3": 0.002, "k4": 1.1, "k5": 0.3, "k6": 0.02},
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", WIDE)
def test_boards_in_mirrors_tell_wide_lenses(kind):
    lens = Camera(430.0, 428.0, 645.0, 472.0, (1280, 960), lens=kind, **WIDE[kind])
    near = ([-0.35, -0.3, 0.25], [0.5, 0.3, 0.6])
    held = before_two_cameras(5, 40, 0.1, mirrors=(WALL,), lens=lens, places=near)
    found = calibrate_tree(held.data)
    assert found.tree.lenses["camera0"].lens != "polynomial"
    mirror = found.tree.mirror("m0")
    assert np.degrees(np.arccos(mirror.plane.normal @ WALL.normal)) < 0.03
    assert abs(mirror.plane.offset - WALL.offset) < 5e-4
    assert_allclose(found.tree.sensors[1].X_LA, held.cameras[1].X_WC, atol=1e-3)
    assert found.solution.noise.sensor == pytest.approx(0.1, rel=0.1)


def test_where_boards_are_does_not_move_with_where_the_search_for_them_begins(mirrored, learned):
    moved = learned.parameters.tree_of(learned.values)
    aside = replace(
        moved, X_PJ=moved.X_PJ @ transform(rotation_from_vector([0.1, 0.2, 0]), [1, 2, 3])
    )
    residuals = TreeResiduals(TreeObservations.of(mirrored.data), TreeParameters(aside))
    r = residuals.residuals(residuals.parameters.values_of(aside))
    assert_allclose(r, learned.train.residuals, atol=1e-6)


def test_what_is_whitened_moves_as_its_derivatives_say(mirrored, learned):
    problem = TreeProblem(
        TreeResiduals(learned.train.observations, learned.parameters), learned.setup.free, {}
    )
    x, whitening = learned.values, problem._boards_free(learned.values)
    block_at = problem.program(x, whitening)
    for name in ("camera0.fx", "camera1.ry", "mirror.m0.tilt_x"):
        i = problem.free_names.index(name)
        step = 1e-4 * max(1.0, abs(x[problem.columns[i]]) * 1e-3)
        ends = []
        for way in (step, -step):
            y = x[problem.columns].copy()
            y[i] += way
            ends.append(block_at.residuals(0, y))
        slope = problem.whitened_at(learned.solution)[0][:, i]
        numeric = (ends[0] - ends[1]).ravel() / (2.0 * step)
        assert np.linalg.norm(numeric - slope) < 2e-2 * np.linalg.norm(slope)


def test_eliminating_poses_of_boards_leaves_what_whitening_with_them_free_leaves(learned):
    seen, noise = learned.train.observations, learned.solution.noise
    linear = TreeResiduals(seen, learned.parameters).linear(learned.values)
    sigma = noise.sensor[seen.noise_group]
    free = [learned.parameters.index[name] for name in sorted(learned.setup.free)]
    left = PosesApart.of(seen, np.ones(len(sigma), dtype=bool)).eliminated(linear, sigma)
    whole = PoseGroups(seen.sample_visit, np.ones(len(sigma), dtype=bool), 1)
    by_joint = (linear.by_joint / sigma[:, None])[:, None]
    loose = np.ones((whole.poses, by_joint.shape[2]), dtype=bool)
    whitening = PoseWhitening(whole, by_joint, PoseNoise(1.0, noise.joint), loose)
    r, J = whitening.whiten((linear.r / sigma)[None], (linear.J[free] / sigma)[:, None])
    a, b = left.J[free] / sigma, J[:, 0]
    size = np.sqrt(np.diag(a @ a.T))
    assert_allclose((a @ a.T) / np.outer(size, size), (b @ b.T) / np.outer(size, size), atol=1e-6)
    assert_allclose((a @ (left.r / sigma)) / size, (b @ r[0]) / size, atol=1e-6)
    assert left.taken.sum() == pytest.approx(6 * whole.poses)


def test_cameras_that_share_their_noise_have_one_standard_deviation(mirrored):
    sensors = tuple(replace(sensor, noise="pair") for sensor in mirrored.data.sensors)
    seen = TreeObservations.of(replace(mirrored.data, sensors=sensors))
    assert seen.noise_groups == ("pair",)
    assert TreeObservations.of(mirrored.data).noise_groups == ("camera0", "camera1")
    assert SensorInfo.from_mapping(sensors[0].to_mapping(), "here").noise == "pair"


def test_a_mirror_beside_what_it_shows_needs_no_other(learned):
    mirror = learned.tree.mirror("m0")
    assert np.degrees(np.arccos(mirror.plane.normal @ WALL.normal)) < 0.1
    assert abs(mirror.plane.offset - WALL.offset) < 2e-3


def test_corners_named_as_they_appear_are_no_reflection(mirrored):
    table = mirrored.data.observations
    turned = np.arange(35).reshape(5, 7)[:, ::-1].ravel()
    marker = np.where(table.mirror == "", table.marker, turned[table.marker])
    swapped = mirrored.data.of_rows(np.arange(len(table)))
    swapped = replace(swapped, observations=replace(table, marker=marker))
    with pytest.raises(DataError, match="named as they are on the board"):
        calibrate_tree(swapped)


@pytest.mark.slow
def test_corners_of_another_place_are_left_out_and_named(mirrored):
    table = mirrored.data.observations
    values = table.values.copy()
    values[[5, 300, 600]] += [40.0, -30.0, np.nan, np.nan, np.nan, np.nan]
    found = calibrate_tree(replace(mirrored.data, observations=replace(table, values=values)))
    assert np.flatnonzero(found.solution.outliers).tolist() == [5, 300, 600]


def test_a_body_keeps_cameras_and_mirrors_and_no_board(mirrored, learned, tmp_path):
    save_body(body_model(learned), tmp_path / "body.yaml")
    body = load_body(tmp_path / "body.yaml")
    assert body.tree.joints == ()
    assert body.tree.markers == ()
    assert [m.name for m in body.tree.mirrors] == ["m0"]
    errors = errors_of(body.tree, mirrored.data)
    assert np.sqrt(np.mean(errors.by_row() ** 2)) == pytest.approx(0.28, rel=0.1)
    save_body_dataset(mirrored.data, tmp_path / "data")
    again = load_body_dataset(tmp_path / "data")
    assert again.free_joints == (0,)
    assert_allclose(again.observations.values[:, :2], mirrored.data.observations.values[:, :2])


def test_a_planar_board_allows_two_poses_and_a_solid_one_only_one():
    X = transform(rotation_from_vector([0.5, 0.2, 0.1]), [0.05, -0.02, 0.6])
    rays = apply(X, CORNERS)
    found = board_poses_seen(CORNERS, rays / np.linalg.norm(rays, axis=1, keepdims=True))
    assert_allclose(found[0], X, atol=1e-9)
    assert np.linalg.norm(found[1][:3, :3] - X[:3, :3]) > 0.5
    solid = CORNERS + [[0.0, 0.0, 0.05 * (k % 3)] for k in range(len(CORNERS))]
    rays = apply(X, solid)
    found = board_poses_seen(solid, rays / np.linalg.norm(rays, axis=1, keepdims=True))
    assert_allclose(found, [X, X], atol=1e-6)
    assert board_poses_seen(CORNERS[:3], rays[:3]) is None


def with_boards(sim, boards=10, seed=0):
    """Two arms whose cameras saw a board, too, lenses not told."""
    rng, data = np.random.default_rng(seed), sim.data
    cameras = [sim.tree.camera(f"camera{k}") for k in (1, 2)]
    middle = [0.3, 0.0, 0.3]
    facing = transform(rotation_from_vector([0.0, -np.pi / 2, 0.0]), middle)
    turns = rotation_from_vector(rng.normal(0.0, 0.35, (boards, 3)))
    X_WB = facing @ transform(turns, rng.uniform(-0.12, 0.12, (boards, 3)))
    first, pose, sensor, marker, values = len(data.markers), [], [], [], []
    for v, X in enumerate(X_WB):
        for s, camera in enumerate(cameras):
            u = camera.project(apply(X, 2.0 * CORNERS))
            inside = ((u > 0.0) & (u < np.array(camera.image_size))).all(axis=1)
            seen = np.flatnonzero(inside)
            pose += [len(data.sample) + v] * len(seen)
            sensor += [s] * len(seen)
            marker += (first + seen).tolist()
            noise = 0.3 * rng.normal(size=(len(seen), 2))
            values.append(np.hstack([u[seen] + noise, np.full((len(seen), 4), np.nan)]))
    old, n = data.observations, len(data.joints)
    corners = [
        MarkerInfo(f"c{i}", "board", tuple(p)) for i, p in enumerate((2.0 * CORNERS).tolist())
    ]
    table = ObservationTable(
        np.append(old.pose, pose), np.append(old.sensor, sensor), np.append(old.marker, marker),
        np.append(old.other, np.full(len(pose), -1)), np.vstack([old.values, *values]),
    )  # fmt: skip
    readings = np.vstack([data.readings, np.zeros((boards, n))])
    return BodyDataset(
        "arms and boards",
        (*data.joints, LinkJoint("board", motion="free", encoder_unit="pose")),
        (*data.markers, *corners),
        tuple(
            SensorInfo(s.name, s.kind, image_size=s.image_size, sigma=s.sigma) for s in data.sensors
        ),
        np.arange(len(data.sample) + boards),
        np.hstack([readings, np.full((len(readings), 1), np.nan)]),
        table,
    )


def test_samples_that_show_no_board_are_predicted_wherever_it_is():
    sim = two_arms(2, torso=0, poses=4)
    data = with_boards(sim, boards=2)
    tree = beside_boards(sim.tree, data)
    parameters, arms = TreeParameters(tree), TreeParameters(sim.tree)
    alone = TreeObservations.of(data.select(data.sample < 4))
    r = TreeResiduals(alone, parameters).residuals(parameters.values_of(tree))
    seen = TreeObservations.of(sim.data)
    same = TreeResiduals(seen, arms).residuals(arms.values_of(sim.tree))
    assert_allclose(r, same, atol=1e-9)


@pytest.mark.slow
def test_arms_are_learned_with_lenses_and_places_that_boards_tell():
    sim = two_arms(2, torso=0, poses=60)
    found = calibrate_tree(with_boards(sim), effects=())
    assert found.setup.scale_from == "markers at known places"
    assert shape_mm(body_alone(found.tree), sim.tree) < 3.0
    for name, lens in sim.tree.lenses.items():
        assert found.tree.lenses[name].fx == pytest.approx(lens.fx, abs=3.0)
    assert {"camera1.fx", "camera2.k1"} <= set(found.uncertainty.names)
    body = body_model(found)
    assert "board" not in body.tree.joints
    assert judge(found).status != "FAIL"


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"parent": "arm"}, "its parent must be 'world'"),
        ({"xyz": None}, "their places there must be known"),
        ({"order": True}, "list such joints after all others"),
        ({"sensor": "board"}, "nothing tells where they are"),
    ],
)
def test_what_nothing_could_tell_of_a_free_joint_is_refused(change, match):
    board = LinkJoint("board", change.get("parent", "world"), "free", "pose")
    joints = (board, LinkJoint("arm")) if change.get("order") else (LinkJoint("arm"), board)
    place = change.get("xyz", (0.0, 0.0, 0.0))
    camera = SensorInfo("camera", "camera", change.get("sensor", "world"), image_size=(64, 48))
    table = ObservationTable([0], [0], [0], [-1], [[1.0, 2.0, *[np.nan] * 4]])
    with pytest.raises(DataError, match=match):
        BodyDataset(
            "board", joints, (MarkerInfo("c", "board", place),), (camera,), [0],
            np.zeros((1, 2)), table,
        )  # fmt: skip


def test_a_board_of_which_too_little_is_seen_is_named(mirrored):
    table = mirrored.data.observations
    few = (table.pose != 4) | ((table.marker < 3) & (table.mirror == ""))
    with pytest.raises(DataError, match=r"sample 4 .* shows . markers of 'board'"):
        calibrate_tree(mirrored.data.of_rows(few))


def test_a_camera_that_saw_no_board_has_no_lens(mirrored):
    table = mirrored.data.observations
    with pytest.raises(DataError, match="nothing tells the lens of camera 'camera1'"):
        calibrate_tree(mirrored.data.of_rows(table.sensor == 0))


# ------------------------------------------------------------------------------- the real corner


@pytest.fixture(scope="module")
def corner(real_data_folder):
    path = real_data_folder / "planar_mirrors" / "derived_corners.npz"
    if not path.is_file():
        pytest.skip(f"no {path}")
    known = np.load(path)
    pixels = np.full((11, 1, 3, 42, 2), np.nan)
    for v in range(11):
        for way, key in enumerate("DLR"):
            if f"{v + 1:02d}_{key}" in known.files:
                pixels[v, 0, way] = known[f"{v + 1:02d}_{key}"]
    # Squares of 30 mm stand for any: angles and pixels do not depend on it.
    return recorded(0.03 * known["model"], pixels, ("left", "right"), (3264, 1470))


@pytest.mark.slow
@pytest.mark.real_data
def test_a_real_corner_of_mirrors_is_right_angled(corner):
    found = calibrate_tree(corner)
    one, other = (found.tree.mirror(name).plane.normal for name in ("left", "right"))
    assert found.solution.converged
    assert np.sqrt(np.mean(found.train.by_row() ** 2)) <= 0.56
    assert 89.9 <= np.degrees(np.arccos(one @ other)) <= 90.1
    assert found.solution.outliers.sum() <= 4


@pytest.mark.slow
@pytest.mark.real_data
def test_real_reflections_are_predicted_where_boards_are_seen_once_more(corner):
    train, test = corner.split(0.3, 0)
    found = calibrate_tree(train, test=test)
    assert np.sqrt(np.mean(found.test.by_row() ** 2)) <= 1.0
    assert inverse(found.tree.sensors[0].X_LA) == pytest.approx(np.eye(4))

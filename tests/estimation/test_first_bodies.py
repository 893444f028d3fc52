"""First bodies from sensors that share little: cameras in a chain, trackers of other markers."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_dataset import ObservationTable
from nico_selfmodel.dataset.body.joining import joined
from nico_selfmodel.dataset.body.sensors import MarkerInfo, SensorInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.judging import judge, result_of
from nico_selfmodel.estimation.tree.guesses.point_guess import SeenPoints, body_from_points
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_setup import Description
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.tree.body_tree import Attached
from nico_selfmodel.model.tree.tree_motion import TreeMotion

from .simulated_trees import LENS, looking_at, observed, one_arm, turned, two_arms

SIGMA = {"camera": 0.3, "points": 1e-4}
JOINT = np.radians(0.05)


def filmed(seed, eyes, poses=50, markers=6, lens=LENS, told=True):
    """An arm before any number of cameras."""
    made = one_arm(seed, markers=markers, poses=poses, sensor="camera", joint_sigma=JOINT)
    names = [f"camera{k}" for k in range(len(eyes))]
    known = dict(lens.named_values) if told else None
    sensors = tuple(SensorInfo(n, "camera", image_size=LENS.image_size, lens=known) for n in names)
    places = tuple(
        Attached(n, -1, looking_at(np.array(eye), [0.0, 0.0, 0.3]))
        for n, eye in zip(names, eyes, strict=True)
    )
    tree = replace(made.tree, sensors=places, lenses=dict.fromkeys(names, lens))
    rng = np.random.default_rng((seed, 3))
    q = made.readings_true
    data = observed(
        tree, made.data.joints, made.data.markers, sensors, q, rng, joint_sigma=JOINT, sigma=SIGMA
    )
    return tree, data, q


def tracked(tree, data, q, seed, eye=(0.7, 1.5, -0.4)):
    """What a tracker, which stands somewhere, sees of a ball that no camera sees."""
    ball = Attached("ball", len(tree.joints) - 1, transform(np.eye(3), [0.03, 0.04, 0.06]))
    at = Attached("laser", -1, looking_at(np.array(eye), [0.0, 0.0, 0.2]))
    alone = replace(tree, markers=(ball,), sensors=(at,), lenses={})
    rng = np.random.default_rng((seed, 4))
    info = MarkerInfo("ball", data.joints[-1].name), SensorInfo("laser", "points")
    seen = observed(alone, data.joints, info[:1], info[1:], q, rng, joint_sigma=JOINT, sigma=SIGMA)
    return joined(data, seen, "both"), at, ball


RING = [(1.2 * np.cos(a), 1.2 * np.sin(a), 0.5) for a in np.radians([0, 40, 80, 120])]


def apart(found, tree, first):
    """How far cameras are from where they should be to the first one [m], scale taken off."""

    def seen(t):
        X = np.linalg.inv(next(s.X_LA for s in t.sensors if s.name == first))
        return {s.name: (X @ s.X_LA)[:3, 3] for s in t.sensors if s.name != first}

    true, now = seen(tree), seen(found.tree)
    size = np.linalg.norm(list(true.values())) / np.linalg.norm(list(now.values()))
    return max(np.linalg.norm(true[n] - size * now[n]) for n in true)


@pytest.mark.slow
def test_markers_by_which_no_joint_is_searched_are_placed_once_joints_are_known():
    made = one_arm(4, markers=40, poses=30, joint_sigma=0.0, sigma={"points": 1e-5})
    table = made.data.observations
    seen = SeenPoints(table.pose, table.marker, table.values[:, :3])
    found = body_from_points(made.data, made.tree, seen, seed=0)
    there = TreeMotion.at(found, made.data.si_readings).points(table.marker, table.pose)
    off = np.linalg.norm(there - seen.p_WM, axis=1)
    each = [np.median(off[table.marker == m]) for m in range(40)]
    assert max(each) < 3e-4


@pytest.mark.slow
def test_cameras_that_share_tags_with_a_neighbour_alone_are_placed_one_by_one():
    tree, data, _ = filmed(1, RING)
    table = data.observations
    # Each camera sees two tags of the one before it, and two that the next one sees.
    shown = np.isin(table.marker - 2 * (table.sensor % 3), (0, 1, 2, 3)) | (table.sensor == 3)
    shown &= (table.sensor != 3) | np.isin(table.marker, (4, 5))
    found = calibrate_tree(data.of_rows(shown), effects=())
    assert apart(found, tree, "camera0") < 0.01


@pytest.mark.slow
def test_a_camera_that_looked_at_other_poses_is_placed_by_the_body():
    tree, data, _ = filmed(2, RING[:3])
    table = data.observations
    late = table.pose >= 30
    shown = np.where(table.sensor == 2, late, ~late)
    found = calibrate_tree(data.of_rows(shown), effects=())
    assert apart(found, tree, "camera0") < 0.02


def test_a_camera_that_nothing_places_is_named():
    _, data, _ = filmed(2, RING[:3])
    table = data.observations
    # What it sees nobody else sees.
    shown = np.where(table.sensor == 2, table.marker == 5, table.marker < 5)
    with pytest.raises(DataError, match="camera 'camera2' saw 0 markers whose places are known"):
        calibrate_tree(data.of_rows(shown), effects=())


@pytest.mark.slow
@pytest.mark.parametrize("cameras", [1, 2])
def test_a_tracker_whose_ball_no_camera_sees_is_placed_by_how_the_body_moves(cameras):
    tree, seen, q = filmed(4, RING[:cameras])
    data, at, ball = tracked(tree, seen, q, 4)
    found = calibrate_tree(data, effects=())
    assert found.setup.world == "laser"
    assert judge(found).status == "NOT_EVALUATED"
    X_SW = np.linalg.inv(at.X_LA)
    for sensor in tree.sensors:
        true = X_SW @ sensor.X_LA
        now = next(s.X_LA for s in found.tree.sensors if s.name == sensor.name)
        assert np.linalg.norm(true[:3, 3] - now[:3, 3]) < 0.01
    p = TreeMotion.at(tree.with_markers((ball,)), q[:5]).pose_of(ball)[1]
    there = TreeMotion.at(found.tree, q[:5])
    (mine,) = [m for m in found.tree.markers if m.name == "ball"]
    moved = X_SW[:3, :3] @ p + X_SW[:3, 3:]
    assert there.pose_of(mine)[1] == pytest.approx(moved, abs=2e-3)


def described(tree, seed, degrees=1.0, millimetres=5.0):
    rng = np.random.default_rng((seed, 8))
    off = np.array([X @ turned(rng, degrees, millimetres) for X in tree.X_PJ])
    markers = tuple(replace(m, X_LA=np.eye(4)) for m in tree.markers)
    sensors = tuple(replace(s, X_LA=np.eye(4)) for s in tree.sensors)
    return Description(replace(tree, X_PJ=off, markers=markers, sensors=sensors))


@pytest.mark.slow
@pytest.mark.parametrize("f", [450.0, 1500.0])
def test_a_robot_that_is_described_tells_the_lens_of_the_camera_that_looks_at_it(f):
    lens = Camera(f, f, 330.0, 230.0, (640, 480), k1=-0.1, k2=0.02)
    eye = np.array(RING[0]) * (f / 600.0) ** 0.7
    tree, data, _ = filmed(5, [eye], lens=lens, told=False)
    found = calibrate_tree(data, description=described(tree, 5), effects=())
    learned, names = found.tree.lenses["camera0"], found.uncertainty.names
    for part in ("fx", "fy", "cx", "cy", "k1"):
        sigma = found.uncertainty.sigma[names.index(f"camera0.{part}")]
        assert abs(getattr(learned, part) - getattr(lens, part)) < 4.0 * sigma
    assert np.median(found.train.of_kind("camera")) < 0.8


@pytest.mark.slow
def test_a_tracker_of_the_same_tags_tells_lenses():
    tree, seen, q = filmed(6, RING[:2], told=False)
    rng = np.random.default_rng(6)
    tracker = replace(tree, sensors=(Attached("tracker", -1),), lenses={})
    info = (SensorInfo("tracker", "points"),)
    at = observed(tracker, seen.joints, seen.markers, info, q, rng, joint_sigma=JOINT, sigma=SIGMA)
    table = ObservationTable(
        *(np.concatenate([getattr(t, key) for t in (at.observations, replace(
            seen.observations, sensor=seen.observations.sensor + 1))])
          for key in ("pose", "sensor", "marker", "other", "values"))
    )  # fmt: skip
    data = replace(seen, sensors=(*info, *seen.sensors), observations=table)
    found = calibrate_tree(data, effects=())
    for camera in ("camera0", "camera1"):
        assert found.tree.lenses[camera].fx == pytest.approx(LENS.fx, rel=0.02)


@pytest.mark.slow
def test_one_camera_tells_an_arm_that_no_tracker_sees_beside_one_that_it_does():
    seed = 2
    made = two_arms(seed, poses=70)
    eyes = replace(made.tree, sensors=made.tree.sensors[:1])
    rng = np.random.default_rng((seed, 5))
    q, infos, how = made.readings_true, made.data, {"joint_sigma": JOINT, "sigma": SIGMA}
    seen = observed(eyes, infos.joints, infos.markers, infos.sensors[:1], q, rng, **how)
    data, _, _ = tracked(eyes, seen, q, seed)
    train, test = data.split(0.25, seed=0)
    found = calibrate_tree(train, test=test, effects=())
    assert judge(found).status == "PASS", judge(found).reasons
    assert found.agreeing == 2
    assert found.noise["camera1"] < 0.33
    assert result_of(found).test.statistics("px").median < 1.5


def test_nothing_tells_the_lens_of_a_camera_that_looks_at_an_unknown_robot():
    _, data, _ = filmed(5, RING[:2], told=False)
    with pytest.raises(DataError, match="a robot description, a tracker that"):
        calibrate_tree(data)
    blind = tuple(replace(s, image_size=None) for s in data.sensors)
    with pytest.raises(DataError, match="'camera0' has no 'image_size'"):
        calibrate_tree(replace(data, sensors=blind))

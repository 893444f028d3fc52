"""Trackers that an arm carries before things whose places in the room nobody knows."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.sensors import MarkerInfo, SensorInfo
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.tree.guesses.carried_trackers import with_carried_tracker
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_setup import standing_tag
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.model.tree.body_tree import Attached
from nico_selfmodel.model.tree.tree_motion import TreeMotion

from ..slow_rest import slow_rest
from .simulated_trees import Simulated, assembled, observed, one_arm, turned
from .test_description_errors import described

JOINT = np.radians(0.05)


def before_tags(seed, kind, poses=30, count=4):
    """Return a robot of six joints whose hand carries a tracker of tags in the room, 1 m away."""
    sim = one_arm(seed, joints=6, poses=2)
    rng = np.random.default_rng((seed, 1))
    sensors = (SensorInfo("eye in hand", kind, "j6"),)
    infos = tuple(MarkerInfo(f"t{k}", "world") for k in range(count))
    middle = transform(turned(rng, 60.0, 0.0)[:3, :3], [0.9, -0.6, 0.7])
    tags = [Attached(one.name, -1, middle @ turned(rng, 20.0, 150.0)) for one in infos]
    tree = assembled(
        sim.data.joints, sim.tree.X_PJ, infos, tags, sensors, [turned(rng, 30.0, 60.0)], {}
    )
    q = rng.uniform(-1.0, 1.0, (poses, 6))
    sigma = {"points": 3e-4, "turn": 1e-3}
    data = observed(tree, sim.data.joints, infos, sensors, q, rng, joint_sigma=JOINT, sigma=sigma)
    return Simulated(tree, data, q)


def unplaced(sim, seed, degrees, millimetres):
    """Return the description, which knows nothing of sensor and tags."""
    about = described(sim, seed, degrees, millimetres)
    sensors = tuple(replace(sensor, X_LA=np.eye(4)) for sensor in sim.tree.sensors)
    return replace(about, tree=replace(about.tree, sensors=sensors))


@pytest.mark.parametrize("kind", ["poses", "points"])
@pytest.mark.parametrize("seed", slow_rest(range(6), plain=1))
def test_a_tracker_on_a_hand_is_placed_by_how_what_it_sees_moves(kind, seed):
    sim = before_tags(seed, kind)
    found = calibrate_tree(sim.data, description=unplaced(sim, seed, 1.2, 6.0), effects=())
    assert judge(found).status != "FAIL", judge(found).reasons
    assert not found.solution.outliers.any()
    own, true = (np.array([m.X_LA[:3, 3] for m in t.markers]) for t in (found.tree, sim.tree))
    apart = [np.linalg.norm(p[:, None] - p, axis=2) for p in (own, true)]
    assert np.abs(apart[0] - apart[1]).max() < 4e-3


@pytest.mark.parametrize("kind", ["poses", "points"])
def test_without_errors_it_and_what_it_sees_are_where_they_are(kind):
    sim = before_tags(3, kind)
    q, rng = sim.data.readings, np.random.default_rng(0)
    exact = {"points": 0.0, "turn": 0.0}
    infos = (sim.data.joints, sim.data.markers, sim.data.sensors)
    data = observed(sim.tree, *infos, np.array(q), rng, joint_sigma=0.0, sigma=exact)
    (rows,) = TreeObservations.of(data).sensors
    placed = with_carried_tracker(data, unplaced(sim, 3, 0.0, 0.0).tree, rows)
    assert placed is not None
    np.testing.assert_allclose(placed.sensors[0].X_LA, sim.tree.sensors[0].X_LA, atol=1e-7)
    for one, true in zip(placed.markers, sim.tree.markers, strict=True):
        np.testing.assert_allclose(one.X_LA[:3, 3], true.X_LA[:3, 3], atol=1e-7)


@pytest.mark.parametrize("seed", slow_rest(range(6), plain=1))
def test_an_arm_learns_itself_from_nothing_by_the_poses_of_tags_before_its_hand(seed):
    sim = before_tags(seed, "poses", poses=60, count=1 + seed % 3)
    found = calibrate_tree(sim.data, effects=())
    assert judge(found).status != "FAIL", judge(found).reasons
    assert not found.solution.outliers.any()
    world = found.setup.world
    assert world == standing_tag(sim.data)
    assert not any(name.startswith(f"{world}.") for name in found.setup.free)
    own, true = (
        np.array([marker.X_LA[:3, 3] for marker in tree.markers]) for tree in (found.tree, sim.tree)
    )
    apart = [np.linalg.norm(p[:, None] - p, axis=2) for p in (own, true)]
    assert np.abs(apart[0] - apart[1]).max() < 2e-3
    q = np.random.default_rng(9).uniform(-1.0, 1.0, (50, 6))
    seen = [seen_of(tree, q) for tree in (found.tree, sim.tree)]
    assert np.median(np.linalg.norm(seen[0] - seen[1], axis=1)) < 1.5e-3


def seen_of(tree, q):
    """Return where the sensor on the hand sees the first tag. Shape (N, 3)."""
    motion = TreeMotion.at(tree, q)
    X_SM = inverse(motion.poses(tree.sensors[0])) @ motion.poses(tree.markers[0])
    return X_SM[:, :3, 3]


def test_the_tag_seen_most_stands_for_the_world_where_nothing_else_does():
    data = before_tags(0, "poses", count=3).data
    few = data.of_rows((data.observations.marker != 1) | (data.observations.pose < 5))
    few = few.of_rows((few.observations.marker != 0) | (few.observations.pose < 20))
    assert standing_tag(few) == "t2"
    assert standing_tag(before_tags(0, "points").data) is None
    carried = tuple(replace(marker, on="j6") for marker in data.markers)
    assert standing_tag(replace(data, markers=carried)) is None


@pytest.mark.parametrize("kind", ["poses", "points"])
def test_a_marker_of_known_place_stays_where_it_is_told(kind):
    sim = before_tags(2, kind)
    told = tuple(replace(m, xyz=(0.0, 0.0, 0.0)) if m.name == "t3" else m for m in sim.data.markers)
    data = replace(sim.data, markers=told)
    few = data.of_rows((data.observations.marker != 3) | (data.observations.pose < 20))
    (rows,) = TreeObservations.of(few).sensors
    before = unplaced(sim, 2, 0.0, 0.0).tree
    placed = with_carried_tracker(few, before, rows)
    assert placed is not None
    np.testing.assert_array_equal(placed.markers[3].X_LA, before.markers[3].X_LA)
    assert np.linalg.norm(placed.markers[0].X_LA[:3, 3]) > 0.5


def test_a_marker_that_is_called_like_a_described_base_is_learned_like_any_other():
    sim = before_tags(2, "poses", count=2)
    called = {"t1": "base"}
    infos = tuple(replace(m, name=called.get(m.name, m.name)) for m in sim.data.markers)
    tree = sim.tree.with_markers(
        tuple(replace(m, name=called.get(m.name, m.name)) for m in sim.tree.markers)
    )
    named = Simulated(tree, replace(sim.data, markers=infos), sim.readings_true)
    found = calibrate_tree(named.data, description=unplaced(named, 2, 0.2, 1.0), effects=())
    assert found.setup.world == "base"
    assert "base.x" in found.setup.free


def test_one_that_stands_or_sees_known_places_is_left_to_them():
    sim = before_tags(1, "points")
    (rows,) = TreeObservations.of(sim.data).sensors
    tree = unplaced(sim, 1, 0.0, 0.0).tree
    standing = replace(sim.data, sensors=(replace(sim.data.sensors[0], on="world"),))
    assert with_carried_tracker(standing, tree, rows) is None
    at = [tuple(apply(m.X_LA, np.zeros((1, 3)))[0]) for m in sim.tree.markers]
    known = [replace(m, xyz=p) for m, p in zip(sim.data.markers, at, strict=True)]
    assert with_carried_tracker(replace(sim.data, markers=tuple(known)), tree, rows) is None

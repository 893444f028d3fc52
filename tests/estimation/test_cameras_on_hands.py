"""Cameras on links of a body that something else tells: a tracker, or cameras that stand."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_dataset import ObservationTable
from nico_selfmodel.dataset.body.sensors import MarkerInfo, SensorInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.bending_tree import tree_at
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.geometry.resection import robust_camera_pose
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_tree import WORLD, Attached

from .simulated_trees import LENS, observed, one_arm, turned


def recorded_with_an_eye(seed, tracked_room):
    """A hand with a camera among markers in the room, of which a tracker sees the first."""
    rng = np.random.default_rng(seed)
    sim = one_arm(seed, joints=4, markers=2, poses=40)
    room = tuple(
        Attached(f"room{k}", WORLD, transform(np.eye(3), p))
        for k, p in enumerate(2.0 * rng.normal(size=(40, 3)))
    )
    eye = Attached("eye", 3, turned(rng, 30.0, 40.0))
    tree = replace(
        sim.tree,
        markers=(*sim.tree.markers, *room),
        sensors=(*sim.tree.sensors, eye),
        lenses={"eye": LENS},
    )
    infos = (*sim.data.markers, *(MarkerInfo(m.name, "world") for m in room))
    size = {"image_size": LENS.image_size, "lens": dict(LENS.named_values)}
    sensors = (*sim.data.sensors, SensorInfo("eye", "camera", on="j4", **size))
    noise = {"joint_sigma": np.radians(0.05), "sigma": {"camera": 0.3, "points": 3e-4}}
    data = observed(tree, sim.data.joints, infos, sensors, sim.readings_true, rng, **noise)
    table = data.observations
    tracked, seen = table.sensor == 0, np.bincount(table.marker[table.sensor == 1], minlength=42)
    # Nobody needs what hardly is in view.
    mine = table.marker < 2 + tracked_room
    return tree, data.of_rows(np.where(tracked, mine, seen[table.marker] > 2))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "tracked_room"), [(3, 20), (3, 0), (5, 0), (6, 0), (8, 0), (9, 0)]
)
def test_a_camera_on_a_hand_is_placed_by_markers_located_or_not(seed, tracked_room):
    # It began in the link's middle, and what it saw ended up to 50,000 km away. Of a sparse room
    # three to nine sights a marker tell it; some of them hardly tell a distance.
    tree, data = recorded_with_an_eye(seed, tracked_room)
    found = calibrate_tree(data, effects=())
    pixels = found.train.by_row()[data.observations.sensor == 1]
    assert np.median(pixels) < 1.0
    apart = [
        np.linalg.norm(one.markers[one.marker_index("hand_tag0")].X_LA[:3, 3] - eye)
        for one in (found.tree, tree)
        for eye in [next(s for s in one.sensors if s.name == "eye").X_LA[:3, 3]]
    ]
    assert apart[0] == pytest.approx(apart[1], abs=4e-3)


def test_what_bends_is_told_by_the_camera_where_all_markers_stand_in_the_room():
    """It ended in an error of numpy's once something bent."""
    tree, data = recorded_with_an_eye(3, 0)
    room = tuple(marker for marker in tree.markers if marker.on == WORLD)
    points, turned_by = tree_at(replace(tree, markers=room), data)(None)
    assert (len(points), turned_by.shape) == (40, (40, 4))
    assert np.linalg.norm(np.ptp(points, axis=0)) > 0.3
    assert len(tree_at(tree, data)(None)[0]) == 80  # of its markers, where it has some


@pytest.mark.slow
def test_a_camera_on_a_hand_that_sees_nothing_located_is_refused():
    sim = one_arm(3, joints=4, markers=2, poses=40)
    size = {"image_size": LENS.image_size, "lens": dict(LENS.named_values)}
    markers = (*sim.data.markers, MarkerInfo("tag", "world"))
    sensors = (*sim.data.sensors, SensorInfo("eye", "camera", on="j4", **size))
    table = sim.data.observations
    seen = np.array([[320.0 + 3.0 * k, 240.0, *[np.nan] * 4] for k in range(40)])

    def with_more(key, value):
        return np.append(getattr(table, key), np.full(40, value))

    table = ObservationTable(
        np.append(table.pose, np.arange(40)),
        with_more("sensor", 1),
        with_more("marker", 2),
        with_more("other", -1),
        np.vstack([table.values, seen]),
    )
    data = replace(sim.data, markers=markers, sensors=sensors, observations=table)
    with pytest.raises(DataError, match=r"camera 'eye' on 'j4' saw 0 markers that something else"):
        calibrate_tree(data, effects=())


@pytest.mark.slow
def test_points_in_a_plane_put_no_camera_where_all_of_them_are_in_one_direction():
    # Linear equations of points on a circle led 10^84 m away, where rays agree with anything.
    for seed in range(20):
        rng = np.random.default_rng(seed)
        across = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
        turn = rng.uniform(-1.0, 1.0, 26)
        circle = 0.06 * np.column_stack([np.cos(turn), np.sin(turn)]) @ across
        rays = np.array([0.0, 0.0, 1.0]) + 0.12 * rng.normal(size=(26, 3))
        rays /= np.linalg.norm(rays, axis=1)[:, None]
        X, _ = robust_camera_pose(circle + rng.normal(size=3), rays, 0.15, rng)
        assert np.linalg.norm(X[:3, 3]) < 1e3

"""The scene of a body of any tree: where its markers were seen, and all of it in view."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.model.tree.body_tree import WORLD
from nico_selfmodel.viz.scene.scene import FIELD_OF_VIEW
from nico_selfmodel.viz.scene.scene_items import Markers
from nico_selfmodel.viz.scene.surroundings import ASPECT
from nico_selfmodel.viz.scene.tree_scene import tree_scene

from ..estimation.simulated_trees import one_arm

SEEN = "where they were seen"


def cloud(scene):
    """Return where markers were seen, as the scene has it; None where it does not say."""
    found = [item for item in scene.items if item.path == "seen/poses"]
    assert (SEEN in {entry.label for entry in scene.legend}) == bool(found)
    return found[0].centers if found else None


def test_a_marker_stands_at_each_pose_where_the_tracker_saw_it():
    made = one_arm(2, poses=30, joint_sigma=1e-9, sigma={"points": 1e-9, "turn": 1e-9})
    table = made.data.observations
    seen = cloud(tree_scene("arm", made.tree, made.data))
    order = np.argsort(table.pose)
    np.testing.assert_allclose(seen, table.values[order, :3], atol=1e-6)


def test_of_many_places_some_are_drawn_evenly():
    made = one_arm(2, markers=10, poses=60)
    assert len(made.data.observations) == 600
    assert len(cloud(tree_scene("arm", made.tree, made.data))) == 400


def test_what_stands_in_the_room_makes_no_cloud():
    made = one_arm(2, poses=10)
    standing = tuple(replace(marker, on=WORLD) for marker in made.tree.markers)
    assert cloud(tree_scene("arm", replace(made.tree, markers=standing), made.data)) is None


@pytest.mark.parametrize("sensor", ["points", "camera"])
@pytest.mark.parametrize("carried", [True, False])
def test_the_first_view_holds_markers_and_where_they_were_seen(sensor, carried):
    made = one_arm(2, markers=3, sensor=sensor)
    tree = made.tree
    if not carried:  # a body that only looks
        tree = replace(tree, markers=tuple(replace(m, on=WORLD) for m in tree.markers))
    scene = tree_scene("arm", tree, made.data)
    drawn = [item for item in scene.items if isinstance(item, Markers)]
    points = np.concatenate(
        [item.centers @ item.X_WI[:3, :3].T + item.X_WI[:3, 3] for item in drawn]
    )
    ahead = scene.camera.p_WT - scene.camera.p_WC
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    axes = np.stack([v / np.linalg.norm(v) for v in (right, np.cross(right, ahead), ahead)])
    x, y, z = axes @ (points - scene.camera.p_WC).T
    edge = np.tan(0.5 * FIELD_OF_VIEW) * z
    assert np.all(z > 0.0)
    assert np.all(np.abs(x) < ASPECT * edge)
    assert np.all(np.abs(y) < edge)

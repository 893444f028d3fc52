"""A body that stands behind the cameras that saw it is none, however well it fits."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.joining import joined
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.contradictions.against_the_rest import refuse_behind
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.model.tree.body_tree import WORLD

from .simulated_trees import one_arm

TURNED = np.diag([1.0, -1.0, -1.0, 1.0])


def inside_out(tree, names):
    """Return a body some of whose cameras look away from it."""
    sensors = (replace(s, X_LA=s.X_LA @ TURNED) if s.name in names else s for s in tree.sensors)
    return replace(tree, sensors=tuple(sensors))


@pytest.mark.parametrize("names", [(), ("left",), ("left", "right")])
def test_cameras_that_would_see_behind_themselves_are_named(names):
    made = one_arm(4, joints=3, poses=20, sensor="camera")
    tree, observations = inside_out(made.tree, names), TreeObservations.of(made.data)
    if not names:
        refuse_behind(tree, observations)
        return
    with pytest.raises(DataError, match=f"what {', '.join(names)} of data set .* lies behind"):
        refuse_behind(tree, observations)


@pytest.mark.parametrize(("share", "refused"), [(0.45, False), (0.55, True)])
def test_a_few_wrong_labels_behind_a_camera_are_no_fault_of_its_own(share, refused):
    made = one_arm(4, joints=3, poses=40, markers=20, sensor="camera")
    away = np.zeros((4, 4))
    away[:3, 3] = 1e3 * made.tree.sensors[0].X_LA[:3, 2]
    count = round(share * 20)
    markers = [
        replace(m, on=WORLD, X_LA=np.eye(4) + (-away if k < count else away))
        for k, m in enumerate(made.tree.markers)
    ]
    tree = replace(made.tree, markers=tuple(markers))
    if refused:
        with pytest.raises(DataError, match="lies behind"):
            refuse_behind(tree, TreeObservations.of(made.data))
    else:
        refuse_behind(tree, TreeObservations.of(made.data))


@pytest.mark.slow
def test_a_left_handed_tracker_beside_cameras_is_refused():
    """The arm inside out has the same pixels, and all that the tracker measured."""
    tracked, seen = (one_arm(3, joints=4, poses=40, **how) for how in ({}, {"sensor": "camera"}))
    data = joined(tracked.data, seen.data, "both")
    calibrate_tree(data)
    table = data.observations
    own = np.array([s.kind for s in data.sensors])[table.sensor] == "points"
    values = table.values.copy()
    values[own, 1] *= -1.0
    with pytest.raises(DataError, match=r"(left|right)-handed"):
        calibrate_tree(replace(data, observations=replace(table, values=values)))

"""Where what moves freely may be in each sample, before it is fitted: by its best single view."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.sensors import POINTS, POSES
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.boards.board_pose import FEWEST_CORNERS, mirrored_back
from nico_selfmodel.estimation.tree.boards.board_views import (
    BoardView,
    board_views,
    places_on_boards,
)
from nico_selfmodel.estimation.tree.tree_observations import SensorRows, TreeObservations
from nico_selfmodel.geometry.alignment import Alignment
from nico_selfmodel.geometry.reflection import reflection
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.tree.body_tree import BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion

_FEWEST_POINTS = 3


def first_poses(tree: BodyTree, observations: TreeObservations) -> NDArray:
    """Return two guesses of all whole poses, those of controllers as they were read.

    Args:
        tree: The body, its cameras and mirrors nearly where they are.

    Returns:
        Shape (2, P, n, 4, 4).

    Raises:
        DataError: If a sample shows too little of what moves freely.
    """
    data = observations.data
    out = np.stack([data.X_flange, data.X_flange])
    motion = TreeMotion.at(tree, data.si_readings, data.X_flange, data.si_approach)
    by_name = {sensor.name: motion.poses(sensor) for sensor in tree.sensors}
    best: dict[tuple[int, int], int] = {}
    for view in board_views(observations, tree.lenses):
        key = (view.sample, view.joint)
        # A direct view is nearer than a reflection, and does not err with the mirror.
        worth = 2 * view.corners + (not view.mirror)
        if worth > best.get(key, 0):
            best[key] = worth
            X_WC = by_name[view.camera][view.sample]
            out[:, view.sample, view.joint] = _in_world(tree, view, X_WC)
    for rows in observations.sensors:
        if rows.kind in (POINTS, POSES):
            for sample, joint, X_SB in _measured(data, rows):
                out[:, sample, joint] = by_name[rows.name][sample] @ X_SB
                best[sample, joint] = 1
    _check(observations, best)
    for joint in data.free_joints:
        out[:, :, joint] = inverse(tree.X_PJ[joint]) @ out[:, :, joint]
    return out


def _in_world(tree: BodyTree, view: BoardView, X_WC: NDArray) -> NDArray:
    """Return X_WB twice of a board seen once. Shape (2, 4, 4)."""
    seen = X_WC @ view.X_CB
    return reflection(tree.mirror(view.mirror).plane) @ mirrored_back(seen) if view.mirror else seen


def _measured(data: BodyDataset, rows: SensorRows) -> list[tuple[int, int, NDArray]]:
    """Return sample, joint and X_SB of what a tracker saw of what moves freely."""
    found, places, on = [], places_on_boards(data), data.seen_on[rows.rows]
    for joint in data.free_joints:
        for sample in np.unique(rows.pose[on == joint]).tolist():
            own = (on == joint) & (rows.pose == sample)
            p_BM, p_SM = places[rows.marker[own]], rows.measured[own, :3]
            if rows.kind == POSES:
                R = rotation_from_vector(rows.measured[own, 3:][0])
                found.append((sample, joint, transform(R, p_SM[0] - R @ p_BM[0])))
            elif own.sum() >= _FEWEST_POINTS:
                fit = Alignment.from_points(p_BM, p_SM)
                found.append((sample, joint, transform(fit.rotation, fit.translation)))
    return found


def _check(observations: TreeObservations, placed: dict[tuple[int, int], int]) -> None:
    """Refuse samples in which something was seen of what moves freely, and too little."""
    data = observations.data
    for rows in observations.sensors:
        on = data.seen_on[rows.rows]
        for joint in data.free_joints:
            for sample in np.unique(rows.pose[on == joint]).tolist():
                if (sample, joint) not in placed:
                    count = int(np.sum((on == joint) & (rows.pose == sample)))
                    raise DataError(
                        f"sample {data.sample[sample]} of data set {data.name!r} shows {count} "
                        f"markers of {data.joint_names[joint]!r}, which moves freely: a camera "
                        f"needs {FEWEST_CORNERS} that are not on one line, a tracker "
                        f"{_FEWEST_POINTS}; leave that sample's rows out"
                    )

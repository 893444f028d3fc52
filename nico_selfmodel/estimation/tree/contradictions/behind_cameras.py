"""Cameras that would see behind themselves: what else was measured is another hand's."""

import numpy as np

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.sensors import CAMERA
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.model.tree.body_tree import BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.names import listed

_MOST_BEHIND = 0.5
"""Share of what a camera saw from which on it is not a few wrong labels that lie behind it."""


def refuse_behind(tree: BodyTree, observations: TreeObservations) -> None:
    """Refuse a body of which cameras would see what is behind them.

    A world turned inside out through a camera, p -> -p, has the same pixels: a body that a
    left-handed tracker and cameras saw fits both, and stands behind these.

    Args:
        tree: The body as it was learned.
        observations: What it was learned from.

    Raises:
        DataError: If most of what a camera saw lies behind it.
    """
    data = observations.data
    if data.free_joints:  # boards begin before the cameras that saw them
        return
    behind = _behind(tree, data, observations)
    if not behind:
        return
    rest = [s.name for s in data.sensors if s.kind != CAMERA]
    what = f"what {listed(rest)} measured" if rest else "the robot as it is described"
    raise DataError(
        f"what {listed(behind)} of data set {data.name!r} saw lies behind as {what} has it: one of "
        "them is left-handed (x, y, z must be right-handed, u run to the right and v down): negate "
        "one of its axes"
    )


def _behind(tree: BodyTree, data: BodyDataset, observations: TreeObservations) -> list[str]:
    """Return the names of cameras most of whose sights lie behind them."""
    motion = TreeMotion.at(tree, data.si_readings, data.X_flange)
    names = [sensor.name for sensor in tree.sensors]
    counts = dict[str, list[int]]()
    for rows in observations.sensors:
        if rows.kind != CAMERA or rows.name not in names:
            continue
        R_WS, p_WS = motion.pose_of(tree.sensors[names.index(rows.name)])
        p_WM = motion.points(rows.marker, rows.pose)
        if rows.mirror:
            p_WM = reflect(tree.mirror(rows.mirror).plane, p_WM)
        away = p_WM.T - p_WS[:, rows.pose]
        depth = np.einsum("jn,jn->n", R_WS[:, 2, rows.pose], away)
        one = counts.setdefault(rows.name, [0, 0])
        one[0] += int((depth < 0.0).sum())
        one[1] += len(depth)
    return [name for name, (off, of) in counts.items() if off > _MOST_BEHIND * of]

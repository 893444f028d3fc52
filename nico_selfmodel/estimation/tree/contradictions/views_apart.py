"""Views of boards that fit each by itself and not together.

A board at its best pose in each single view leaves the noise of corners, r - A (A'A)^-1 A'r to
first order, A by that pose. What boards leave at one pose a sample before one camera, all mirrors
and cameras where they are, is as much where these are what the recording says. The ratio of both
mean squares is Fisher's F.
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.sensors import CAMERA
from nico_selfmodel.estimation.results.calibration_result import MISFIT, Finding
from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.tree_observations import SensorRows, TreeObservations

LEAST_RATIO = 3.0
"""Noise of all views together, over that of views by themselves, from which on they contradict."""
_POSE = 6
_FEWEST = 2 * _POSE
"""Numbers of a view from which on it tells its own noise."""


def views_apart(linear: TreeLinear, seen: TreeObservations, outliers: NDArray) -> list[Finding]:
    """Name cameras whose views of boards fit by themselves and not together.

    Args:
        linear: Residuals at the solution, about the readings.
        seen: What was seen.
        outliers: Observations that were set aside. Boolean, by row of the table.
    """
    found: dict[str, list[NDArray]] = {}
    for rows in seen.sensors:
        if rows.apart and rows.kind == CAMERA:
            parts = _squares(linear, seen, rows, outliers)
            found.setdefault(rows.name, []).extend(parts)
    words = []
    for name, parts in found.items():
        together, alone, count, freedoms = np.sum(parts, axis=0) if parts else np.zeros(4)
        if freedoms <= 0.0:
            continue
        all_px, own_px = np.sqrt([together / count, alone / freedoms])
        if all_px >= LEAST_RATIO * own_px:
            mirror = " and the mirrors that rows name" if seen.data.mirrors else ""
            words.append(
                f"single views of boards by {name!r} fit to {own_px:.2g} px, and all together to "
                f"{all_px:.3g} px: check which views are of one sample{mirror}, and whether "
                "anything but the boards moved"
            )
    return [Finding(MISFIT, text) for text in words]


def _squares(
    linear: TreeLinear, seen: TreeObservations, rows: SensorRows, outliers: NDArray
) -> list[NDArray]:
    """Return of each view: squares together, by itself, numbers and freedoms by itself."""
    r = linear.r[rows.scalars].reshape(-1, 2)
    A = linear.by_joint[rows.scalars].reshape(*r.shape, -1)
    out = []
    for joint in seen.data.free_joints:
        own = ~outliers[rows.rows] & (seen.data.seen_on[rows.rows] == joint)
        first = seen.noisy_joints.index((joint, 0))
        for sample in np.unique(rows.pose[own]):
            view = own & (rows.pose == sample)
            left, by_pose = r[view].ravel(), A[view, :, first : first + _POSE].reshape(-1, _POSE)
            if len(left) >= _FEWEST:
                by_itself = left - by_pose @ np.linalg.lstsq(by_pose, left)[0]
                sums = left @ left, by_itself @ by_itself, len(left), len(left) - _POSE
                out.append(np.array(sums))
    return out

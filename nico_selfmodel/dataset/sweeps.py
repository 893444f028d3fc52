"""Sweeps: groups of poses in which one joint turns and all others hold still.

Each makes the tracked point draw a circle about the axis of the joint that turns.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nico_selfmodel.arrays import read_only
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import HOME
from nico_selfmodel.names import listed

_SHARE_OF_SPAN = 0.002
_MIN_VALUES = 3
# Of a group in units of the tolerance: one tolerance to either side.
_WIDTH = 2.0


@dataclass(frozen=True, eq=False)
class Sweep:
    """Poses in which one joint turns and all others hold still."""

    joint: int
    """Index of the joint that turns."""
    rows: npt.NDArray[np.int64]
    """Rows of the poses, by ascending reading of the joint; read-only. Shape (k,)."""

    def __post_init__(self) -> None:
        """Copy the rows."""
        object.__setattr__(self, "rows", read_only(self.rows, np.int64))


def find_sweeps(encoders: npt.ArrayLike, tolerance: npt.ArrayLike | None = None) -> list[Sweep]:
    """Find the sweeps that are hidden in encoder readings; a grid of poses is full of them.

    A pose can belong to one sweep of every joint. In one sweep each joint that holds still keeps
    within the tolerance of one reading, so within twice the tolerance in all.

    Args:
        encoders: Readings, one row per pose. Shape (N, n).
        tolerance: How far a joint that holds still may stray [encoder unit]: one number or one
            per joint, shape (n,). By default 0.2 % of the joint's span in the data.

    Returns:
        The sweeps, by joint and then by first row.

    Raises:
        ValueError: If a shape is wrong or a tolerance is negative.
    """
    encoders = np.asarray(encoders, dtype=np.float64)
    if encoders.ndim != 2 or not encoders.size or not np.isfinite(encoders).all():
        raise ValueError(f"encoders must be finite and have shape (N, n), got {encoders.shape}")
    if tolerance is None:
        tolerance = _SHARE_OF_SPAN * np.ptp(encoders, axis=0)
    tolerance = np.broadcast_to(np.asarray(tolerance, dtype=np.float64), encoders.shape[1:])
    if not (tolerance >= 0.0).all():
        raise ValueError(f"tolerance must not be negative, got {tolerance}")
    # In units of the tolerance; a joint that never moved has no span to divide by.
    scaled = encoders / np.where(tolerance > 0.0, tolerance, np.finfo(np.float64).tiny ** 0.5)
    sweeps = []
    for joint in range(encoders.shape[1]):
        held = np.delete(scaled, joint, axis=1)
        groups = [
            group[np.argsort(scaled[group, joint], kind="stable")] for group in _still_groups(held)
        ]
        groups = [g for g in groups if _distinct_count(scaled[g, joint]) >= _MIN_VALUES]
        sweeps += [Sweep(joint, group) for group in sorted(groups, key=lambda group: group.min())]
    return sweeps


def unmarked_sweeps(dataset: Dataset, marker: str | None = None) -> list[Sweep]:
    """Find the sweeps in a data set that nobody marked; the `sweep` column is not looked at.

    A joint that holds still may stray by 0.2 % of its span, and by one count or 0.02 degrees.

    Args:
        marker: Which tracked point, the first one by default.

    Returns:
        The sweeps, one row of the data set per measured pose.

    Raises:
        ValueError: If there is no such marker.
    """
    rows = _pose_rows(dataset, marker)
    if not rows.size:
        return []
    floor = [joint.still_tolerance for joint in dataset.joints]
    tolerance = np.maximum(floor, _SHARE_OF_SPAN * dataset.encoder_span)
    found = find_sweeps(dataset.encoders[rows], tolerance)
    return [Sweep(sweep.joint, rows[sweep.rows]) for sweep in found]


def marked_sweeps(dataset: Dataset, marker: str | None = None) -> list[Sweep]:
    """Return the sweeps that the `sweep` column names; the `home` rows belong to each of them.

    Args:
        marker: Which tracked point, the first one by default.

    Returns:
        At most one sweep per joint, one row of the data set per measured pose; joints without
        a marked row are left out.

    Raises:
        ValueError: If there is no such marker.
    """
    rows = _pose_rows(dataset, marker)
    label = dataset.sweep[rows]
    sweeps = []
    for joint, name in enumerate(dataset.joint_names):
        if (label == name).any():
            members = rows[(label == name) | (label == HOME)]
            order = np.argsort(dataset.encoders[members, joint], kind="stable")
            sweeps.append(Sweep(joint, members[order]))
    return sweeps


def _pose_rows(dataset: Dataset, marker: str | None) -> npt.NDArray[np.int64]:
    """Return one measured row per pose of one marker, in the order of the data set."""
    marker = dataset.markers[0] if marker is None else marker
    if marker not in dataset.markers:
        raise ValueError(f"marker must be one of {listed(dataset.markers)}, got {marker!r}")
    rows = np.flatnonzero((dataset.marker == marker) & dataset.measured)
    _, first = np.unique(dataset.sample[rows], return_index=True)
    return rows[np.sort(first)]


def _still_groups(held: npt.NDArray[np.float64]) -> list[npt.NDArray[np.int64]]:
    """Group poses whose readings (in units of the tolerance) stay together in every column."""
    groups = []
    for block in _blocks(held):
        if block.size < _MIN_VALUES:
            continue
        if (np.ptp(held[block], axis=0) <= _WIDTH).all():
            groups.append(block)
        else:
            groups += _dense_groups(held, block)
    return groups


def _blocks(held: npt.NDArray[np.float64]) -> list[npt.NDArray[np.int64]]:
    """Cut the poses apart at gaps wider than 2 in any column, until no gap is left.

    Gaps, unlike the borders of a raster, never fall between two readings that belong together.
    """
    label = np.zeros(len(held), dtype=np.int64)
    count = 0
    while label.max() + 1 > count:
        count = label.max() + 1
        for column in held.T:
            order = np.lexsort((column, label))
            cut = (np.diff(label[order]) != 0) | (np.diff(column[order]) > _WIDTH)
            label[order] = np.concatenate([[0], np.cumsum(cut)])
    order = np.argsort(label, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(label[order])) + 1)


def _dense_groups(
    held: npt.NDArray[np.float64], block: npt.NDArray[np.int64]
) -> list[npt.NDArray[np.int64]]:
    """Take the fullest balls of radius 1 out of a block, where a slow motion links far poses."""
    near = np.ones((block.size, block.size), dtype=np.bool_)
    for column in held[block].T:
        near &= np.abs(column[:, None] - column) <= 1.0
    free = np.ones(block.size, dtype=np.bool_)
    groups = []
    for centre in np.argsort(-near.sum(axis=1), kind="stable"):
        members = near[centre] & free
        if free[centre] and members.sum() >= _MIN_VALUES:
            groups.append(block[members])
            free &= ~members
    return groups


def _distinct_count(ascending: npt.NDArray[np.float64]) -> int:
    """Count readings that lie more than 1 above the last one counted."""
    count, last = 0, -np.inf
    for value in ascending.tolist():
        if value > last + 1.0:
            count, last = count + 1, value
    return count

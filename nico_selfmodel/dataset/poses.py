"""Which rows belong to one pose: what noise belongs to, and what splits and counts go by."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import numbered_rows

_STANDING = 1e-4
"""Part of a joint's span within which the readings of successive samples are those of a standing
robot."""


def pose_numbers(
    sample: NDArray, encoders: NDArray, approach: NDArray | None = None
) -> tuple[NDArray, NDArray]:
    """Number the poses of rows, and the visits to them.

    Rows with equal readings are one pose, wherever they stand, and so are successive samples of a
    robot that stands still but for the last digits: what is off there is off in all of them. Each
    time that it came there is a visit, with a draw of joint noise of its own.

    Args:
        sample: Number of each row's sample, in the order of time. Shape (N,).
        encoders: Readings. Shape (N, n).
        approach: How each reading last changed: a robot that comes from another side has moved.
            Shape (N, n).

    Returns:
        Numbers of poses and of visits, both from 0 in the order of the samples. Shape (N,) each.
    """
    samples, first, of_row = np.unique(sample, return_index=True, return_inverse=True)
    of_row = of_row.reshape(len(sample))
    state = encoders if approach is None else np.hstack([encoders, approach])
    standing = _run_starts(state[first])
    visit = np.unique(standing, return_inverse=True)[1].reshape(len(samples))
    lead, same = numbered_rows(encoders[first][standing])
    # In the order of time: the first sample of each pose numbers it.
    rank = np.empty(len(lead), dtype=np.int64)
    rank[np.argsort(lead, kind="stable")] = np.arange(len(lead))
    return rank[same][of_row], visit[of_row]


def mean_of_visits(readings: NDArray, visit: NDArray) -> NDArray:
    """Return readings of which all of a visit are its mean: the last digits of a robot that stands.

    Differences of them are no motion: a sensor that sees none would be blamed for it.

    Args:
        readings: Of rows. Shape (N, n).
        visit: Number of each row's visit. Shape (N,).
    """
    lead = readings[np.unique(visit, return_index=True)[1]]
    off = readings - lead[visit]
    if not off.any():
        return readings
    sums = np.zeros_like(lead)
    np.add.at(sums, visit, off)
    return np.asarray((lead + sums / np.bincount(visit)[:, None])[visit])


def _run_starts(readings: NDArray) -> NDArray:
    """Return for each sample the first of the run in which the robot stands still. Shape (S,)."""
    tolerance = _STANDING * np.ptp(readings, axis=0)
    starts = np.arange(len(readings))
    close = (np.abs(np.diff(readings, axis=0)) <= tolerance).all(axis=1)
    for i in np.flatnonzero(close) + 1:
        start = starts[i - 1]
        if (np.abs(readings[i] - readings[start]) <= tolerance).all():
            starts[i] = start
    return starts

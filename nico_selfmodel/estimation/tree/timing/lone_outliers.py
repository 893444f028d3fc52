"""Wrong detections here and there, which tell nothing of what changed in the course of time."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import ANY_POSE, BodyDataset
from nico_selfmodel.estimation.noise.contradictions import LEAST_SHARE, most_expected
from nico_selfmodel.estimation.tree.compared_errors import median_around

_MOST_SHARE = 0.5
"""Of observations that are set aside anywhere; beyond it no more of one marker is strange."""
_BEYOND = 4.0
"""Times that one is further off than what its sensor saw of its marker before and after."""


def lone_outliers(data: BodyDataset, outliers: NDArray, far: NDArray) -> NDArray:
    """Return outliers that are no more of their marker, their sensor and their pose than of others.

    Nor are those among others that are far beyond these.

    What was knocked or moved leaves many of one marker, sensor or pose. One wrong detection of 100
    sigmas hides it from whoever counts all: it puts its error into all that was seen of its pose,
    by the joints' noise that these share.

    Args:
        data: The recording.
        outliers: Observations that were set aside. Boolean, by row of the table, shape (N,).
        far: How far off each is. Shape (N,).
    """
    table, lone = data.observations, outliers.copy()
    share = float(np.clip(outliers.mean() if len(outliers) else 0.0, LEAST_SHARE, _MOST_SHARE))
    for of in (table.marker, table.sensor):
        for one in np.unique(of[outliers]):
            own = of == one
            if outliers[own].sum() > most_expected(int(own.sum()), share):
                lone &= ~own
    beyond = outliers & _beyond_others(data, far)
    return (lone & ~_most_of_pose(data, outliers)) | (beyond & ~_most_of_pose(data, beyond, 2))


def _most_of_pose(data: BodyDataset, off: NDArray, fewest: int = 1) -> NDArray:
    """Return observations of poses of which half or more are off, and so many. Boolean, (N,)."""
    pose = data.observations.pose
    told = pose != ANY_POSE
    seen = np.bincount(pose[told], minlength=len(data.sample))
    aside = np.bincount(pose[told & off], minlength=len(data.sample))
    most = np.zeros(len(pose), dtype=bool)
    most[told] = ((2 * aside >= seen) & (aside >= fewest))[pose[told]]
    return most


def _beyond_others(data: BodyDataset, far: NDArray) -> NDArray:
    """Return what is further off than a sensor saw a marker before and after. Shape (N,)."""
    table = data.observations
    beyond = np.zeros(len(far), dtype=bool)
    for sensor in np.unique(table.sensor):
        own = np.flatnonzero((table.sensor == sensor) & (table.pose != ANY_POSE))
        time = np.argsort(np.argsort(data.sample))[table.pose[own]]
        beyond[own] = far[own] > _BEYOND * median_around(far[own], time, table.marker[own])
    return beyond

"""Wrong detections here and there, which tell nothing of what changed in the course of time."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import ANY_POSE, BodyDataset
from nico_selfmodel.estimation.noise.contradictions import LEAST_SHARE, most_expected

_MOST_SHARE = 0.5
"""Of observations that are set aside anywhere; beyond it no more of one marker is strange."""


def lone_outliers(data: BodyDataset, outliers: NDArray) -> NDArray:
    """Return outliers that are no more of their marker, their sensor and their pose than of others.

    What was knocked or moved leaves many of one marker, sensor or pose. One wrong detection of 100
    sigmas hides it from whoever counts all: it puts its error into all that was seen of its pose,
    by the joints' noise that these share.

    Args:
        data: The recording.
        outliers: Observations that were set aside. Boolean, by row of the table, shape (N,).
    """
    table, lone = data.observations, outliers.copy()
    share = float(np.clip(outliers.mean() if len(outliers) else 0.0, LEAST_SHARE, _MOST_SHARE))
    for of in (table.marker, table.sensor):
        for one in np.unique(of[outliers]):
            own = of == one
            if outliers[own].sum() > most_expected(int(own.sum()), share):
                lone &= ~own
    told = table.pose != ANY_POSE
    seen = np.bincount(table.pose[told], minlength=len(data.sample))
    aside = np.bincount(table.pose[told & outliers], minlength=len(data.sample))
    lone[told] &= (2 * aside < seen)[table.pose[told]]
    return lone

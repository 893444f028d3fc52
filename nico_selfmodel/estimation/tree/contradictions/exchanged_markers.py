"""Markers of a body whose names are exchanged in part of a recording."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.sensors import SIGHTS
from nico_selfmodel.estimation.observations.outlier_words import exchanged_names
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_calibration import TreeCalibration
from nico_selfmodel.estimation.tree.tree_errors import TreeErrors
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations

_FEWEST = 2
"""Outliers of a marker from which on its name may be exchanged."""


def exchanged_markers(calibration: TreeCalibration) -> list[str]:
    """Say which markers' names are exchanged in part of the training poses.

    What moves freely is left out: the names of a board's corners tell its pose.
    """
    table, wrong = calibration.data.observations, calibration.solution.outliers
    kinds = np.array([sensor.kind for sensor in calibration.data.sensors])
    rows = np.flatnonzero(wrong & np.isin(kinds[table.sensor], SIGHTS))
    counts = np.bincount(table.marker[rows], minlength=len(calibration.data.markers))
    asked = np.flatnonzero(counts >= _FEWEST)
    if len(asked) < 2 or calibration.data.free_joints:
        return []
    told_as = np.full((len(table), len(calibration.data.markers)), np.nan)
    told_as[rows, table.marker[rows]] = np.inf
    most = _most_left(calibration)[table.sensor[rows]]
    for marker in asked.tolist():
        told_as[rows, marker] = _left_as(calibration, rows, marker) / most
    names = [marker.name for marker in calibration.data.markers]
    sample = calibration.data.sample[table.pose]
    return exchanged_names(names, table.marker, sample, wrong, told_as)


def _most_left(calibration: TreeCalibration) -> NDArray:
    """Return the largest error of each sensor's observations that are no outliers. Shape (S,)."""
    left, table = calibration.train.by_row(), calibration.data.observations
    most = np.full(len(calibration.data.sensors), np.finfo(float).tiny)
    sound = ~calibration.solution.outliers & np.isfinite(left)
    np.maximum.at(most, table.sensor[sound], left[sound])
    return most


def _left_as(calibration: TreeCalibration, rows: NDArray, marker: int) -> NDArray:
    """Return the errors of some observations were they of a marker. Shape (n,)."""
    data, parameters = calibration.data, calibration.parameters
    some = data.observations.select(rows)
    told = replace(data, observations=replace(some, marker=np.full(len(rows), marker)))
    seen = TreeObservations.of(told)
    return TreeErrors(seen, TreeResiduals(seen, parameters).residuals(calibration.values)).by_row()

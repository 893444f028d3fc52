"""A sensor that was moved so far while a body was recorded that no body explains what it saw.

What it saw before and after fits all the rest then, each by itself. A body by what it saw in the
first or the last third tells from which sample on it is off.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import ANY_POSE, BodyDataset
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.guesses.start_search import FoundStart
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations

_FEWEST = 12
"""Samples in which a sensor saw anything below which nobody asks."""
_AT_EITHER_END = 3
"""Samples at least before and after it was moved."""
_SMALLER = 0.3
"""Part of the errors on one side that are left on the other."""


def moved_after(
    data: BodyDataset, sensor: int, fits: Callable[[BodyDataset], FoundStart | None]
) -> int | None:
    """Return the last sample before a sensor was moved; None where it was not.

    Args:
        data: The recording.
        sensor: Index of the sensor.
        fits: Finds a body of a part of the recording, if one explains it.
    """
    table = data.observations
    own = np.flatnonzero((table.sensor == sensor) & (table.pose != ANY_POSE))
    sample = data.sample[table.pose[own]]
    times = np.unique(sample)
    if len(times) < _FEWEST:
        return None

    def only(kept: NDArray) -> BodyDataset:
        rows = np.ones(len(table), dtype=bool)
        rows[own[~kept]] = False
        return data.of_rows(rows)

    third = len(times) // 3
    for kept in (sample < times[third], sample >= times[-third]):
        found = fits(only(kept))
        if found is None:
            continue
        last = _parting(times, _errors(found, data, own), sample)
        if last is not None and fits(only(sample <= last)) and fits(only(sample > last)):
            return last
    return None


def _errors(found: FoundStart, data: BodyDataset, rows: NDArray) -> NDArray:
    """Return how far some rows of the table are from a body [m or px]. Shape (N,) -> (N,)."""
    seen = TreeObservations.of(data)
    r = TreeResiduals(seen, found.start.parameters).residuals(found.start.values)
    return np.asarray(np.sqrt(seen.per_row(r * r))[rows])


def _parting(times: NDArray, errors: NDArray, sample: NDArray) -> int | None:
    """Return after which sample errors are others, by the squares of usual logarithms."""
    usual = np.array([np.median(errors[sample == one]) for one in times])
    logs = np.log(np.maximum(usual, np.finfo(float).tiny))
    logs, count = logs - logs.mean(), np.arange(1, len(logs) + 1)
    sums = np.cumsum(logs)
    inside = slice(_AT_EITHER_END - 1, len(logs) - _AT_EITHER_END)
    gain = (sums**2 / count)[inside] + (sums**2 / np.maximum(len(logs) - count, 1))[inside]
    first = int(np.argmax(gain)) + _AT_EITHER_END
    sides = sorted(float(np.median(one)) for one in (usual[:first], usual[first:]))
    return int(times[first - 1]) if sides[0] < _SMALLER * sides[1] else None

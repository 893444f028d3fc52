"""Rows that were logged again while a robot stood still: they tell nothing that is new."""

import warnings
from dataclasses import replace

import numpy as np

from nico_selfmodel.dataset.body.body_dataset import ANY_POSE, BodyDataset


def without_copies(data: BodyDataset) -> BodyDataset:
    """Return a recording without observations that stand there again, of the same pose.

    A sensor that is read faster than it measures is logged several times to the last digit. Each
    copy would count as a measurement of its own, as if its noise were the smaller.

    Args:
        data: The recording.

    Warns:
        UserWarning: If there are such rows; it says how many, and of which samples.
    """
    table = data.observations
    told = np.flatnonzero((table.pose != ANY_POSE) & np.isfinite(table.values).any(axis=1))
    who = [data.pose[table.pose], table.sensor, table.marker, table.other]
    columns = [*(one[told] for one in who), *np.nan_to_num(table.values[told]).T]
    # Sums by weights without a common measure are equal only where all numbers are; column by
    # column, as what a product of matrices rounds to depends on where a row stands.
    keys = np.zeros(len(told))
    for place, column in enumerate(columns):
        keys += np.sqrt(2.0 + place) * column
    if not (np.diff(np.sort(keys)) == 0.0).any():
        return data
    mirror = np.unique(table.mirror[told], return_inverse=True)[1].reshape(len(told))
    keys += np.sqrt(2.0 + len(columns)) * mirror
    rows = np.column_stack([*columns, mirror])
    order = np.lexsort((data.sample[table.pose[told]], keys))
    again = np.zeros(len(table), dtype=bool)
    again[told[order[1:]]] = (np.diff(rows[order], axis=0) == 0.0).all(axis=1)
    if not again.any():
        return data
    samples = np.unique(data.sample[table.pose[again]])
    warnings.warn(
        f"{again.sum()} of {len(table)} observations are of one pose and the same, to the last "
        f"digit, as earlier ones (the first of sample {samples[0]}): rows that are logged again "
        "tell nothing new, they count once",
        stacklevel=3,
    )
    return replace(data, observations=table.select(~again))

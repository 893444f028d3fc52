"""Rows that were logged again while a robot stood still: they tell nothing that is new."""

import warnings
from dataclasses import replace

import numpy as np

from nico_selfmodel.arrays import numbered_rows
from nico_selfmodel.dataset.body.body_dataset import ANY_POSE, BodyDataset


def without_copies(data: BodyDataset) -> BodyDataset:
    """Return a recording without observations that stand there again, of the same pose.

    A sensor that is read faster than it measures is logged several times to the last digit. Each
    copy would count as a measurement of its own, as if its noise were the smaller.

    Warns:
        UserWarning: If there are such rows; it says how many, and of which samples.
    """
    table = data.observations
    told = np.flatnonzero((table.pose != ANY_POSE) & np.isfinite(table.values).any(axis=1))
    told = told[np.argsort(data.sample[table.pose[told]], kind="stable")]
    mirror = np.unique(table.mirror[told], return_inverse=True)[1].reshape(len(told))
    who = [data.pose[table.pose[told]], *(one[told] for one in (table.sensor, table.marker))]
    numbers = [table.other[told], mirror, *np.nan_to_num(table.values[told]).T]
    first, same = numbered_rows(np.column_stack([*who, *numbers]))
    again = np.zeros(len(table), dtype=bool)
    again[told[first[same] != np.arange(len(told))]] = True
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

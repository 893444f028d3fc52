"""Data sets of one body put together, the poses of each numbered on."""

from dataclasses import replace

import numpy as np

from nico_selfmodel.dataset.dataset import Dataset


def joined_data(*datasets: Dataset) -> Dataset:
    arrays = ("encoders", "approach", "p_WH_measured", "sweep", "marker", "pixels", "mirror")
    both = {k: np.concatenate([getattr(d, k) for d in datasets]) for k in arrays}
    first = np.cumsum([0, *(d.sample.max() for d in datasets[:-1])])
    sample = np.concatenate([d.sample + k for d, k in zip(datasets, first, strict=True)])
    return replace(datasets[0], sample=sample, extra={}, **both)

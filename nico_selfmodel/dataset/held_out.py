"""What of a test set is held out: poses that the training does not have."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import DataError


def held_out_of(train: Dataset, test: Dataset) -> Dataset:
    """Return what of a test set is held out: the poses that the training does not have.

    Returns:
        The rows of `test` whose readings are those of no training row.

    Raises:
        DataError: If rows stand in both sets, or nothing else is left.
    """
    if train.joint_names != test.joint_names:
        return test
    known = {tuple(row) for row in train.encoders.tolist()}
    shared = np.array([tuple(row) in known for row in test.encoders.tolist()])
    if not shared.any():
        return test
    seen = set(_measured_rows(train, np.arange(len(train))))
    same = sum(row in seen for row in _measured_rows(test, np.flatnonzero(shared)))
    if same:
        raise DataError(
            f"{same} of {len(test)} rows of data set {test.name!r} stand in {train.name!r} too: "
            "what was learned from shows nothing; hold out other data, or use --test-fraction"
        )
    if shared.all():
        raise DataError(
            f"data set {test.name!r} has no pose that {train.name!r} has not: its errors would say "
            "nothing of other poses; record other poses to judge by"
        )
    return test.select(~shared)


def _measured_rows(dataset: Dataset, rows: NDArray) -> list[tuple[object, ...]]:
    """Return readings, point, pixels and marker of rows in which anything was measured."""
    measured = np.concatenate([dataset.p_WH_measured, dataset.pixels], axis=1)
    rows = rows[np.isfinite(measured[rows]).any(axis=1)]
    numbers = np.concatenate([dataset.encoders, measured], axis=1)[rows]
    numbers = np.where(np.isnan(numbers), np.inf, numbers)
    return [
        (*values, marker)
        for values, marker in zip(numbers.tolist(), dataset.marker[rows].tolist(), strict=True)
    ]

"""Recordings of one body, one after the other, as one."""

from dataclasses import replace

import numpy as np

from nico_selfmodel.dataset.body.body_dataset import (
    ANY_POSE,
    COLUMNS,
    BodyDataset,
    ObservationTable,
)
from nico_selfmodel.errors import DataError
from nico_selfmodel.names import listed


def joined(first: BodyDataset, second: BodyDataset, name: str) -> BodyDataset:
    """Return two recordings of one body as one; the second's samples are numbered anew.

    Args:
        first: The earlier recording.
        second: The later one, of the same joints, markers and sensors.
        name: Of both together.

    Raises:
        DataError: If it is of another body.
    """
    for what in ("joints", "markers", "sensors"):
        one, two = ([item.name for item in getattr(data, what)] for data in (first, second))
        if one != two:
            raise DataError(
                f"data set {first.name!r} has the {what} {listed(one)}, {second.name!r} has "
                f"{listed(two)}: both must be of one body"
            )
    later = second.observations
    pose = np.where(later.pose == ANY_POSE, ANY_POSE, later.pose + len(first.sample))
    tables = [first.observations, replace(later, pose=pose)]
    columns = (np.concatenate([getattr(table, key) for table in tables]) for key in COLUMNS)
    numbers = second.sample - second.sample.min() + first.sample.max() + 1
    both: dict[str, np.ndarray] = {
        key: np.concatenate([np.asarray(getattr(data, key)) for data in (first, second)])
        for key in ("readings", "flanges", "approach")
    }
    return replace(
        first,
        name=name,
        sample=np.append(first.sample, numbers),
        observations=ObservationTable(*columns),
        source=first.source
        if first.source == second.source
        else f"{first.source}; {second.source}",
        **both,
    )

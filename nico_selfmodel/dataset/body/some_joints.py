"""The part of a recording that is about some of a body's joints."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.model.tree.body_tree import WORLD_NAME
from nico_selfmodel.names import listed


def of_joints(data: BodyDataset, joints: Collection[str]) -> BodyDataset:
    """Return what a recording tells of some joints: what they or the world carry, seen by the same.

    Args:
        joints: Names of the joints; what carries one of them is among them.

    Raises:
        DataError: If a joint is missing, or nothing is left.
    """
    if missing := [name for name in joints if name not in data.joint_names]:
        raise DataError(
            f"data set {data.name!r} has no joints {listed(missing)}; it has "
            f"{listed(data.joint_names)}"
        )
    columns = [i for i, name in enumerate(data.joint_names) if name in joints]
    links = {WORLD_NAME, *joints}
    table = data.observations
    marker = np.array([info.on in links for info in data.markers])
    sensor = np.array([info.on in links for info in data.sensors])
    other = np.append(marker, True)[table.other]
    kept = table.select(marker[table.marker] & sensor[table.sensor] & other)
    new, seeing = np.append(np.cumsum(marker) - 1, -1), np.cumsum(sensor) - 1
    return replace(
        data,
        joints=tuple(data.joints[i] for i in columns),
        markers=tuple(info for info in data.markers if info.on in links),
        sensors=tuple(info for info in data.sensors if info.on in links),
        readings=data.readings[:, columns],
        flanges=np.asarray(data.flanges)[:, columns],
        approach=np.asarray(data.approach)[:, columns],
        observations=replace(
            kept,
            marker=new[kept.marker],
            other=new[kept.other],
            sensor=seeing[kept.sensor],
        ),
    )

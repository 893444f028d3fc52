"""Whether a data set is of the same joints, read in the same units, as a self-model."""

import numpy as np

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import listed


def reading_columns(model: SelfModel, dataset: Dataset) -> list[int]:
    """Return the data set's columns of readings in the order of the model's joints.

    Raises:
        DataError: If the two have different joints.
    """
    if set(model.joints) != set(dataset.joint_names):
        raise DataError(
            f"data set {dataset.name!r} has the joints {listed(dataset.joint_names)}, the "
            f"self-model {listed(model.joints)}: they must be the same"
        )
    return [dataset.joint_names.index(joint) for joint in model.joints]


def check_units(model: SelfModel, dataset: Dataset) -> None:
    """Refuse readings in other units than the model's servos have.

    Raises:
        DataError: If a joint's unit, counts per turn or sign differ.
    """
    for joint in dataset.joints:
        i = model.joints.index(joint.name)
        expected = (model.servos.unit[i], model.servos.counts_per_turn[i], model.servos.sign[i])
        got = (joint.encoder_unit, float(joint.counts_per_turn or np.nan), float(joint.sign))
        same = got[0] == expected[0] and got[2] == expected[2]
        if not same or (got[0] == "counts" and got[1] != expected[1]):
            raise DataError(
                f"joint {joint.name} is read in {got[0]} ({got[1]} a turn, sign {got[2]:+.0f}) in "
                f"data set {dataset.name!r} but in {expected[0]} ({expected[1]} a turn, sign "
                f"{expected[2]:+.0f}) in the self-model"
            )

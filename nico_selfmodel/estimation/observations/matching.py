"""Whether a data set is of the joints, units and images of a self-model."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import listed


def reading_columns(model: SelfModel, dataset: Dataset) -> list[int]:
    """Return the data set's columns of readings in the order of the model's joints.

    Raises:
        DataError: If the two have different joints, or other units or images.
    """
    if set(model.joints) != set(dataset.joint_names):
        raise DataError(
            f"data set {dataset.name!r} has the joints {listed(dataset.joint_names)}, the "
            f"self-model {listed(model.joints)}: they must be the same"
        )
    _check_units(model, dataset)
    check_images(model, dataset)
    return [dataset.joint_names.index(joint) for joint in model.joints]


def check_images(model: SelfModel, dataset: Dataset) -> None:
    """Refuse pixels of images of another size than the model's cameras have.

    Raises:
        DataError: If the data set names the size, and a camera has another one.
    """
    for name, camera in model.cameras.items():
        if dataset.image_size not in (None, camera.image_size):
            (width, height), (w, h) = camera.image_size, dataset.image_size
            raise DataError(
                f"the {name} camera of {model.name!r} has {width} x {height} pixels, the images of "
                f"data set {dataset.name!r} have {w} x {h}"
            )


def check_markers(model: SelfModel, dataset: Dataset, seen: NDArray) -> None:
    """Refuse points that the model does not know.

    Args:
        seen: Rows that count. Boolean, shape (N,).

    Raises:
        DataError: If one of them is of such a point.
    """
    unknown = sorted(set(dataset.marker[seen].tolist()) - set(model.markers))
    if unknown:
        raise DataError(
            f"data set {dataset.name!r} tracks {listed(unknown)}, which the self-model does not "
            f"know; it knows {listed(model.markers)}"
        )


def _check_units(model: SelfModel, dataset: Dataset) -> None:
    """Refuse readings in other units than the model's servos have."""
    for joint in dataset.joints:
        i = model.joints.index(joint.name)
        expected = (model.servos.unit[i], model.servos.counts_per_turn[i], model.servos.sign[i])
        got = (joint.encoder_unit, float(joint.counts_per_turn or np.nan), float(joint.sign))
        same = got[0] == expected[0] and got[2] == expected[2]
        if not same or (got[0] == "counts" and got[1] != expected[1]):
            raise DataError(
                f"joint {joint.name} is read in {_read_in(*got)} in data set {dataset.name!r} but "
                f"in {_read_in(*expected)} in the self-model"
            )


def _read_in(unit: str, counts_per_turn: float, sign: float) -> str:
    """Return how a joint is read, in words; only counts have a turn."""
    turn = f"{counts_per_turn:g} a turn, " if unit == "counts" else ""
    return f"{unit} ({turn}sign {sign:+.0f})"

"""The folder that a change of a known self-model leaves behind."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nico_selfmodel.dataset import Dataset
from nico_selfmodel.model import SelfModel
from nico_selfmodel.plant import ArmDescription, learned_urdf
from nico_selfmodel.viz.folder import urdf_file, write_folder


def write_model_folder(
    folder: str | Path,
    model: SelfModel,
    document: Mapping[str, Any],
    texts: Mapping[str, str] | None = None,
    recordings: Mapping[str, Dataset] | None = None,
    *,
    force: bool = False,
) -> Path:
    """Write what `write_folder` writes, with the same arguments, and the URDF of an arm.

    Returns:
        The folder.

    Raises:
        FileExistsError: If the folder exists and `force` is not set.
        OSError: If it cannot be written.
        ModelError: If the robot that the model names is gone, or has other joints.
    """
    folder = Path(folder)
    contents = dict(texts or {})
    if model.has_arm:
        robot = ArmDescription.of_model(model)
        name = model.name if robot is None else Path(robot.robot).stem
        contents[urdf_file(name)] = learned_urdf(model, robot, folder=folder)
    return write_folder(folder, model, document, contents, recordings, force=force)

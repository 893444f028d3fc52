"""The folder that a change of a known self-model leaves behind."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nico_selfmodel.files import RESULT_FILE, folder_written_whole
from nico_selfmodel.model import SelfModel
from nico_selfmodel.plant import ArmDescription, learned_urdf
from nico_selfmodel.viz.result_folder import _file_name


def write_model_folder(
    folder: str | Path,
    model: SelfModel,
    document: Mapping[str, Any],
    texts: Mapping[str, str] | None = None,
    *,
    force: bool = False,
) -> Path:
    """Write `self_model.yaml`, `result.json` and, where there is an arm, the URDF, or nothing.

    Args:
        folder: The folder to make.
        model: The self-model.
        document: Content of `result.json`.
        texts: Further files, such as a report: name -> content.
        force: Replace an existing folder.

    Returns:
        The folder.

    Raises:
        FileExistsError: If the folder exists and `force` is not set.
        OSError: If it cannot be written.
        ModelError: If the robot that the model names is gone, or has other joints.
    """
    folder = Path(folder)
    contents = {RESULT_FILE: json.dumps(document, allow_nan=False, indent=1) + "\n"}
    contents |= texts or {}
    if model.has_arm:
        robot = ArmDescription.of_model(model)
        name = model.name if robot is None else Path(robot.robot).stem
        contents[f"{_file_name(name)}_learned.urdf"] = learned_urdf(model, robot, folder=folder)
    with folder_written_whole(folder, force=force) as inside:
        model.save(inside / "self_model.yaml")
        for name, text in contents.items():
            (inside / name).write_text(text, encoding="utf-8", newline="\n")
    return folder

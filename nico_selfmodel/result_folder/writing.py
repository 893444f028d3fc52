"""What every result folder holds, written whole or not at all."""

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.folder import save_dataset
from nico_selfmodel.files.whole import RESULT_FILE, folder_written_whole, write_whole
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.self_model_file import save_model
from nico_selfmodel.result_folder.description import kept_description

if TYPE_CHECKING:
    # What only other bodies than arms have is not loaded for arms.
    from nico_selfmodel.dataset.body.body_dataset import BodyDataset
    from nico_selfmodel.model.response.servo_response import ServoResponses
    from nico_selfmodel.model.shape.link_shape import BodyShape
    from nico_selfmodel.model.tree.body_model import BodyModel
    from nico_selfmodel.plant import ArmDescription

_LONGEST_NAME = 200  # of a robot in that of a file [bytes]


def write_result(
    folder: str | Path,
    model: "SelfModel | BodyModel | ServoResponses",
    document: Mapping[str, Any],
    texts: Mapping[str, str] | None = None,
    recordings: "Mapping[str, Dataset | BodyDataset] | None" = None,
    *,
    robot: "ArmDescription | None" = None,
    shape: "BodyShape | None" = None,
    force: bool = False,
) -> Path:
    """Write the model in its file, `result.json` and further files, or nothing.

    An arm's URDF goes with it. The robot's own description comes along, and is found by its place
    in the folder: a folder that is renamed, copied or sent away is whole.

    Args:
        folder: The folder to make.
        model: The self-model (`self_model.yaml`, `body.yaml`) or how servos respond
            (`servo_response.yaml`).
        document: Content of `result.json`.
        texts: Further files, such as a report or a scene: name -> content.
        recordings: Data sets to keep beside the result, in `recordings/<name>`.
        robot: The robot that the arm belongs to; the one that the model names if omitted.
        shape: What the body looks like as it was learned, to keep in `body`.

    Raises:
        FileExistsError: If the folder exists and `force` is not set.
        OSError: If it cannot be written.
        ModelError: If the robot that the model names is gone, or has other joints.
    """
    folder = Path(folder)
    contents = {RESULT_FILE: _as_json(document), **(texts or {})}
    with folder_written_whole(folder, force=force) as inside:
        if isinstance(model, SelfModel):
            contents |= _save_with_robot(model, inside, robot)
        else:
            _save_other(model, inside)
        if shape is not None:
            from nico_selfmodel.model.shape.shape_folder import FOLDER, save_shape

            save_shape(shape, inside / FOLDER)
        for name, text in contents.items():
            (inside / name).write_text(text, encoding="utf-8", newline="\n")
        for name, dataset in (recordings or {}).items():
            (inside / "recordings").mkdir(exist_ok=True)
            _save_recording(dataset, inside / "recordings" / name)
    return folder


def _save_other(model: "BodyModel | ServoResponses", folder: Path) -> None:
    """Write what is no self-model of an arm and cameras."""
    from nico_selfmodel.model.response.servo_response import (
        RESPONSE_FILE,
        ServoResponses,
        save_responses,
    )

    if isinstance(model, ServoResponses):
        save_responses(model, folder / RESPONSE_FILE)
        return
    from nico_selfmodel.model.tree.body_model import BODY_FILE, save_body

    save_body(model, folder / BODY_FILE)


def _save_recording(dataset: "Dataset | BodyDataset", folder: Path) -> None:
    if isinstance(dataset, Dataset):
        save_dataset(dataset, folder)
    else:
        from nico_selfmodel.dataset.body.body_folder import save_body_dataset

        save_body_dataset(dataset, folder)


def _save_with_robot(
    model: SelfModel, folder: Path, robot: "ArmDescription | None"
) -> dict[str, str]:
    """Write a self-model and its robot's description; return its URDF as a further file."""
    if robot is None and model.robot:
        from nico_selfmodel.plant import ArmDescription  # loads Drake's plant, for robots alone

        robot = ArmDescription.of_model(model)
    robot = kept_description(robot, folder)
    if robot is not None and model.robot:
        model = replace(model, robot={**model.robot, "urdf": robot.robot})
    save_model(model, folder / "self_model.yaml")
    return urdf_file(model, folder, robot)


def replace_document(folder: Path, document: Mapping[str, Any]) -> None:
    """Write `result.json` of a result folder anew, with what else became known.

    Raises:
        OSError: If it cannot be written.
    """
    write_whole(folder / RESULT_FILE, _as_json(document))


def _as_json(document: Mapping[str, Any]) -> str:
    return json.dumps(document, allow_nan=False, indent=1) + "\n"


def urdf_file(
    model: SelfModel, folder: str | Path, robot: "ArmDescription | None"
) -> dict[str, str]:
    """Return the URDF of a model's arm as a file of its result folder.

    Args:
        folder: Where the file will lie: relative mesh paths lead from there.
        robot: The robot that the arm belongs to; None where there is no description.

    Returns:
        `<robot>_learned.urdf` -> content; nothing for a model without an arm.

    Raises:
        ModelError: If the robot's file is gone, or has other joints.
    """
    if not model.has_arm:
        return {}
    from nico_selfmodel.plant import learned_urdf

    name = model.name if robot is None else Path(robot.robot).stem
    return {urdf_name(name): learned_urdf(model, robot, folder)}


def urdf_name(robot: str) -> str:
    """Return the name of a learned URDF, without what file systems or shells would stumble over.

    >>> urdf_name("../../my robot")
    'my_robot_learned.urdf'
    """
    plain = re.sub(r"[^\w.-]+", "_", robot).strip("._").encode()[:_LONGEST_NAME]
    return f"{plain.decode('utf-8', 'ignore') or 'robot'}_learned.urdf"

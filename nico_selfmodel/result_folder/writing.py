"""What every result folder holds, written whole or not at all."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.folder import save_dataset
from nico_selfmodel.files.whole import RESULT_FILE, folder_written_whole, write_whole
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.self_model_file import save_model
from nico_selfmodel.model.tree.body_model import BODY_FILE, BodyModel, save_body


def write_result(
    folder: str | Path,
    model: SelfModel | BodyModel,
    document: Mapping[str, Any],
    texts: Mapping[str, str] | None = None,
    recordings: Mapping[str, Dataset] | None = None,
    *,
    force: bool = False,
) -> Path:
    """Write `self_model.yaml` or `body.yaml`, `result.json` and further files, or nothing.

    Args:
        folder: The folder to make.
        model: The self-model.
        document: Content of `result.json`.
        texts: Further files, such as a report, a scene, a URDF: name -> content.
        recordings: Data sets to keep beside the result, in `recordings/<name>`.
        force: Replace an existing folder.

    Returns:
        The folder.

    Raises:
        FileExistsError: If the folder exists and `force` is not set.
        OSError: If it cannot be written.
    """
    folder = Path(folder)
    contents = {RESULT_FILE: _as_json(document), **(texts or {})}
    with folder_written_whole(folder, force=force) as inside:
        _save(model, inside)
        for name, text in contents.items():
            (inside / name).write_text(text, encoding="utf-8", newline="\n")
        for name, dataset in (recordings or {}).items():
            (inside / "recordings").mkdir(exist_ok=True)
            save_dataset(dataset, inside / "recordings" / name)
    return folder


def _save(model: SelfModel | BodyModel, folder: Path) -> None:
    if isinstance(model, BodyModel):
        save_body(model, folder / BODY_FILE)
    else:
        save_model(model, folder / "self_model.yaml")


def replace_document(folder: Path, document: Mapping[str, Any]) -> None:
    """Write `result.json` of a result folder anew, with what else became known.

    Args:
        folder: The folder.
        document: Content of the file.

    Raises:
        OSError: If it cannot be written.
    """
    write_whole(folder / RESULT_FILE, _as_json(document))


def _as_json(document: Mapping[str, Any]) -> str:
    return json.dumps(document, allow_nan=False, indent=1) + "\n"

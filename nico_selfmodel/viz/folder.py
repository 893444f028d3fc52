"""What every result folder holds, written whole or not at all."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nico_selfmodel.dataset import Dataset
from nico_selfmodel.files import RESULT_FILE, folder_written_whole
from nico_selfmodel.model import SelfModel
from nico_selfmodel.viz.scene import Scene

SCENE_FILE = "scene.json"
REPORT_FILE = "report.html"
_LONGEST_ROBOT = 200  # of a robot's name in that of a file [bytes]


def write_folder(
    folder: str | Path,
    model: SelfModel,
    document: Mapping[str, Any],
    texts: Mapping[str, str] | None = None,
    recordings: Mapping[str, Dataset] | None = None,
    *,
    force: bool = False,
) -> Path:
    """Write `self_model.yaml`, `result.json` and further files, or nothing.

    Args:
        folder: The folder to make.
        model: The self-model.
        document: Content of `result.json`.
        texts: Further files, such as a report: name -> content.
        recordings: Data sets to keep beside the result, in `recordings/<name>`.
        force: Replace an existing folder.

    Returns:
        The folder.

    Raises:
        FileExistsError: If the folder exists and `force` is not set.
        OSError: If it cannot be written.
    """
    folder = Path(folder)
    contents = {RESULT_FILE: json.dumps(document, allow_nan=False, indent=1) + "\n"}
    contents |= texts or {}
    with folder_written_whole(folder, force=force) as inside:
        model.save(inside / "self_model.yaml")
        for name, text in contents.items():
            (inside / name).write_text(text, encoding="utf-8", newline="\n")
        for name, dataset in (recordings or {}).items():
            (inside / "recordings").mkdir(exist_ok=True)
            dataset.save(inside / "recordings" / name)
    return folder


def shown(report: str, scene: Scene) -> dict[str, str]:
    """Return the files that show a result: its report, and its scene for `view`."""
    return {REPORT_FILE: report, SCENE_FILE: scene.to_json()}


def urdf_file(robot: str) -> str:
    """Return the name of a learned URDF, without what file systems or shells would stumble over."""
    plain = re.sub(r"[^\w.-]+", "_", robot).strip("._").encode()[:_LONGEST_ROBOT]
    return f"{plain.decode('utf-8', 'ignore') or 'robot'}_learned.urdf"

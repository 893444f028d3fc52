"""What `nico-selfmodel learn --mirror` leaves behind and prints of the mirror."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nico_selfmodel.experiments.mirror_lesson import MirrorLesson

FOLDER = "mirror"
"""Folder within the result folder: the mirror's own report."""


def write_mirror_lesson(
    out: Path, document: Mapping[str, Any], lesson: "MirrorLesson"
) -> dict[str, Any]:
    """Add the mirror to a result folder: its recordings, its report, its figures.

    Args:
        out: The folder, whose self-model knows the mirror already.
        document: What is in its `result.json`.
        lesson: What was learned of the mirror.

    Returns:
        What is in `result.json` now: the mirror's own document under `mirror`.
    """
    from nico_selfmodel.files import RESULT_FILE, write_whole
    from nico_selfmodel.plant import ArmDescription
    from nico_selfmodel.viz.mirror_report import write_mirror_folder

    found = lesson.document
    (name,) = lesson.calibration.mirrors
    write_mirror_folder(
        out / FOLDER,
        lesson.calibration,
        lesson.verdict,
        found,
        pictures={name: lesson.picture},
        robot=ArmDescription.of_model(lesson.model),
    )
    for name, data in (("mirror", lesson.train), ("mirror_test", lesson.test)):
        data.save(out / "recordings" / name)
    whole = {**document, "mirror": found}
    if found["status"] == "FAIL":
        reasons = [f"the mirror: {reason}" for reason in found["reasons"]]
        whole |= {"status": "FAIL", "reasons": [*document["reasons"], *reasons]}
    write_whole(out / RESULT_FILE, json.dumps(whole, allow_nan=False, indent=1) + "\n")
    return whole


def mirror_parts(document: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any] | None]]:
    """Return the errors of the hand as predicted in the mirror, if one was learned."""
    found = document.get("mirror")
    if found is None:
        return []
    return [("held out, in the mirror", found["test"]), ("training, in it", found["train"])]

"""What `nico-selfmodel learn --mirror` leaves behind and prints of the mirror."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nico_selfmodel.cli import console

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
    from nico_selfmodel.plant import ArmDescription
    from nico_selfmodel.result_folder.writing import replace_document, write_result
    from nico_selfmodel.viz.reports.mirrors import mirror_report

    found = lesson.document
    (name,) = lesson.calibration.mirrors
    robot = ArmDescription.of_model(lesson.model)
    report = mirror_report(lesson.calibration, found, {name: lesson.picture}, robot)
    write_result(out / FOLDER, lesson.calibration.model, found, report.files())
    for name, data in (("mirror", lesson.train), ("mirror_test", lesson.test)):
        data.save(out / "recordings" / name)
    whole = {**document, "mirror": found}
    if found["status"] == "FAIL":
        reasons = [f"the mirror: {reason}" for reason in found["reasons"]]
        whole |= {"status": "FAIL", "reasons": [*document["reasons"], *reasons]}
    replace_document(out, whole)
    return whole


def print_mirror_lesson(document: Mapping[str, Any]) -> None:
    """Print how well the hand is predicted in the mirror, beside the direct view."""
    found = document["mirror"]
    rows = []
    for label, block in (("held out, in the mirror", found["test"]), ("training", found["train"])):
        pixels, position = block["pixels"], block["position_mm"]
        rows.append(
            [
                label,
                str(block["n"]),
                f"{pixels['mean']:.2f}",
                f"{pixels['sd']:.2f}",
                f"{position['mean']:.2f}",
                f"{position['sd']:.2f}",
            ]
        )
    (place,) = found["mirrors"].values()
    console.print_table(
        f"a mirror {place['distance_mm']:.0f} mm before the left eye, its normal known to "
        f"{place['normal_sigma_deg']:.2f} deg",
        ("reflection of the hand", "n", "px", "SD", "mm", "SD"),
        rows,
    )

"""What `nico-selfmodel learn --mirror` leaves behind and prints of the mirror."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nico_selfmodel.cli import console

if TYPE_CHECKING:
    from nico_selfmodel.experiments.mirror_lesson import MirrorScenario

FOLDER = "mirror"
"""Folder within the result folder: the mirror's own report."""


def write_mirror_scenario(
    out: Path, document: Mapping[str, Any], scenario: "MirrorScenario"
) -> dict[str, Any]:
    """Add the mirror to a result folder: its recordings, its report, its figures.

    Args:
        out: The folder, whose self-model knows the mirror already.
        document: What is in its `result.json`.
        scenario: What was learned of the mirror.

    Returns:
        What is in `result.json` now: the mirror's own document under `mirror`.
    """
    from nico_selfmodel.plant import ArmDescription
    from nico_selfmodel.viz.mirror_report import write_mirror_folder

    found = scenario.document
    (name,) = scenario.calibration.mirrors
    write_mirror_folder(
        out / FOLDER,
        scenario.calibration,
        scenario.verdict,
        found,
        pictures={name: scenario.picture},
        robot=ArmDescription.of_model(scenario.model),
    )
    for name, data in (("mirror", scenario.train), ("mirror_test", scenario.test)):
        data.save(out / "recordings" / name)
    whole = {**document, "mirror": found}
    if found["status"] == "FAIL":
        reasons = [f"the mirror: {reason}" for reason in found["reasons"]]
        whole |= {"status": "FAIL", "reasons": [*document["reasons"], *reasons]}
    console.write_document(out, whole)
    return whole


def print_mirror_scenario(document: Mapping[str, Any]) -> None:
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

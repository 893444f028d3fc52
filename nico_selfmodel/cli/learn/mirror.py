"""What `nico-selfmodel learn --mirror` leaves behind and prints of the mirror."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nico_selfmodel.cli.result_files import stamped, write_with_report

if TYPE_CHECKING:
    from nico_selfmodel.sessions.mirrors.mirror_scenario import MirrorScenario

FOLDER = "mirror"
"""Folder within the result folder: the mirror's own report."""


def write_mirror_scenario(
    out: Path, document: Mapping[str, Any], scenario: "MirrorScenario"
) -> dict[str, Any]:
    """Add mirrors to a result folder: their recordings, their report, their figures.

    Args:
        out: The folder, whose self-model knows the mirrors already.
        document: What is in its `result.json`.

    Returns:
        What is in `result.json` now: the mirrors' own document under `mirror`.
    """
    from nico_selfmodel.dataset.folder import save_dataset
    from nico_selfmodel.plant import ArmDescription
    from nico_selfmodel.result_folder.writing import replace_document
    from nico_selfmodel.viz.reports.mirrors import mirror_report

    found = stamped(scenario.document)
    first = next(iter(scenario.calibration.mirrors))
    robot = ArmDescription.of_model(scenario.model)
    report = mirror_report(scenario.calibration, found, {first: scenario.picture}, robot)
    write_with_report(out / FOLDER, scenario.calibration.model, report)
    for name, data in (("mirror", scenario.train), ("mirror_test", scenario.test)):
        save_dataset(data, out / "recordings" / name)
    whole = {**document, "mirror": found}
    if found["status"] == "FAIL":
        reasons = [f"the mirror: {reason}" for reason in found["reasons"]]
        whole |= {"status": "FAIL", "reasons": [*document["reasons"], *reasons]}
    replace_document(out, whole)
    return whole


def mirror_parts(document: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any] | None]]:
    """Return the errors of the hand as predicted in the mirror, if one was learned."""
    found = document.get("mirror")
    if found is None:
        return []
    return [("held out, in the mirror", found["test"]), ("training, in it", found["train"])]

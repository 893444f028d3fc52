"""The second stage of the mirror test in the report: how far mirrors are from where they stand."""

from typing import Any

import numpy as np

from nico_selfmodel.experiments.experiment_report import Table
from nico_selfmodel.experiments.mirror_test.stage_document import stage_document
from nico_selfmodel.experiments.mirror_test.unknown_mirror import HAND, WHOLE, MirrorsStage

BOUNDS = {HAND: (0.3, 2.0), WHOLE: (0.1, 0.5)}
"""By what a robot has seen of itself in a mirror: how far that may be off [deg, mm]."""
ENOUGH = 10
"""Mirrors that a verdict takes."""


def mirrors_document(stage: MirrorsStage) -> dict[str, Any]:
    """Return the stage as plain data, with its status."""
    rows = [_row(stage, by) for by in BOUNDS if any(one.by == by for one in stage.places)]
    failed = [f"robot {one.robot} does not trust a mirror: {one.reason}" for one in stage.refusals]
    failed += [
        f"by {row['by']} {row['beyond']} of {row['mirrors']} mirrors are more than "
        f"{row['bound_deg']:g} deg or {row['bound_mm']:g} mm off"
        for row in rows
        if row["beyond"]
    ]
    count = rows[-1]["mirrors"] if rows else 0
    said = "no mirror was learned"
    if rows:
        said = (
            f"{count} mirrors are at most {rows[-1]['largest_deg']:.2f} deg and "
            f"{rows[-1]['largest_mm']:.2f} mm off"
        )
    lacking = f"{said}, {ENOUGH} mirrors are needed" if count < ENOUGH else None
    return stage_document("2", "an unknown mirror", failed, lacking, said, mirrors=rows)


def any_beyond(stage: MirrorsStage) -> bool:
    """Return whether a mirror that a robot trusts is not where it says."""
    return any(row["beyond"] for row in mirrors_document(stage)["mirrors"])


def _row(stage: MirrorsStage, by: str) -> dict[str, Any]:
    """Return what is told of mirrors by one part of the body."""
    own = [one for one in stage.places if one.by == by]
    degrees = np.degrees([one.angle for one in own])
    mm = 1e3 * np.abs([one.distance for one in own])
    most = BOUNDS[by]
    return {
        "by": by,
        "mirrors": len(own),
        "median_deg": float(np.median(degrees)),
        "largest_deg": float(np.max(degrees)),
        "bound_deg": most[0],
        "median_mm": float(np.median(mm)),
        "largest_mm": float(np.max(mm)),
        "bound_mm": most[1],
        "beyond": int(np.sum((degrees > most[0]) | (mm > most[1]))),
        "chi_square": float(np.mean([one.chi_square for one in own])),
    }


def mirrors_table(stage: MirrorsStage) -> Table:
    """Return a row for each part of the body."""
    headings = (
        "told by", "mirrors", "median, largest [deg]", "bound [deg]", "median, largest [mm]",
        "bound [mm]", "mean chi² / 3",
    )  # fmt: skip
    rows = [
        [
            row["by"],
            str(row["mirrors"]),
            f"{row['median_deg']:.3f}, {row['largest_deg']:.3f}",
            f"{row['bound_deg']:g}",
            f"{row['median_mm']:.2f}, {row['largest_mm']:.2f}",
            f"{row['bound_mm']:g}",
            f"{row['chi_square'] / 3.0:.2f}",
        ]
        for row in mirrors_document(stage)["mirrors"]
    ]
    return Table("Stage 2: where a mirror stands", headings, rows, "\n")

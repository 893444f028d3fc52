"""Stage 7 of the mirror test in the report: marks touched, and ways that touch nothing else."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from nico_selfmodel.experiments.experiment_report import Table
from nico_selfmodel.experiments.mirror_test.stage_document import stage_document
from nico_selfmodel.experiments.mirror_test.touches import PLANS, TouchStage, TouchTrial

LEAST_TOUCHED = 0.90
"""Share of the marks in reach that must be touched within their radius."""
ENOUGH_TOUCHES = 20
"""Marks in reach that a verdict takes."""


def touches_document(stage: TouchStage) -> dict[str, Any]:
    """Return the stage as plain data, with its status."""
    inside = [one for one in stage.marks if one.in_reach]
    beyond = [one for one in stage.marks if not one.in_reach]
    touched = sum(one.touched for one in inside)
    said = sum(one.executed is None for one in beyond)
    words = (
        f"{touched} of {len(inside)} marks in reach are touched within their radius, 'out of "
        f"reach' is said of {said} of {len(beyond)} others, {len(stage.plans)} ways collide with "
        "nothing"
    )
    few = len(inside) < ENOUGH_TOUCHES or len(stage.plans) < PLANS
    needed = f"{ENOUGH_TOUCHES} marks in reach and {PLANS} ways are needed"
    return stage_document(
        "7",
        "touch",
        _failed(stage, inside, touched, len(beyond) - said),
        f"{words}; {needed}" if few else None,
        words,
        not_judged=["how the arm comes to where the way begins", "how hard the finger presses"],
        marks=_row(stage.marks),
        out_of_reach=len(beyond),
        out_of_reach_said=said,
        plans=_row(stage.plans),
        drawn=stage.drawn,
        robots_by_learned_shape=stage.shaped,
    )


def _failed(
    stage: TouchStage, inside: Sequence[TouchTrial], touched: int, unsaid: int
) -> list[str]:
    """Return what fails the stage."""
    failed = []
    if inside and touched < LEAST_TOUCHED * len(inside):
        failed.append(
            f"{touched} of {len(inside)} marks in reach are touched within their radius, "
            f"{100 * LEAST_TOUCHED:.0f} of 100 must be"
        )
    if unsaid:
        failed.append(f"of {unsaid} marks that are out of reach the robot does not say so")
    for what, trials in (("marks", stage.marks), ("ways to places drawn", stage.plans)):
        hurt = [one for one in trials if one.collided]
        if hurt and hurt[0].executed is not None:
            failed.append(
                f"{len(hurt)} of {len(trials)} {what}: something else touches the body, "
                f"{hurt[0].executed.nearest} for one"
            )
    return failed


def _row(trials: Sequence[TouchTrial]) -> dict[str, Any]:
    """Return what happened to some places."""
    done = [one.executed for one in trials if one.executed is not None]
    off = 1e3 * np.array([one.off for one in done])
    clear = 1e3 * np.array([one.clearance for one in done])
    return {
        "places": len(trials),
        "in_reach": sum(one.in_reach for one in trials),
        "gone_to": len(done),
        "gone_again": sum(one.tries > 1 for one in done),
        "touched": sum(one.touched for one in trials),
        "collided": sum(one.collided for one in trials),
        "off_median_mm": float(np.median(off)) if done else None,
        "off_p95_mm": float(np.percentile(off, 95)) if done else None,
        "off_max_mm": float(off.max()) if done else None,
        "gap_mm": [1e3 * f([one.gap for one in done]) for f in (min, max)] if done else None,
        "clearance_least_mm": float(clear.min()) if done else None,
    }


def touches_table(stage: TouchStage) -> Table:
    """Return a row for the marks, and one for places drawn anywhere."""
    headings = (
        "of", "places", "in reach", "gone to", "gone again", "touched", "collided",
        "off: median, p95, max mm", "least distance of the rest mm",
    )  # fmt: skip
    counted = "places", "in_reach", "gone_to", "gone_again", "touched", "collided"
    rows = []
    for name, trials in (("marks found", stage.marks), ("places drawn, with a way", stage.plans)):
        row = _row(trials)
        counts = (row[k] for k in counted)
        numbers = ["-", "-"]
        if row["gone_to"]:
            off = (row[f"off_{k}_mm"] for k in ("median", "p95", "max"))
            numbers = [", ".join(f"{x:.1f}" for x in off), f"{row['clearance_least_mm']:.1f}"]
        rows.append([name, *map(str, counts), *numbers])
    return Table("Stage 7: touching marks", headings, rows, "\n")

"""The fourth stage of the mirror test in the report: looks at an unmarked body."""

from typing import Any

import numpy as np

from nico_selfmodel.experiments.experiment_report import Table
from nico_selfmodel.experiments.mirror_test.stage_document import stage_document
from nico_selfmodel.experiments.mirror_test.unmarked import LIGHTS, Look, UnmarkedStage
from nico_selfmodel.viz.figures.mirror_test.surprise_plot import surprise_plot

MOST = 0.01
"""Bound of the false alarms a look."""
ENOUGH = 100
"""Looks that a rate of one in a hundred takes."""


def unmarked_document(stage: UnmarkedStage) -> dict[str, Any]:
    """Return the stage as plain data, with its status."""
    looks = len(stage.looks)
    surprised = sum(look.alarms > 0 for look in stage.looks)
    said = f"{surprised} of {looks} looks at an unmarked body surprise"
    return stage_document(
        "4",
        "expected picture, unmarked body and arm",
        [f"{said}, at most 1 in 100 may"] if surprised > MOST * looks else [],
        f"{said}, {ENOUGH} looks are needed" if looks < ENOUGH else None,
        said,
        not_judged=["the hand that moves and its wrist, to which things are attached", "the room"],
        lights=[_row(light, stage.looks) for light in LIGHTS],
        paints=[
            {
                "robot": one.robot,
                "described_off": one.described.tolist(),
                "learned_off": one.learned.tolist(),
                "sigma": one.sigma.tolist(),
            }
            for one in stage.paints
        ],
        surprising=[
            {"robot": look.robot, "light": look.light, "where": list(look.where)}
            for look in stage.looks
            if look.alarms
        ],
    )


def _row(light: float, looks: tuple[Look, ...]) -> dict[str, Any]:
    """Return what happened in one light."""
    own = [look for look in looks if look.light == light]
    return {
        "light": light,
        "looks": len(own),
        "surprised": sum(look.alarms > 0 for look in own),
        "alarms": sum(look.alarms for look in own),
        "gain": float(np.mean([look.gains for look in own])) if own else None,
        "judged_px": float(np.mean([look.judged for look in own])) if own else None,
        "judged_arm_px": float(np.mean([look.judged_arm for look in own])) if own else None,
        "chi_square": float(np.mean([look.chi_square for look in own])) if own else None,
    }


def unmarked_table(stage: UnmarkedStage) -> Table:
    """Return a row for each light."""
    headings = (
        "light",
        "looks",
        "surprised",
        "gain found",
        "judged px",
        "of the arm",
        "mean z² / 3",
    )
    rows = [
        [
            f"{row['light']:.1f}",
            str(row["looks"]),
            str(row["surprised"]),
            f"{row['gain']:.3f}",
            f"{row['judged_px']:.0f}",
            f"{row['judged_arm_px']:.0f}",
            f"{row['chi_square'] / 3.0:.2f}",
        ]
        for row in unmarked_document(stage)["lights"]
        if row["looks"]
    ]
    return Table("Stage 4: the unmarked body in the mirror", headings, rows, "\n")


def paints_table(stage: UnmarkedStage) -> Table:
    """Return a row for each robot."""
    headings = ("robot", "paints", "described", "learned", "learned, largest", "sigma")
    rows = [
        [
            str(one.robot),
            str(len(one.sigma)),
            *(f"{100.0 * f(part):.1f} %" for f, part in (
                (np.median, one.described), (np.median, one.learned), (np.max, one.learned),
                (np.median, one.sigma))),
        ]
        for one in stage.paints if len(one.sigma)
    ]  # fmt: skip
    title = "Stage 4: what the colours of its paints are off by (median)"
    return Table(title, headings, rows, "\n")


def unmarked_chart(stage: UnmarkedStage) -> Any:
    """Draw one look: seen, expected, surprise."""
    looks = {
        one.side: (one.picture, one.expected.picture, one.surprise.chi_square)
        for one in stage.shown
    }
    places = {one.side: [(blob.u, blob.v) for blob in one.blobs] for one in stage.shown}
    count = sum(map(len, places.values()))
    title = (
        "An unmarked body looks as it expected"
        if not count
        else f"{count} place(s) surprise, though nothing is there"
    )
    return surprise_plot(looks, places, title)

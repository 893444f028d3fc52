"""The third stage of the mirror test in the report: the learned shape of head and chest."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.experiments.experiment_report import Table
from nico_selfmodel.experiments.mirror_test.stage_document import stage_document
from nico_selfmodel.experiments.mirror_test.structure import NEAR, LinkStructure, StructureStage
from nico_selfmodel.viz.figures.mirror_test.structure_plot import ShownLink, structure_plot

MEDIAN, P90 = 2.0, 5.0
"""Bounds of what a surface is off by [mm]."""
HONEST = (0.8, 1.3)
"""Bounds of the root mean square of errors over their sigmas."""
FAR, MOST = 10.0, 0.02
"""What is farther off is claimed wrongly [mm]; share of a surface that may be, and that may be
claimed though no camera saw it."""
ENOUGH = 5
"""Robots that a verdict takes."""


def structure_document(stage: StructureStage) -> dict[str, Any]:
    """Return the stage as plain data, with its status."""
    rows = [_row(stage, link) for link in dict.fromkeys(one.link for one in stage.links)]
    failed = [f"robot {one.robot} learned no shape: {one.reason}" for one in stage.refusals]
    failed += [reason for row in rows for reason in _missed(row)]
    said = "; ".join(
        f"{row['link']} is {row['median_mm']:.1f} mm off (median), {row['p90_mm']:.1f} mm (90 of "
        "100)"
        for row in rows
    )
    robots = len({one.robot for one in stage.links})
    lacking = f"{said}; {ENOUGH} robots are needed" if robots < ENOUGH else None
    return stage_document(
        "3", "structure: head and chest", failed, lacking, said,
        mirrors=stage.mirrors, links=rows, robots=[_one(one) for one in stage.links],
    )  # fmt: skip


def _row(stage: StructureStage, link: str) -> dict[str, Any]:
    """Return what was learned of one link by all robots."""
    own = [one for one in stage.links if one.link == link]
    return {
        "link": link,
        **_figures(np.concatenate([o.off for o in own]), np.concatenate([o.sigma for o in own])),
        "unseen": float(np.mean([one.unseen for one in own])),
        "covered": float(np.mean([one.covered for one in own])),
        "strange": float(np.mean([one.strange for one in own])),
    }


def _one(one: LinkStructure) -> dict[str, Any]:
    """Return what one robot learned of one link."""
    return {
        "robot": one.robot, "link": one.link, **_figures(one.off, one.sigma),
        "unseen": one.unseen, "covered": one.covered, "strange": one.strange,
    }  # fmt: skip


def _figures(off: NDArray, sigma: NDArray) -> dict[str, float]:
    """Return what vertices are off by, and how well they say so."""
    if not len(off):
        return dict.fromkeys(("median_mm", "p90_mm", "outside_mm", "far", "rms_sigma"), np.inf)
    mm = 1e3 * np.abs(off)
    return {
        "median_mm": float(np.median(mm)),
        "p90_mm": float(np.percentile(mm, 90.0)),
        "outside_mm": float(1e3 * np.median(off)),
        "far": float(np.mean(mm > FAR)),
        "rms_sigma": float(np.sqrt(np.mean((off / sigma) ** 2))),
    }


def _missed(row: dict[str, Any]) -> list[str]:
    """Return which bounds a link misses."""
    link, reasons = row["link"], []
    if row["median_mm"] > MEDIAN or row["p90_mm"] > P90:
        reasons.append(
            f"{link} is {row['median_mm']:.1f} mm off (median, bound {MEDIAN:g}) and "
            f"{row['p90_mm']:.1f} mm (90 of 100, bound {P90:g})"
        )
    if not HONEST[0] <= row["rms_sigma"] <= HONEST[1]:
        reasons.append(
            f"{link} is off by {row['rms_sigma']:.2f} times its sigma, bounds {HONEST[0]:g} and "
            f"{HONEST[1]:g}"
        )
    for key, what in (("far", f"are more than {FAR:g} mm off"), ("unseen", "were never seen")):
        if row[key] > MOST:
            reasons.append(
                f"{100.0 * row[key]:.1f} of 100 places claimed of {link} {what}, {100.0 * MOST:g} "
                "may be"
            )
    return reasons


def structure_table(stage: StructureStage) -> Table:
    """Return a row for each link of each robot, and one for all robots."""
    headings = (
        "robot", "link", "off: median, 90 % [mm]", "outside [mm]", "error / sigma",
        f"over {FAR:g} mm off", "never seen", f"seen, to {1e3 * NEAR:g} mm", "other link",
    )  # fmt: skip
    document = structure_document(stage)
    rows = [
        [
            str(row.get("robot", "all")),
            row["link"],
            f"{row['median_mm']:.1f}, {row['p90_mm']:.1f}",
            f"{row['outside_mm']:.1f}",
            f"{row['rms_sigma']:.2f}",
            f"{100.0 * row['far']:.1f} %",
            f"{100.0 * row['unseen']:.1f} %",
            f"{100.0 * row['covered']:.0f} %",
            f"{100.0 * row['strange']:.1f} %",
        ]
        for row in (*document["robots"], *document["links"])
    ]
    title = f"Stage 3: the shape of head and chest, learned in {stage.mirrors} mirrors"
    return Table(title, headings, rows, "\n")


def structure_chart(stage: StructureStage) -> Any:
    """Draw the shape that the first robot learned, which learned any: errors, sigmas and cuts."""
    first = next(one.robot for one in stage.links if len(one.off))
    own = [one for one in stage.links if one.robot == first and len(one.off)]
    shown = [ShownLink(one.link, one.mesh, one.p_LT, one.sigma) for one in own]
    mm = 1e3 * np.median(np.abs(np.concatenate([one.off for one in own])))
    return structure_plot(shown, f"Head and chest as learned in mirrors: {mm:.1f} mm off (median)")

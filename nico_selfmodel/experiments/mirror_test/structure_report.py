"""The third stage of the mirror test in the report: the learned shapes of links."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from nico_selfmodel.experiments.experiment_report import Table
from nico_selfmodel.experiments.mirror_test.link_structure import NEAR, LinkStructure
from nico_selfmodel.experiments.mirror_test.stage_document import stage_document
from nico_selfmodel.experiments.mirror_test.structure import StructureStage
from nico_selfmodel.sessions.shapes.own_arm import ARM_LINKS
from nico_selfmodel.viz.figures.mirror_test.structure_plot import ShownLink, structure_plot

MEDIAN, P90 = 2.0, 5.0
"""Bounds of what a surface is off by [mm]."""
HONEST = (0.8, 1.3)
"""Bounds of the root mean square of errors over their sigmas."""
_PATCH, _NORMAL = 0.05, 2.576
"""Sides of the patches whose errors count as independent [m]; standard deviations that a normal
number is within in 99 of 100."""
FAR, MOST = 10.0, 0.02
"""What is farther off is claimed wrongly [mm]; share of a surface that may be, and that may be
claimed though no camera saw it."""
ENOUGH = 5
"""Robots that a verdict takes."""


def structure_document(stage: StructureStage) -> dict[str, Any]:
    """Return the stage as plain data, with its status."""
    rows = [_row(stage, link) for link in dict.fromkeys(one.link for one in stage.links)]
    failed = [f"robot {one.robot} learned {one.reason}" for one in stage.refusals]
    failed += [reason for row in rows for reason in _missed(row)]
    said = "; ".join(
        f"{row['link']} is {row['median_mm']:.1f} mm off (median), {row['p90_mm']:.1f} mm (90 of "
        "100)"
        for row in rows
    )
    robots = len({one.robot for one in stage.links})
    lacking = f"{said}; {ENOUGH} robots are needed" if robots < ENOUGH else None
    return stage_document(
        "3", "structure: head, chest, forearm and hand", failed, lacking, said,
        mirrors=stage.mirrors, poses=stage.poses, links=rows,
        robots=[_one(one) for one in stage.links],
    )  # fmt: skip


def _row(stage: StructureStage, link: str) -> dict[str, Any]:
    """Return what was learned of one link by all robots."""
    own = [one for one in stage.links if one.link == link]
    return {
        "link": link,
        **_figures(own),
        "unseen": float(np.mean([one.unseen for one in own])),
        "covered": float(np.mean([one.covered for one in own])),
        "strange": float(np.mean([one.strange for one in own])),
    }


def _one(one: LinkStructure) -> dict[str, Any]:
    """Return what one robot learned of one link."""
    return {
        "robot": one.robot, "link": one.link, **_figures([one]),
        "unseen": one.unseen, "covered": one.covered, "strange": one.strange,
    }  # fmt: skip


def _figures(links: Sequence[LinkStructure]) -> dict[str, float]:
    """Return what vertices are off by, and how well they say so."""
    off, sigma = (
        np.concatenate([getattr(one, name) for one in links]) for name in ("off", "sigma")
    )
    if not len(off):
        names = "median_mm", "p90_mm", "outside_mm", "far", "rms_sigma"
        return dict.fromkeys((*names, "rms_sigma_least", "rms_sigma_most"), np.inf)
    mm = 1e3 * np.abs(off)
    least, most = _within(links)
    return {
        "median_mm": float(np.median(mm)),
        "p90_mm": float(np.percentile(mm, 90.0)),
        "outside_mm": float(1e3 * np.median(off)),
        "far": float(np.mean(mm > FAR)),
        "rms_sigma": float(np.sqrt(np.mean((off / sigma) ** 2))),
        "rms_sigma_least": least,
        "rms_sigma_most": most,
    }


def _within(links: Sequence[LinkStructure]) -> tuple[float, float]:
    """Return within what the root mean square of error over sigma is known, in 99 of 100 cases.

    Errors of neighbours are alike, so that few patches tell it. Of B patches with N_b vertices
    each, N in all, whose squares add up to S_b, the mean square is a ratio of sums,

        s^2 = sum S_b / N,    var s^2 = B / (B - 1) sum (S_b - s^2 N_b)^2 / N^2

    (Cochran 1977, 6.4). It is taken for a chi-square over nu = 2 s^4 / var s^2 degrees of freedom
    (Satterthwaite 1946), whose quantiles are (1 - a +- z sqrt(a))^3 with a = 2 / (9 nu) (Wilson and
    Hilferty 1931). What a robot errs by over all of a link it tells only beside other robots.
    """
    counts, sums = [], []
    for one in links:
        cells = np.floor(one.mesh.vertices / _PATCH).astype(int)
        patch = np.unique(cells, axis=0, return_inverse=True)[1].ravel()
        counts.append(np.bincount(patch))
        sums.append(np.bincount(patch, (one.off / one.sigma) ** 2))
    count, total = np.concatenate(counts), np.concatenate(sums)
    mean, patches = total.sum() / count.sum(), len(count)
    apart = np.sum((total - mean * count) ** 2) * patches / max(patches - 1, 1)
    share = apart / (count.sum() * max(mean, 1e-300)) ** 2 / 9.0
    low, high = (max(1.0 - share + z * np.sqrt(share), 0.0) ** 3 for z in (-_NORMAL, _NORMAL))
    return float(np.sqrt(mean / high)), float(np.sqrt(mean / low)) if low > 0.0 else np.inf


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
            f"{link} is off by {row['rms_sigma']:.2f} times its sigma ({_range(row)} in 99 of 100 "
            f"cases), bounds {HONEST[0]:g} and {HONEST[1]:g}"
        )
    for key, what in (("far", f"are more than {FAR:g} mm off"), ("unseen", "were never seen")):
        if row[key] > MOST:
            reasons.append(
                f"{100.0 * row[key]:.1f} of 100 places claimed of {link} {what}, {100.0 * MOST:g} "
                "may be"
            )
    return reasons


def _range(row: dict[str, Any]) -> str:
    """Return within what error over sigma is known."""
    return f"{row['rms_sigma_least']:.2f} to {row['rms_sigma_most']:.2f}"


def structure_table(stage: StructureStage) -> Table:
    """Return a row for each link of each robot, and one for all robots."""
    headings = (
        "robot", "link", "off: median, 90 % [mm]", "outside [mm]",
        f"error / sigma (99 of 100), bounds {HONEST[0]:g}, {HONEST[1]:g}",
        f"over {FAR:g} mm off", "never seen", f"seen, to {1e3 * NEAR:g} mm", "other link",
    )  # fmt: skip
    document = structure_document(stage)
    rows = [
        [
            str(row.get("robot", "all")),
            row["link"],
            f"{row['median_mm']:.1f}, {row['p90_mm']:.1f}",
            f"{row['outside_mm']:.1f}",
            f"{row['rms_sigma']:.2f} ({_range(row)})",
            f"{100.0 * row['far']:.1f} %",
            f"{100.0 * row['unseen']:.1f} %",
            f"{100.0 * row['covered']:.0f} %",
            f"{100.0 * row['strange']:.1f} %",
        ]
        for row in (*document["robots"], *document["links"])
    ]
    title = (
        f"Stage 3: the shape of head and chest, learned in {stage.mirrors} mirrors, and of forearm "
        f"and hand, in {stage.poses} poses without one"
    )
    return Table(title, headings, rows, "\n")


def structure_charts(stage: StructureStage) -> dict[str, Any]:
    """Draw what the first robot learned, which learned any: errors, sigmas and cuts.

    Returns:
        Chart by name, of links that stand still and of those that move; without those of which
        nothing was learned.
    """
    of_arm = [one for one in stage.links if one.link in ARM_LINKS]
    others = [one for one in stage.links if one.link not in ARM_LINKS]
    drawn = {
        "structure": (others, "Head and chest as learned in mirrors", True),
        "arm": (of_arm, "Forearm and hand as learned without a mirror", False),
    }
    return {
        name: _chart(links, title, mirrored)
        for name, (links, title, mirrored) in drawn.items()
        if any(len(one.off) for one in links)
    }


def _chart(links: Sequence[LinkStructure], title: str, mirrored: bool) -> Any:
    first = next(one.robot for one in links if len(one.off))
    own = [one for one in links if one.robot == first and len(one.off)]
    shown = [ShownLink(one.mesh, one.p_LT, one.sigma) for one in own]
    mm = 1e3 * np.median(np.abs(np.concatenate([one.off for one in own])))
    return structure_plot(shown, f"{title}: {mm:.1f} mm off (median)", mirrored=mirrored)

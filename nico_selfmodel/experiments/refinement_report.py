"""Tables and charts of chapter 8, ours beside the thesis' figures 8.2 to 8.5."""

from dataclasses import asdict
from typing import Any

from nico_selfmodel.experiments.experiment_report import (
    ExperimentReport,
    Table,
    bars,
    bodies,
    spread,
)
from nico_selfmodel.experiments.irreducible_error import Limit
from nico_selfmodel.experiments.refinement import RefinementExperiment, RefinementRow
from nico_selfmodel.viz.figures.experiment_charts import Level, bar_chart

THESIS: dict[str, dict[str, dict[str, tuple[float, float]]]] = {
    "fiducial": {
        "kinematics only": {"own_mm": (2.74, 1.39), "px": (4.55, 2.74)},
        "intrinsics pinned, as published": {"own_mm": (4.23, 2.87), "px": (3.38, 1.99)},
        "full, as published": {
            "own_mm": (1.99, 1.24),
            "px": (2.61, 1.71),
            "edge_mm": (1.59, 1.31),
            "links_mm": (9.47, 5.57),
        },
    },
    "color": {
        "kinematics only": {"own_mm": (3.77, 2.30), "px": (5.78, 4.50)},
        "full, as published": {"edge_mm": (1.30, 2.79)},
    },
}
"""The thesis' own: mean and SD on its real robot; edges before and after, links off calipers."""
KNOWN = "what the mechanics leave"
"""Errors of a body that knows itself exactly: play of the joints and the tracker's noise."""
_CAMERAS = {
    True: "boards and hand found in rendered pictures",
    False: "hand tracked without rendering",
}
_SHORT = {
    "kinematics only": "kinematics\nonly",
    "intrinsics pinned, as published": "intrinsics\npinned",
    "full, as published": "full,\nas published",
    "full, whitened, without boards": "full,\nno boards",
    "full, anchored": "full,\nanchored",
}


def report_of(results: RefinementExperiment) -> ExperimentReport:
    """Return ours, with the thesis' figure after the bar where there is one."""
    head = (
        "# Arm and cameras refine each other (thesis, chapter 8)\n\n"
        f"Ours: {bodies(results.individuals)}, imperfections `{results.world}`, joint "
        f"noise of +-{results.play_deg:g} deg; {_CAMERAS[results.rendered]}. Mean (SD) on 100 "
        "random poses that were held out, edges and scale on held-out boards before -> after. "
        "After the bar: the thesis' real robot.\n\n"
        "`own 3D` is the thesis' measure, the predicted hand against the body's own stereo: it "
        "may fall while the true error grows. `refused`: the built-in check found that the cameras "
        "measure held-out boards worse than before, or lost their scale. "
        f"`{KNOWN}`: the true body, told of everything but where in their play the joints rest, on "
        "the same poses; nothing that is learned does better in the mean.\n\n"
    )
    charts = {
        "own_3d": _chart(results, "own_mm", "The thesis' 3D error [mm]"),
        "pixels": _chart(results, "px", "error in the images [px]"),
        "true": _chart(results, "true_mm", "distance from the real hand [mm]"),
    }
    present = {name: chart for name, chart in charts.items() if chart is not None}
    return ExperimentReport(
        head, (_table(results),), present, {**asdict(results), "thesis": THESIS}
    )


def _table(results: RefinementExperiment) -> Table:
    headings = (
        "tracked by, learned",
        "own 3D [mm]",
        "pixels",
        "true [mm]",
        "board edges [mm]",
        "scale [%]",
        "links off [mm]",
        "refused",
    )
    rows, left = [], {limit.tracker: limit for limit in results.limits}
    last = {row.tracker: row for row in results.rows}
    for row in results.rows:
        thesis = THESIS.get(row.tracker, {}).get(row.condition, {})
        rows.append(
            [
                f"{row.tracker}, {row.condition}",
                _beside(spread(row.own_mm), thesis.get("own_mm")),
                _beside(spread(row.px), thesis.get("px")),
                "-" if row.true_mm is None else _over_bodies(row.true_mm, results.individuals),
                _beside(_change(row.edge_mm), thesis.get("edge_mm"), _change),
                "-" if row.scale_error is None else f"{100.0 * row.scale_error:.2f}",
                _beside(_links(row.links_mm), thesis.get("links_mm"), _links),
                _refused(row, results.individuals),
            ]
        )
        if row is last[row.tracker] and row.tracker in left:
            rows.append(_limit_row(left[row.tracker], results.individuals))
    title = f"Held-out poses and boards, {bodies(results.individuals)}; ours / thesis"
    return Table(title, headings, rows)


def _limit_row(limit: Limit, individuals: int) -> list[str]:
    """Return what is left to a body that knows itself exactly."""
    known = [spread(limit.px), _over_bodies(limit.true_mm, individuals)]
    return [f"{limit.tracker}, {KNOWN}", "-", *known, "-", "-", "-", "-"]


def _chart(results: RefinementExperiment, quantity: str, ylabel: str) -> Any:
    """Draw one bar a condition and tracker, the thesis' beside it; None where nothing is known."""
    conditions = list(dict.fromkeys(row.condition for row in results.rows))
    series, levels = [], []
    for k, tracker in enumerate(dict.fromkeys(row.tracker for row in results.rows)):
        rows = {row.condition: row for row in results.rows if row.tracker == tracker}
        levels += [
            Level(f"{tracker}, {KNOWN}", getattr(limit, quantity)[0], _DASHES[k % len(_DASHES)])
            for limit in results.limits
            if limit.tracker == tracker and quantity != "own_mm"
        ]
        ours = [
            None if row is None else getattr(row, quantity) for row in map(rows.get, conditions)
        ]
        if any(ours):
            series.append(bars(f"{tracker}, ours, simulated", ours, color=k))
        known = THESIS.get(tracker, {})
        theirs = [known.get(name, {}).get(quantity) for name in conditions]
        if any(theirs):
            series.append(bars(f"{tracker}, thesis", theirs, published=True, color=k))
    if not series:
        return None
    titles = {
        "own_mm": "Unanchored learning flatters itself",
        "px": "The images alone cannot tell a bent camera from a straight one",
        "true_mm": "Only boards in the same problem bring the true error down",
    }
    groups = [_SHORT.get(name, name) for name in conditions]
    return bar_chart(groups, series, title=titles[quantity], ylabel=ylabel, levels=levels)


_DASHES = ("--", ":")


def _refused(row: RefinementRow, individuals: int) -> str:
    """Say how many were refused, and how many came to no end at all."""
    lost = individuals - row.runs
    return f"{row.refused} of {row.runs}" + (f", {lost} without an end" if lost else "")


def _over_bodies(pair: tuple[float, float], individuals: int) -> str:
    """One body has no spread."""
    return spread(pair) if individuals > 1 else f"{pair[0]:.2f}"


def _change(pair: tuple[float, float] | None) -> str:
    return "-" if pair is None else f"{pair[0]:.2f} -> {pair[1]:.2f}"


def _links(pair: tuple[float, float] | None) -> str:
    return "-" if pair is None else f"{pair[0]:.1f}, {pair[1]:.1f}"


def _beside(ours: str, thesis: tuple[float, float] | None, show: Any = spread) -> str:
    return ours if thesis is None else f"{ours} / {show(thesis)}"

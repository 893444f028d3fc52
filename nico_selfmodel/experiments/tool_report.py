"""Tables and a chart of section 8.4.4, ours beside the thesis' figures."""

from dataclasses import asdict
from typing import Any

import numpy as np

from nico_selfmodel.experiments.experiment_report import (
    ExperimentReport,
    Table,
    bars,
    bodies,
    spread,
)
from nico_selfmodel.experiments.tool_use import COUNTS, FREED, ToolExperiment, ToolRow
from nico_selfmodel.viz.figures.experiment_charts import bar_chart

THESIS = {
    "hand before": {"mm": (5.72, 5.00), "px": (3.82, 2.33)},
    "tool, 52 poses": {"mm": (7.42, 5.99), "px": (5.09, 3.09)},
    "tool, 52 poses, 3D first": {"mm": (6.83, 5.47), "px": (5.06, 3.19)},
}
"""Mean and SD on the thesis' real robot, by colour."""
_HEADINGS = ("learned", "own 3D [mm]", "pixels", "true [mm]", "worst body [mm]")
_CAMERAS = {
    True: "boards, tape on the finger and on the tip found in rendered pictures",
    False: "hand and tip tracked without rendering",
}
_TRUE = {
    True: "`true`: from the middle of the tape, of which the cameras only see the side before them",
    False: "`true`: from the real tip or hand",
}


def report_of(results: ToolExperiment) -> ExperimentReport:
    """Return what was learned of the tool, ours and then the thesis', and after a restart."""
    head = (
        "# A tool becomes part of the body (thesis, section 8.4.4)\n\n"
        f"Ours: {bodies(results.individuals)}, imperfections `{results.world}`, joint "
        f"noise of +-{results.play_deg:g} deg; {_CAMERAS[results.rendered]}. The thesis: its "
        "real robot, by colour, every parameter of the arm retrained. Mean (SD) on 100 poses that "
        "were held out. `own 3D`: from where the own cameras see it, the thesis' measure. "
        f"{_TRUE[results.rendered]}.\n\n"
    )
    title = f"Held-out poses, {bodies(results.individuals)}"
    theirs = [
        [f"the thesis: {name}", spread(found["mm"]), spread(found["px"]), "-", "-"]
        for name, found in THESIS.items()
    ]
    tables = [Table(f"{title}: a tool", _HEADINGS, [*map(_cells, results.tool), *theirs])]
    if results.restart:
        rows, before = [_cells(row) for row in results.restart], "\n## After a restart\n\n"
        tables.append(Table(f"{title}: a restart", _HEADINGS, rows, before))
    document = {**asdict(results), "thesis": THESIS}
    return ExperimentReport(head, tuple(tables), {"tool": _chart(results)}, document)


def _chart(results: ToolExperiment) -> Any:
    """Draw the thesis' measure over how many poses were learned from, the thesis' own beside it."""
    by_name = {row.what: row for row in results.tool}
    series = []
    for k, words in enumerate(FREED.values()):
        found = [by_name[f"tool, {count} poses, {words}"].own_mm for count in COUNTS]
        series.append(bars(f"{words}, ours, simulated", found, color=k))
    last = THESIS["tool, 52 poses"]["mm"]
    enough = np.nanmin([one.means[0] for one in series]) < last[0]
    series.append(bars("thesis", [*[None] * (len(COUNTS) - 1), last], published=True))
    return bar_chart(
        [str(count) for count in COUNTS],
        series,
        title=f"{COUNTS[0]} poses are {'' if enough else 'not '}enough to beat the thesis' 52",
        ylabel="distance from where the cameras see the tip [mm]",
        xlabel="poses with the tool",
    )


def _cells(row: ToolRow) -> list[str]:
    true = ("-", "-") if row.true_mm is None else tuple(f"{x:.2f}" for x in row.true_mm)
    return [row.what, spread(row.own_mm), spread(row.px), *true]

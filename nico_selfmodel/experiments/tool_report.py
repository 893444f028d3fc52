"""Tables and a chart of section 8.4.4, ours beside the thesis' figures."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from nico_selfmodel.experiments.report_files import (
    Table,
    as_markdown,
    bodies,
    spread,
    write_experiment,
)
from nico_selfmodel.experiments.tool_use import COUNTS, FREED, ToolExperiment, ToolRow
from nico_selfmodel.viz.experiment_charts import BarSeries, bar_chart

THESIS = {
    "hand before": {"mm": (5.72, 5.00), "px": (3.82, 2.33)},
    "tool, 52 poses": {"mm": (7.42, 5.99), "px": (5.09, 3.09)},
    "tool, 52 poses, 3D first": {"mm": (6.83, 5.47), "px": (5.06, 3.19)},
}
"""Mean and SD on the thesis' real robot, by colour."""
_HEADINGS = ("learned", "own 3D [mm]", "pixels", "true [mm]", "worst body [mm]")
_EYES = {
    True: "boards, tape on the finger and on the tip found in rendered pictures",
    False: "hand and tip tracked without rendering",
}
_TRUE = {
    True: "`true`: from the middle of the tape, of which the eyes only see the side before them",
    False: "`true`: from the real tip or hand",
}


def document_of(results: ToolExperiment) -> dict[str, Any]:
    """Return the results as plain data."""
    return {**asdict(results), "thesis": THESIS}


def tool_table(results: ToolExperiment) -> Table:
    """Return headings and rows with the tool: ours, then the thesis'."""
    theirs = [
        [f"the thesis: {name}", spread(found["mm"]), spread(found["px"]), "-", "-"]
        for name, found in THESIS.items()
    ]
    return _HEADINGS, [*map(_cells, results.tool), *theirs]


def restart_table(results: ToolExperiment) -> Table:
    """Return headings and rows after a restart."""
    return _HEADINGS, [_cells(row) for row in results.restart]


def write_report(results: ToolExperiment, out: Path, *, force: bool = False) -> None:
    """Write tables, a chart and `result.json`, whole or not at all.

    Raises:
        OSError: If the folder exists and `force` is not set, or cannot be written to.
    """
    text = (
        "# A tool becomes part of the body (thesis, section 8.4.4)\n\n"
        f"Ours: {bodies(results.individuals)}, world {results.world!r}, joints play by "
        f"+-{results.play_deg:g} deg; {_EYES[results.rendered]}. The thesis: its real robot, by "
        "colour, every parameter of the arm retrained. Mean (SD) on 100 poses that were held out. "
        "`own 3D`: from where the own eyes see it, the thesis' measure. "
        f"{_TRUE[results.rendered]}.\n\n" + as_markdown(tool_table(results))
    )
    if results.restart:
        text += "\n## After a restart\n\n" + as_markdown(restart_table(results))
    write_experiment(out, document_of(results), text, {"tool": _chart(results)}, force=force)


def _chart(results: ToolExperiment) -> Any:
    """Draw the thesis' measure over how many poses were learned from, the thesis' own beside it."""
    by_name = {row.what: row for row in results.tool}
    series = []
    for k, words in enumerate(FREED.values()):
        found = [by_name[f"tool, {count} poses, {words}"].own_mm for count in COUNTS]
        pairs = np.array([(np.nan, np.nan) if pair is None else pair for pair in found])
        series.append(BarSeries(f"{words}, ours, simulated", *pairs.T, color=k))
    theirs = np.full((2, len(COUNTS)), np.nan)
    theirs[:, -1] = THESIS["tool, 52 poses"]["mm"]
    enough = np.nanmin([one.means[0] for one in series]) < theirs[0, -1]
    series.append(BarSeries("thesis", *theirs, published=True, color=0))
    return bar_chart(
        [str(count) for count in COUNTS],
        series,
        title=f"{COUNTS[0]} poses are {'' if enough else 'not '}enough to beat the thesis' 52",
        ylabel="distance from where the eyes see the tip [mm]",
        xlabel="poses with the tool",
    )


def _cells(row: ToolRow) -> list[str]:
    true = ("-", "-") if row.true_mm is None else tuple(f"{x:.2f}" for x in row.true_mm)
    return [row.what, spread(row.own_mm), spread(row.px), *true]

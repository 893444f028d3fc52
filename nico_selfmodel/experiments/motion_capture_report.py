"""The motion capture experiment as tables, charts and JSON."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from nico_selfmodel.experiments.motion_capture import (
    THESIS_REPEATS,
    MotionCaptureExperiment,
    Row,
)
from nico_selfmodel.experiments.report_files import Table, as_markdown, bodies, write_experiment
from nico_selfmodel.viz.experiment_charts import BarSeries, bar_chart

_THESIS_LINKS_MM = ((126.82, 0.45), (115.66, 0.84))
_THESIS_REPEAT_SECONDS = 2.52


def table_rows(results: MotionCaptureExperiment) -> Table:
    """Return headings and rows of both charts, ours beside the thesis' (mean and SD in mm)."""
    headings = ("samples", "method", "ours", "SD", "worst", "s", "thesis", "SD")
    rows = []
    for row in results.rows:
        thesis = ("-", "-") if row.thesis_mm is None else tuple(f"{v:.2f}" for v in row.thesis_mm)
        data = f"{row.circle_samples}"
        data += f" + {row.random_samples}" if row.random_samples else ""
        ours = (f"{row.mean_mm:.2f}", f"{row.sd_mm:.2f}", f"{row.worst_mm:.2f}")
        rows.append([data, row.method, *ours, f"{row.seconds:.2f}", *thesis])
    return headings, rows


def repeat_rows(results: MotionCaptureExperiment) -> Table:
    """Return headings and rows of the repeat test."""
    repeats = results.repeats
    entries = [
        ("training error [mm]", repeats.train_mm, THESIS_REPEATS["train"]),
        ("test error [mm]", repeats.test_mm, THESIS_REPEATS["test"]),
        ("upper arm [mm]", repeats.links_mm[0], _THESIS_LINKS_MM[0]),
        ("forearm to marker [mm]", repeats.links_mm[1], _THESIS_LINKS_MM[1]),
    ]
    rows = [
        [label, *(f"{v:.3f}" for v in ours), *(f"{v:.3f}" for v in thesis)]
        for label, ours, thesis in entries
    ]
    seconds = f"{repeats.seconds:.3f}", "-", f"{_THESIS_REPEAT_SECONDS:.3f}", "-"
    rows.append(["seconds", *seconds])
    return ("", "ours", "SD", "thesis", "SD"), rows


def document_of(results: MotionCaptureExperiment) -> dict[str, Any]:
    """Return the results as plain data."""
    return asdict(results)


def write_report(results: MotionCaptureExperiment, out: Path, *, force: bool = False) -> None:
    """Write tables (Markdown), charts (PNG) and `result.json`, whole or not at all.

    Raises:
        OSError: If the folder exists and `force` is not set, or cannot be written to.
    """
    write_experiment(out, document_of(results), _markdown(results), _charts(results), force=force)


def _markdown(results: MotionCaptureExperiment) -> str:
    head = (
        "# Learning an arm under motion capture (thesis, chapter 6)\n\n"
        f"Ours: {bodies(results.individuals)} in the world `{results.world}`, mean over "
        "100 random test poses [mm]. Thesis: the real robot, one run. Samples: on circles + random."
        "\n\n"
    )
    return head + as_markdown(table_rows(results)) + "\n" + as_markdown(repeat_rows(results))


def _charts(results: MotionCaptureExperiment) -> dict[str, Any]:
    """Draw the thesis' figures 6.8 and 6.9 with ours beside them."""
    by_method = [row for row in results.rows if row.random_samples == 0]
    by_random = [row for row in results.rows if row.method == "refined"]
    return {
        "circle_points_and_refined": _chart(
            by_method,
            lambda row: row.method,
            "Refinement and more samples on the circles both help",
            "",
        ),
        "random_samples": _chart(
            by_random,
            lambda row: f"+ {row.random_samples}",
            "A hundred random poses are enough, from either start",
            "random poses added to the circles",
        ),
    }


def _chart(rows: list[Row], label: Callable[[Row], str], title: str, xlabel: str) -> Any:
    """Draw one group a label, and in it 9 and 104 circle samples, ours and the thesis'."""
    groups = list(dict.fromkeys(label(row) for row in rows))
    series = []
    for color, samples in enumerate(dict.fromkeys(row.circle_samples for row in rows)):
        ours = {label(row): row for row in rows if row.circle_samples == samples}
        pairs = [(ours[g].mean_mm, ours[g].sd_mm) for g in groups]
        published = [ours[g].thesis_mm or (np.nan, np.nan) for g in groups]
        for name, values, is_published in (
            (f"{samples} on circles, ours", pairs, False),
            (f"{samples} on circles, thesis", published, True),
        ):
            means, sds = np.array(values).T
            series.append(BarSeries(name, means, sds, is_published, color))
    ylabel = "error on new poses [mm]"
    return bar_chart(groups, series, title=title, ylabel=ylabel, xlabel=xlabel, log=True)

"""The motion capture experiment as tables, charts and JSON."""

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from nico_selfmodel.experiments.experiment_report import ExperimentReport, Table, bars, bodies
from nico_selfmodel.experiments.motion_capture import THESIS_REPEATS, MotionCaptureExperiment, Row
from nico_selfmodel.viz.figures.experiment_charts import bar_chart

_THESIS_LINKS_MM = ((126.82, 0.45), (115.66, 0.84))
_THESIS_REPEAT_SECONDS = 2.52


def report_of(results: MotionCaptureExperiment) -> ExperimentReport:
    """Return both charts and the repeat test, ours beside the thesis' (mean and SD in mm)."""
    head = (
        "# Learning an arm under motion capture (thesis, chapter 6)\n\n"
        f"Ours: {bodies(results.individuals)}, imperfections `{results.world}`, mean over "
        "100 random test poses [mm]. Thesis: the real robot, one run. Samples: on circles + random."
        "\n\n"
    )
    tables = _rows_table(results), _repeats_table(results)
    return ExperimentReport(head, tables, _charts(results), asdict(results))


def _rows_table(results: MotionCaptureExperiment) -> Table:
    headings = ("samples", "method", "ours", "SD", "worst", "s", "thesis", "SD")
    rows = []
    for row in results.rows:
        thesis = ("-", "-") if row.thesis_mm is None else tuple(f"{v:.2f}" for v in row.thesis_mm)
        data = f"{row.circle_samples}"
        data += f" + {row.random_samples}" if row.random_samples else ""
        ours = (f"{row.mean_mm:.2f}", f"{row.sd_mm:.2f}", f"{row.worst_mm:.2f}")
        rows.append([data, row.method, *ours, f"{row.seconds:.2f}", *thesis])
    title = (
        f"Error on 100 random poses [mm], {bodies(results.individuals)}, "
        f"imperfections {results.world}"
    )
    return Table(title, headings, rows)


def _repeats_table(results: MotionCaptureExperiment) -> Table:
    repeats = results.repeats
    entries = [
        ("training error [mm]", repeats.train_mm, THESIS_REPEATS["train"]),
        ("test error [mm]", repeats.test_mm, THESIS_REPEATS["test"]),
        ("upper arm [mm]", repeats.links_mm[0], _THESIS_LINKS_MM[0]),
        ("forearm to marker [mm]", repeats.links_mm[1], _THESIS_LINKS_MM[1]),
    ]
    rows = [[label, *(f"{v:.3f}" for v in (*ours, *thesis))] for label, ours, thesis in entries]
    rows.append(["seconds", f"{repeats.seconds:.3f}", "-", f"{_THESIS_REPEAT_SECONDS:.3f}", "-"])
    headings = ("", "ours", "SD", "thesis", "SD")
    return Table("Random subsets of the training poses", headings, rows, "\n")


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
        by_label = {label(row): row for row in rows if row.circle_samples == samples}
        found = [by_label[group] for group in groups]
        ours = [(row.mean_mm, row.sd_mm) for row in found]
        theirs = [row.thesis_mm for row in found]
        series.append(bars(f"{samples} on circles, ours", ours, color=color))
        series.append(bars(f"{samples} on circles, thesis", theirs, published=True, color=color))
    ylabel = "error on new poses [mm]"
    return bar_chart(groups, series, title=title, ylabel=ylabel, xlabel=xlabel, log=True)

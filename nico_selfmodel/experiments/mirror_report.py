"""The mirror experiment as tables, charts and JSON, in the form of the thesis' figures 9.4, 9.5."""

from dataclasses import asdict
from typing import Any

import numpy as np

from nico_selfmodel.experiments.experiment_report import ExperimentReport, Pair, Table, bars, bodies
from nico_selfmodel.experiments.mirror import (
    COMPARABLE_MM,
    POSES,
    TEST_POSES,
    MirrorExperiment,
    Spread,
)
from nico_selfmodel.viz.figures.experiment_charts import bar_chart


def report_of(results: MirrorExperiment) -> ExperimentReport:
    """Return the errors in every mirror after every number of poses, and what stereo allows."""
    document = {**asdict(results), "comparable_mm": COMPARABLE_MM}
    tables = _rows_table(results), _depth_table(results)
    return ExperimentReport(_head(results), tables, _charts(results), document)


def _rows_table(results: MirrorExperiment) -> Table:
    headings = (
        "mirror", "poses", "px", "SD", "mm", "SD", "of arm", "deg", "off mm",
        "cameras px", "s",
    )  # fmt: skip
    rows = [
        [
            row.mirror,
            str(row.poses),
            f"{row.pixels[0]:.2f}",
            _sd(row.pixels, 2),
            f"{row.position_mm[0]:.1f}",
            _sd(row.position_mm, 1),
            f"{row.arm_share:.3f}",
            "-" if row.angle_deg is None else f"{row.angle_deg:.2f}",
            "-" if row.distance_mm is None else f"{row.distance_mm:.1f}",
            f"{row.cameras_px:.2f}",
            f"{row.seconds:.2f}",
        ]
        for row in results.rows
    ]
    kind = "rendered" if results.rendered else f"{results.pixel_sigma:g} px"
    title = f"Reflections in 100 test poses, {results.individuals} simulated robot(s), {kind}"
    return Table(title, headings, rows)


def _depth_table(results: MirrorExperiment) -> Table:
    headings = ("view", "distance mm", "px", "SD", "mm", "SD", "stereo alone mm")
    rows = [
        [
            row.view,
            f"{row.depth_mm:.0f}",
            f"{row.pixels[0]:.2f}",
            _sd(row.pixels, 2),
            f"{row.position_mm[0]:.1f}",
            _sd(row.position_mm, 1),
            f"{row.stereo_mm:.1f}",
        ]
        for row in results.depth
    ]
    note = (
        "\nA reflection is as far away as hand, glass and camera together: stereo sets the limit.\n"
    )
    return Table("What stereo depth alone allows", headings, rows, note)


def _sd(spread: Spread, digits: int) -> str:
    return "-" if spread[1] is None else f"{spread[1]:.{digits}f}"


def _head(results: MirrorExperiment) -> str:
    places = ", ".join(f"{name} {distance:.0f} mm" for name, distance in results.places_mm.items())
    seen = (
        f"found in rendered pictures, where a marker is located to about {results.pixel_sigma:g} px"
        if results.rendered
        else f"marker found to {results.pixel_sigma:g} px; nothing rendered"
    )
    return (
        "# Inferring the visual perspective of a mirror (thesis, chapter 9)\n\n"
        f"Ours: {bodies(results.individuals)} that learned cameras and arm by themselves, "
        f"joint noise +-{results.play_deg:g} deg, arm {results.arm_mm:.0f} mm, {seen}. "
        f"Mirrors before the left camera: {places}. Mean "
        f"over {TEST_POSES} test poses, SD over robots. Thesis: figures 9.4 and 9.5 are charts "
        "without numbers; it works after 10 poses, and comparable systems without a mirror report "
        f"about {COMPARABLE_MM:.0f} mm. `deg` and `off`: error of the mirror's plane; `cameras`: "
        "the thesis' two independent mirror cameras in corrected form, from the same poses. Where "
        "they come nearer in pixels than one plane, their twelve numbers follow what is wrong with "
        "the arm, not with the mirror.\n\n"
    )


def _charts(results: MirrorExperiment) -> dict[str, Any]:
    """Draw the thesis' figures 9.4 (space) and 9.5 (pixels), the direct view beside them."""
    return {
        "position": _chart(
            results,
            "position_mm",
            "Ten poses are enough; the rest is stereo at that distance",
            "hand rebuilt in the mirror, error [mm]",
            (COMPARABLE_MM, np.nan),
        ),
        "pixels": _chart(
            results,
            "pixels",
            "In pixels a reflection is no harder to predict than the hand itself",
            "predicted reflection, error [px]",
            None,
        ),
    }


def _chart(results: MirrorExperiment, what: str, title: str, ylabel: str, published: Pair) -> Any:
    """Draw one group a number of poses, the mirrors in it, and the direct view as a last group."""
    series, blank, last = [], [None] * len(POSES), len(results.places_mm)
    for color, (name, distance) in enumerate(results.places_mm.items()):
        pairs = [_drawn(getattr(row, what)) for row in results.rows if row.mirror == name]
        series.append(bars(f"mirror {name}, {distance:.0f} mm", [*pairs, None], color=color))
    direct = next(_drawn(getattr(row, what)) for row in results.depth if row.view == "direct")
    series.append(bars("no mirror", [*blank, direct], color=last))
    if published is not None:
        label = "comparable systems, no mirror (thesis)"
        series.append(bars(label, [*blank, published], published=True, color=last))
    groups = [*(str(count) for count in POSES), "seen directly"]
    return bar_chart(
        groups, series, title=title, ylabel=ylabel, xlabel="poses of training", log=False
    )


def _drawn(spread: Spread) -> tuple[float, float]:
    return spread[0], np.nan if spread[1] is None else spread[1]

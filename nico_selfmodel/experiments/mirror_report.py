"""The mirror experiment as tables, charts and JSON, in the form of the thesis' figures 9.4, 9.5."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from nico_selfmodel.experiments.mirror import (
    COMPARABLE_MM,
    POSES,
    TEST_POSES,
    MirrorExperiment,
    Spread,
)
from nico_selfmodel.experiments.report_files import Table, as_markdown, bodies, write_experiment
from nico_selfmodel.viz.experiment_charts import BarSeries, bar_chart


def table_rows(results: MirrorExperiment) -> Table:
    """Return headings and rows of every mirror and number of poses."""
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
    return headings, rows


def _sd(spread: Spread, digits: int) -> str:
    return "-" if spread[1] is None else f"{spread[1]:.{digits}f}"


def depth_rows(results: MirrorExperiment) -> Table:
    """Return headings and rows of what stereo depth alone allows."""
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
    return headings, rows


def document_of(results: MirrorExperiment) -> dict[str, Any]:
    """Return the results as plain data."""
    return {**asdict(results), "comparable_mm": COMPARABLE_MM}


def write_report(results: MirrorExperiment, out: Path, *, force: bool = False) -> None:
    """Write tables, charts and `result.json`, whole or not at all.

    Raises:
        OSError: If the folder exists and `force` is not set, or cannot be written to.
    """
    write_experiment(out, document_of(results), _markdown(results), _charts(results), force=force)


def _markdown(results: MirrorExperiment) -> str:
    places = ", ".join(f"{name} {distance:.0f} mm" for name, distance in results.places_mm.items())
    seen = (
        f"found in rendered pictures, where a marker is located to about {results.pixel_sigma:g} px"
        if results.rendered
        else f"marker found to {results.pixel_sigma:g} px; nothing rendered"
    )
    head = (
        "# Inferring the visual perspective of a mirror (thesis, chapter 9)\n\n"
        f"Ours: {bodies(results.individuals)} that learned eyes and arm by themselves, "
        f"joint play +-{results.play_deg:g} deg, arm {results.arm_mm:.0f} mm, {seen}. "
        f"Mirrors before the left eye: {places}. Mean "
        f"over {TEST_POSES} test poses, SD over robots. Thesis: figures 9.4 and 9.5 are charts "
        "without numbers; it works after 10 poses, and comparable systems without a mirror report "
        f"about {COMPARABLE_MM:.0f} mm. `deg` and `off`: error of the mirror's plane; `cameras`: "
        "the thesis' two independent mirror cameras in corrected form, from the same poses. Where "
        "they come nearer in pixels than one plane, their twelve numbers follow what is wrong with "
        "the arm, not with the mirror.\n\n"
    )
    note = "\nA reflection is as far away as hand, glass and eye together: stereo sets the limit.\n"
    return head + as_markdown(table_rows(results)) + note + as_markdown(depth_rows(results))


def _charts(results: MirrorExperiment) -> dict[str, Any]:
    """Draw the thesis' figures 9.4 (space) and 9.5 (pixels), the direct view beside them."""
    return {
        "position": _chart(
            results,
            "position_mm",
            "Ten poses are enough; the rest is stereo at that distance",
            "hand rebuilt in the mirror, error [mm]",
            COMPARABLE_MM,
        ),
        "pixels": _chart(
            results,
            "pixels",
            "In pixels a reflection is no harder to predict than the hand itself",
            "predicted reflection, error [px]",
            None,
        ),
    }


def _chart(
    results: MirrorExperiment, what: str, title: str, ylabel: str, published: float | None
) -> Any:
    """Draw one group a number of poses, the mirrors in it, and the direct view as a last group."""
    groups = [*(str(count) for count in POSES), "seen directly"]
    nothing = (np.nan, np.nan)
    series = []
    for color, (name, distance) in enumerate(results.places_mm.items()):
        pairs = [_drawn(getattr(row, what)) for row in results.rows if row.mirror == name]
        label = f"mirror {name}, {distance:.0f} mm"
        series.append(BarSeries(label, *np.array([*pairs, nothing]).T, color=color))
    blank = [nothing] * len(POSES)
    direct = next(_drawn(getattr(row, what)) for row in results.depth if row.view == "direct")
    series.append(
        BarSeries("no mirror", *np.array([*blank, direct]).T, color=len(results.places_mm))
    )
    if published is not None:
        pair = np.array([*blank, (published, np.nan)]).T
        label = "comparable systems, no mirror (thesis)"
        series.append(BarSeries(label, *pair, published=True, color=len(results.places_mm)))
    return bar_chart(
        groups, series, title=title, ylabel=ylabel, xlabel="poses of training", log=False
    )


def _drawn(spread: Spread) -> tuple[float, float]:
    return spread[0], np.nan if spread[1] is None else spread[1]

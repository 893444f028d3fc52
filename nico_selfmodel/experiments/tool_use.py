"""Section 8.4.4 of the thesis: a screwdriver in the hand, and a restart of the encoders."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from nico_selfmodel.dataset import Dataset
from nico_selfmodel.estimation import calibrate_body, calibrate_tool, evaluate, rezero
from nico_selfmodel.estimation.tool import ToolCalibration
from nico_selfmodel.experiments.body_protocol import BodyProtocol
from nico_selfmodel.experiments.refinement import TEST_POSES, simulated_lesson
from nico_selfmodel.experiments.report_files import Table, as_markdown, write_experiment
from nico_selfmodel.model import SelfModel
from nico_selfmodel.systems import SimulatedBody, World
from nico_selfmodel.viz import BarSeries, bar_chart

TOOL = np.array([0.025, 0.0, -0.08])
"""From the finger tip to the screwdriver's, at q = 0 [m]."""
TIP_SIGMA = 1.5
"""Noise of a patch of 1 cm on the tip [px]."""
COUNTS = (3, 10, 20, 52)
"""Poses with the tool; the thesis has 52."""
ZERO_COUNTS = (3, 5, 10)
"""Poses after a restart."""
THESIS = {
    "hand before": {"mm": (5.72, 5.00), "px": (3.82, 2.33)},
    "tool, 52 poses": {"mm": (7.42, 5.99), "px": (5.09, 3.09)},
    "tool, 52 poses, 3D first": {"mm": (6.83, 5.47), "px": (5.06, 3.19)},
}
"""Mean and SD on the thesis' real robot, by colour."""


@dataclass(frozen=True)
class ToolRow:
    """One way of learning from some poses, averaged over individuals."""

    what: str
    """In words."""
    poses: int
    """Learned from; 0 before anything was learned."""
    px: tuple[float, float] | None
    """Error in the images on held-out poses: mean and SD."""
    true_mm: tuple[float, float]
    """Distance from the real tip or hand: mean, and largest mean of an individual."""


@dataclass(frozen=True)
class ToolExperiment:
    """All rows."""

    world: str
    """What is wrong with the bodies."""
    individuals: int
    """Simulated bodies averaged over."""
    tool: tuple[ToolRow, ...]
    """With the tool."""
    restart: tuple[ToolRow, ...]
    """After the encoders lost their zeros."""


def run_tool(
    world: World,
    individuals: int = 8,
    seed: int = 0,
    progress: Callable[[str, int, int], None] | None = None,
) -> ToolExperiment:
    """Let simulated bodies take a tool, and restart them.

    Args:
        world: What is wrong with the bodies.
        individuals: How many.
        seed: Of the first.
        progress: Told how far it is.

    Returns:
        The table's rows.
    """
    color, fiducial = BodyProtocol.of_nico("color"), BodyProtocol.of_nico("fiducial")
    tools: list[dict[str, dict[str, Any]]] = []
    restarts: list[dict[str, dict[str, Any]]] = []
    for i in range(individuals):
        tools.append(_with_tool(color, world, seed + i))
        restarts.append(_after_restart(fiducial, world, seed + i))
        if progress:
            progress("bodies learning", i + 1, individuals)
    return ToolExperiment(world.name, individuals, _rows(tools), _rows(restarts))


def learned_body(
    protocol: BodyProtocol, world: World, seed: int, tracker: str
) -> tuple[SimulatedBody, SelfModel, Dataset]:
    """Return a body, what it learned of itself, and poses to test it on."""
    lesson = simulated_lesson(protocol, world, seed, tracker)
    model = calibrate_body(lesson.train, lesson.eyes, lesson.boards).model
    return protocol.body(world, seed, session=1, tracker=tracker), model, lesson.test


def _with_tool(protocol: BodyProtocol, world: World, seed: int) -> dict[str, dict[str, Any]]:
    body, model, test = learned_body(protocol, world, seed, "color")
    rng = np.random.default_rng((seed, 13))
    rows = {"hand before": {"poses": 0, "true": _true(model, test)}}
    body.take_tool(TOOL)
    body.pixel_sigma = TIP_SIGMA
    q = protocol.random_poses(TEST_POSES, rng, TOOL)
    shown = protocol.record(body, "tip", q, observed=True)
    rows["tool, nothing learned"] = {"poses": 0, "true": _true(model, shown)}
    for count in COUNTS:
        taken = protocol.record(body, "tool", protocol.random_poses(count, rng, TOOL))
        for free, words in (("point", "tip alone"), ("body", "all else too, as known")):
            found = calibrate_tool(model, taken, tool="tip", free=free, test=shown)
            rows[f"tool, {count} poses, {words}"] = _tool_row(found, shown, count)
    return rows


def _tool_row(found: ToolCalibration, shown: Dataset, count: int) -> dict[str, Any]:
    assert found.test is not None
    return {
        "poses": count,
        "px": (float(found.test.mean()), float(found.test.std())),
        "true": _true(found.model, replace(shown, marker=np.full(len(shown), found.tool))),
    }


def _after_restart(protocol: BodyProtocol, world: World, seed: int) -> dict[str, dict[str, Any]]:
    body, model, test = learned_body(protocol, world, seed, "fiducial")
    rng = np.random.default_rng((seed, 14))
    rows = {"before the restart": {"poses": 0, "true": _true(model, test)}}
    body.restart(seed)
    shown = protocol.record(body, "after", protocol.random_poses(TEST_POSES, rng), observed=True)
    rows["after the restart"] = {"poses": 0, "true": _true(model, shown)}
    for count in ZERO_COUNTS:
        poses = protocol.record(body, "zeros", protocol.random_poses(count, rng))
        found = rezero(model, poses).model
        rows[f"zeros from {count} poses"] = {"poses": count, "true": _true(found, shown)}
    return rows


def _true(model: SelfModel, test: Dataset) -> float:
    return 1e3 * evaluate(model, test).statistics.mean


def _rows(runs: list[dict[str, dict[str, Any]]]) -> tuple[ToolRow, ...]:
    rows = []
    for what in runs[0]:
        found = [run[what] for run in runs]
        true = np.array([one["true"] for one in found])
        pixels = np.array([one["px"] for one in found if "px" in one])
        rows.append(
            ToolRow(
                what,
                found[0]["poses"],
                (float(pixels[:, 0].mean()), float(pixels[:, 1].mean())) if len(pixels) else None,
                (float(true.mean()), float(true.max())),
            )
        )
    return tuple(rows)


def table_rows(rows: tuple[ToolRow, ...]) -> Table:
    """Return headings and rows of a table."""
    headings = ("learned", "pixels", "true [mm]", "worst body [mm]")
    return headings, [
        [
            row.what,
            "-" if row.px is None else f"{row.px[0]:.2f} ({row.px[1]:.2f})",
            f"{row.true_mm[0]:.2f}",
            f"{row.true_mm[1]:.2f}",
        ]
        for row in rows
    ]


def document_of(results: ToolExperiment) -> dict[str, Any]:
    """Return the results as plain data."""
    return {**asdict(results), "thesis": THESIS}


def write_report(results: ToolExperiment, out: Path, *, force: bool = False) -> None:
    """Write tables, a chart and `result.json`, whole or not at all.

    Raises:
        OSError: If the folder exists and `force` is not set, or cannot be written to.
    """
    thesis = "; ".join(
        f"{name} {found['mm'][0]} ({found['mm'][1]}) mm, {found['px'][0]} ({found['px'][1]}) px"
        for name, found in THESIS.items()
    )
    head = (
        "# A tool becomes part of the body (thesis, section 8.4.4)\n\n"
        f"Ours: {results.individuals} simulated bodies, world {results.world!r}; mean (SD) on 100 "
        f"held-out poses, true error against the real tip. Thesis, real robot, by colour: {thesis}."
        "\n\n"
    )
    text = as_markdown(table_rows(results.tool)) + "\n## After a restart\n\n"
    text += as_markdown(table_rows(results.restart))
    write_experiment(out, document_of(results), head + text, {"tool": _chart(results)}, force=force)


def _chart(results: ToolExperiment) -> Any:
    groups = [str(count) for count in COUNTS]
    series = []
    for k, words in enumerate(("tip alone", "all else too, as known")):
        by_name = {row.what: row for row in results.tool}
        means = [by_name[f"tool, {count} poses, {words}"].true_mm[0] for count in COUNTS]
        blank = np.full(len(COUNTS), np.nan)
        series.append(BarSeries(f"{words}, ours, simulated", np.array(means), blank, color=k))
    theirs = np.full((2, len(COUNTS)), np.nan)
    theirs[:, -1] = THESIS["tool, 52 poses"]["mm"]
    series.append(BarSeries("thesis, own 3D", *theirs, published=True, color=0))
    return bar_chart(
        groups,
        series,
        title="Three poses are enough for a tool",
        ylabel="distance from the real tip [mm]",
        xlabel="poses with the tool",
    )

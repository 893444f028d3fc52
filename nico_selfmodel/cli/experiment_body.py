"""`nico-selfmodel experiment refinement` and `experiment tool`: chapter 8 of the thesis."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import console

if TYPE_CHECKING:
    from nico_selfmodel.experiments.experiment_report import ExperimentReport
    from nico_selfmodel.systems import Imperfections

Out = Annotated[Path, typer.Option("--out", help="Folder for tables and charts to make.")]
WorldName = Annotated[str, typer.Option("--world", help="clean or thesis.")]
PlayDeg = Annotated[
    float | None, typer.Option("--play-deg", min=0.0, help="Half the joint play, instead.")
]
Individuals = Annotated[
    int | None,
    typer.Option(
        "--individuals", min=1, help="Simulated bodies to average over: 8, 1 if --rendered."
    ),
]
Rendered = Annotated[
    bool, typer.Option("--rendered", help="Through rendered pictures; minutes a body.")
]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Of the first individual.")]
Force = Annotated[bool, typer.Option("--force", help="Replace an existing folder.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]


def refinement(
    out: Out,
    world: WorldName = "clean",
    play_deg: PlayDeg = 0.5,
    individuals: Individuals = None,
    rendered: Rendered = False,
    tracker: Annotated[
        list[str] | None, typer.Option("--tracker", help="fiducial or color; both if omitted.")
    ] = None,
    seed: Seed = 0,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Let arm and eyes refine each other, as published and anchored to boards (chapter 8)."""
    from nico_selfmodel.experiments.refinement import run_refinement
    from nico_selfmodel.experiments.refinement_report import report_of
    from nico_selfmodel.files import refuse_folder

    refuse_folder(out, force=force)
    chosen, source = _world(world, play_deg), None
    individuals = individuals or (1 if rendered else 8)
    if rendered:
        # The renderer is slow to load.
        from nico_selfmodel.experiments.rendered_lesson import rendered_scenarios

        source = partial(rendered_scenarios, chosen)
    with console.progress_bar() as stage:
        results = run_refinement(
            chosen, individuals, seed, tuple(tracker or ("fiducial", "color")), stage, source
        )
    finish(report_of(results), out, force, as_json)


def tool(
    out: Out,
    world: WorldName = "clean",
    play_deg: PlayDeg = 0.5,
    individuals: Individuals = None,
    rendered: Rendered = False,
    seed: Seed = 0,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Take a tool, and restart the encoders (section 8.4.4)."""
    from nico_selfmodel.experiments.tool_report import report_of
    from nico_selfmodel.experiments.tool_use import run_tool
    from nico_selfmodel.files import refuse_folder

    refuse_folder(out, force=force)
    chosen, source = _world(world, play_deg), None
    individuals = individuals or (1 if rendered else 8)
    if rendered:
        # The renderer is slow to load.
        from nico_selfmodel.experiments.rendered_tool import rendered_tool_scenario

        source = partial(rendered_tool_scenario, chosen)
    with console.progress_bar() as stage:
        results = run_tool(chosen, individuals, seed, stage, source)
    finish(report_of(results), out, force, as_json)


def _world(name: str, play_deg: float | None) -> "Imperfections":
    from nico_selfmodel.systems import imperfections_named

    return imperfections_named(name).with_noise(play_deg=play_deg)


def finish(report: "ExperimentReport", out: Path, force: bool, as_json: bool) -> None:
    """Write what an experiment found, and print its tables or its document."""
    report.write(out, force=force)
    if as_json:
        console.print_json(report.document)
        return
    for table in report.tables:
        console.print_table(table.title, table.headings, table.rows)
    console.print_where(out)

"""`nico-selfmodel experiment motion-capture`: chapter 6 of the thesis."""

from typing import Annotated

import typer

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.experiment.running import finish
from nico_selfmodel.cli.option_groups import Output


def motion_capture(
    output: Output,
    imperfections: options.Imperfections = "thesis",
    robots: options.Robots = 5,
    repeats: Annotated[
        int, typer.Option("--repeats", min=2, help="Random subsets of the repeat test.")
    ] = 100,
    seed: options.FirstSeed = 0,
    processes: options.Processes = 1,
    dask: options.Dask = None,
) -> None:
    """An arm from few and from many samples (chapter 6)."""
    from nico_selfmodel.experiments.motion_capture import run_motion_capture
    from nico_selfmodel.experiments.motion_capture_report import report_of
    from nico_selfmodel.parallel import Workers
    from nico_selfmodel.plant import ArmDescription
    from nico_selfmodel.systems.simulated.imperfections import imperfections_named

    output.refuse()
    chosen = imperfections_named(imperfections)
    with printer.progress_bar() as progress:
        results = run_motion_capture(
            ArmDescription.named("nico"),
            chosen,
            individuals=robots,
            repeats=repeats,
            seed=seed,
            progress=progress,
            workers=Workers(processes, dask),
        )
    finish(report_of(results), output)

"""`nico-selfmodel experiment refinement`: chapter 8 of the thesis."""

from functools import partial
from typing import Annotated

import typer

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.experiment.running import finish, imperfect
from nico_selfmodel.cli.option_groups import Output


def refinement(
    output: Output,
    imperfections: options.Imperfections = "clean",
    joint_noise_deg: options.JointNoise = 0.5,
    robots: options.RobotsOrOne = None,
    rendered: options.Rendered = False,
    tracker: Annotated[
        list[str] | None, typer.Option("--tracker", help="fiducial or color; both if omitted.")
    ] = None,
    seed: options.FirstSeed = 0,
) -> None:
    """Arm and cameras refined together (chapter 8).

    As published, and anchored to boards.
    """
    from nico_selfmodel.experiments.refinement import run_refinement
    from nico_selfmodel.experiments.refinement_report import report_of

    output.refuse()
    chosen, source = imperfect(imperfections, joint_noise_deg), None
    robots = robots or (1 if rendered else 8)
    if rendered:
        # The renderer is slow to load.
        from nico_selfmodel.experiments.rendered_scenario import rendered_scenarios

        source = partial(rendered_scenarios, chosen)
    with printer.progress_bar() as progress:
        results = run_refinement(
            chosen, robots, seed, tuple(tracker or ("fiducial", "color")), progress, source
        )
    finish(report_of(results), output)

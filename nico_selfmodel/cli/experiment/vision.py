"""`nico-selfmodel experiment vision`: chapter 7 of the thesis."""

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.experiment.running import finish
from nico_selfmodel.cli.option_groups import Output


def vision(
    output: Output,
    imperfections: options.Imperfections = "thesis",
    robots: options.Robots = 3,
    seed: options.FirstSeed = 0,
) -> None:
    """Cameras and arm through rendered pictures (chapter 7).

    Takes minutes a robot.
    """
    from nico_selfmodel.systems.simulated.imperfections import imperfections_named

    output.refuse()
    chosen = imperfections_named(imperfections)
    from nico_selfmodel.experiments.vision import report_of, run_vision

    with printer.progress_bar() as progress:
        results = run_vision(chosen, individuals=robots, seed=seed, progress=progress)
    finish(report_of(results), output)

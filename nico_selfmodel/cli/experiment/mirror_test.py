"""`nico-selfmodel experiment mirror-test`: what chapter 10 of the thesis leaves to the future."""

from typing import Annotated

import typer

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.experiment.running import finish


def mirror_test(
    out: options.Out,
    robots: options.Robots = 1,
    trials: Annotated[
        int, typer.Option("--trials", min=1, help="Encounters in all, shared by the robots.")
    ] = 14,
    imperfections: options.Imperfections = "thesis",
    seed: options.FirstSeed = 0,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Is it me? Tell one's mirror image from others by the timing of motion (chapter 10).

    The first stage of the mirror test, and the only one there is: a robot that has learned arm and
    cameras starts and stops its arm at random before a mirror, another robot, one that repeats its
    motion 5 to 0.1 s late, or nobody, and says `self`, `not me`, `nobody` or `cannot tell`. FAIL,
    with exit code 1, if a verdict is wrong or late; a PASS takes 100 trials. About 10 s a trial and
    a minute a robot.
    """
    from nico_selfmodel.files.whole import refuse_folder
    from nico_selfmodel.systems.simulated.imperfections import imperfections_named

    refuse_folder(out, force=force)
    chosen = imperfections_named(imperfections)
    from nico_selfmodel.experiments.mirror_test.encounters import run_encounters
    from nico_selfmodel.experiments.mirror_test.report import report_of

    with printer.progress_bar() as progress:
        report = report_of(run_encounters(chosen, robots, trials, seed, progress))
    finish(report, out, force, as_json)
    raise typer.Exit(1 if report.document["status"] == "FAIL" else 0)

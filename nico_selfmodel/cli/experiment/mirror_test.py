"""`nico-selfmodel experiment mirror-test`: what chapter 10 of the thesis leaves to the future."""

from typing import Annotated

import typer

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.experiment.running import finish
from nico_selfmodel.cli.option_groups import Output


def mirror_test(
    output: Output,
    robots: options.Robots = 1,
    trials: Annotated[
        int, typer.Option("--trials", min=1, help="Encounters in all, shared by the robots.")
    ] = 14,
    looks: Annotated[
        int, typer.Option("--looks", min=1, help="Of each robot at its unmarked body.")
    ] = 3,
    marks: Annotated[
        int, typer.Option("--marks", min=1, help="Trials with marks and controls in all.")
    ] = 8,
    glass: Annotated[
        str,
        typer.Option(
            "--glass", help="What is put before the robot: flat, bent, dirty or half (of a body)."
        ),
    ] = "flat",
    imperfections: options.Imperfections = "thesis",
    seed: options.FirstSeed = 0,
) -> None:
    """Is it me, do I look as I expect, what is that mark? The mirror test (chapter 10).

    First a robot that has learned its cameras and an arm of six joints starts and stops its arm at
    random before a mirror, another robot, one that repeats its motion 5 to 0.1 s late, or nobody,
    and says `self`, `not me`, `nobody` or `cannot tell`; and of a mirror, a live picture of itself
    and a twin that imitates it at once, what each is by where it is. Then it learns where two
    mirrors stand that it has never looked into, how it stands before them, and in more of them the
    shape of head and chest. It compares these, unmarked, with what it expects to see, in light of
    -10 to +10 %. Then somebody paints a mark of 10 mm on head or chest, or does not, or paints the
    glass or another robot, and the robot says what is on it and where. Then the finger goes to
    marks that were found, or the robot says that they are out of reach. FAIL, with exit code 1, if
    a verdict is wrong or late, a mirror is bent, dirty, ends before the body or is more than 0.1
    deg or 0.5 mm off, a shape is more than 2 mm off in the middle or does not know how far, an
    unmarked body surprises in more than one look of a hundred, five of a hundred marks are missed,
    a control is answered wrongly, places are off by more than 3 mm in the middle, a tenth of the
    marks in reach is not touched, or anything but the finger touches the body; a PASS takes 100
    trials, 5 robots, 10 mirrors, 100 looks, 104 marks and 20 of them in reach. One that fails is
    the last, but for the shape, which nothing rests on. Some 10 s a trial and a mark, 3 s a look,
    2 s for each of 50 other ways, and 11 minutes a robot.
    """
    from nico_selfmodel.files.whole import refuse_folder
    from nico_selfmodel.systems.simulated.imperfections import imperfections_named

    refuse_folder(output.out, force=output.force)
    chosen = imperfections_named(imperfections)
    from nico_selfmodel.sessions.mirrors.knowing import glass_named

    plate = glass_named(glass)
    from nico_selfmodel.experiments.mirror_test.report import report_of
    from nico_selfmodel.experiments.mirror_test.stages import run_stages

    with printer.progress_bar() as progress:
        seeds = range(seed, seed + robots)
        test = run_stages(chosen, seeds, trials, looks, marks, plate, progress)
    report = report_of(test)
    finish(report, output)
    raise typer.Exit(1 if report.document["status"] == "FAIL" else 0)

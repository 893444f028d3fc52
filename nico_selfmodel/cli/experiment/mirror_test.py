"""`nico-selfmodel experiment mirror-test`: what chapter 10 of the thesis leaves to the future."""

from dataclasses import replace
from typing import Annotated

import typer

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.experiment.running import finish
from nico_selfmodel.cli.option_groups import Output
from nico_selfmodel.names import refuse_unknown


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
    ] = 9,
    glass: Annotated[
        str,
        typer.Option(
            "--glass", help="What is put before the robot: flat, bent, dirty or half (of a body)."
        ),
    ] = "flat",
    walls: Annotated[
        str, typer.Option("--walls", help="What mirrors show behind the robot: plain or papered.")
    ] = "plain",
    imperfections: options.Imperfections = "thesis",
    processes: options.Processes = 1,
    seed: options.FirstSeed = 0,
) -> None:
    """Is it me? What is that mark? The mirror test (chapter 10).

    A robot that has learned its cameras and an arm of six joints tells mirrors from other robots,
    from late and live pictures of itself and from a twin, and its body from its room as its torso
    turns; learns where mirrors stand, and in them the shape of head and chest, and without them
    that of forearm and hand; looks for what surprises about its body, unmarked, marked, or with
    marks on the glass or on another robot; and puts its finger on the marks that it found. FAIL,
    with exit code 1, where a stage misses a bound: docs/mirror_test.md has them all. A PASS takes
    100 trials, 5 robots, 10 mirrors, 100 looks, 117 marks and 20 of them in reach. A stage that
    fails is the last, but for shape and room, which nothing rests on. Some 10 s a trial, 10 to 25 s
    a mark, 3 s a look, 2 s for each of 50 other ways, and 10 minutes a robot; --processes shares
    robots out.
    """
    from nico_selfmodel.systems.simulated.imperfections import imperfections_named

    output.refuse()
    refuse_unknown("walls", walls, ("plain", "papered"))
    from nico_selfmodel.sessions.mirrors.knowing import PAINT_SIGMA, glass_named

    chosen = replace(
        imperfections_named(imperfections), papered=walls == "papered", paint_sigma=PAINT_SIGMA
    )
    plate = glass_named(glass)
    from nico_selfmodel.experiments.mirror_test.report import report_of
    from nico_selfmodel.experiments.mirror_test.robots_apart import run_apart
    from nico_selfmodel.experiments.mirror_test.stages import run_stages
    from nico_selfmodel.freed_memory import give_back_freed_memory
    from nico_selfmodel.systems.rendering.renderer import draw_in_one_thread

    give_back_freed_memory()
    draw_in_one_thread()
    with printer.progress_bar() as progress:
        seeds = range(seed, seed + robots)
        if processes == 1:
            test = run_stages(chosen, seeds, trials, looks, marks, plate, progress)
        else:
            test = run_apart(chosen, seeds, trials, looks, marks, plate, processes, progress)
    report = report_of(test)
    finish(report, output)
    raise typer.Exit(1 if report.document["status"] == "FAIL" else 0)

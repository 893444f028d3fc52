"""`nico-selfmodel experiment tool`: section 8.4.4 of the thesis."""

from functools import partial

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.experiment.running import finish, imperfect
from nico_selfmodel.cli.option_groups import Output


def tool(
    output: Output,
    imperfections: options.Imperfections = "clean",
    joint_noise_deg: options.JointNoise = 0.5,
    robots: options.RobotsOrOne = None,
    rendered: options.Rendered = False,
    seed: options.FirstSeed = 0,
) -> None:
    """A tool in the hand, and encoders restarted (chapter 8).

    Section 8.4.4.
    """
    from nico_selfmodel.experiments.tool_report import report_of
    from nico_selfmodel.experiments.tool_use import run_tool

    output.refuse()
    chosen, source = imperfect(imperfections, joint_noise_deg), None
    robots = robots or (1 if rendered else 8)
    if rendered:
        # The renderer is slow to load.
        from nico_selfmodel.experiments.rendered_tool import rendered_tool_scenario

        source = partial(rendered_tool_scenario, chosen)
    with printer.progress_bar() as progress:
        results = run_tool(chosen, robots, seed, progress, source)
    finish(report_of(results), output)

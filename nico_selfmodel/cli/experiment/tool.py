"""`nico-selfmodel experiment tool`: section 8.4.4 of the thesis."""

from functools import partial

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.experiment.running import imperfect, told


def tool(
    out: options.Out,
    imperfections: options.Imperfections = "clean",
    joint_noise_deg: options.JointNoise = 0.5,
    robots: options.RobotsOrOne = None,
    rendered: options.Rendered = False,
    seed: options.FirstSeed = 0,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Take a tool, and restart the encoders (section 8.4.4)."""
    from nico_selfmodel.experiments.report_files import bodies
    from nico_selfmodel.experiments.tool_report import (
        document_of,
        restart_table,
        tool_table,
        write_report,
    )
    from nico_selfmodel.experiments.tool_use import run_tool
    from nico_selfmodel.files import refuse_folder

    refuse_folder(out, force=force)
    chosen, source = imperfect(imperfections, joint_noise_deg), None
    robots = robots or (1 if rendered else 8)
    if rendered:
        # The renderer is slow to load.
        from nico_selfmodel.experiments.rendered_tool import rendered_tool_lesson

        source = partial(rendered_tool_lesson, chosen)
    with printer.progress_bar() as progress:
        results = run_tool(chosen, robots, seed, progress, source)
    write_report(results, out, force=force)
    title = f"Held-out poses, {bodies(robots)}"
    tables = [(f"{title}: a tool", *tool_table(results))]
    if results.restart:
        tables.append((f"{title}: a restart", *restart_table(results)))
    told(document_of(results), tables, out, as_json)

"""`nico-selfmodel experiment vision`: chapter 7 of the thesis."""

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.experiment.running import told


def vision(
    out: options.Out,
    imperfections: options.Imperfections = "thesis",
    robots: options.Robots = 3,
    seed: options.FirstSeed = 0,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Learn cameras and arm through rendered pictures (chapter 7); minutes a robot."""
    from nico_selfmodel.files import refuse_folder
    from nico_selfmodel.systems import world_named

    refuse_folder(out, force=force)
    chosen = world_named(imperfections)
    from nico_selfmodel.experiments.vision import document_of, run_vision, table_rows, write_report

    with printer.progress_bar() as progress:
        results = run_vision(chosen, individuals=robots, seed=seed, progress=progress)
    write_report(results, out, force=force)
    title = f"Predicted against tracked hand, new poses, {robots} simulated, {imperfections}"
    told(document_of(results), [(title, *table_rows(results))], out, as_json)

"""`nico-selfmodel experiment`: the thesis' experiments, ours beside the published figures."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import console, experiment_body

app = typer.Typer(help="Run an experiment of the thesis.", no_args_is_help=True)
app.command("refinement")(experiment_body.refinement)
app.command("tool")(experiment_body.tool)


@app.callback()
def _describe() -> None:
    """Run an experiment of the thesis."""


@app.command("stereo")
def stereo(
    out: Annotated[Path, typer.Option("--out", help="Folder for tables and charts to make.")],
    individuals: Annotated[
        int, typer.Option("--individuals", min=2, help="Simulated pairs of eyes to average over.")
    ] = 5,
    pixel_sigma: Annotated[
        float, typer.Option("--pixel-sigma", help="Noise of a corner [px].")
    ] = 0.2,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the first individual.")] = 0,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing folder.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Learn a pair of eyes with several lens models and numbers of boards (chapters 5, 8)."""
    from nico_selfmodel.experiments.stereo import report_of, run_stereo
    from nico_selfmodel.files import refuse_folder

    refuse_folder(out, force=force)
    if not 0.0 < pixel_sigma < 10.0:
        raise ValueError(f"--pixel-sigma must lie between 0 and 10 px, got {pixel_sigma}")
    with console.progress_bar() as stage:
        results = run_stereo(individuals, pixel_sigma, seed, stage)
    experiment_body.finish(report_of(results), out, force, as_json)


@app.command("motion-capture")
def motion_capture(
    out: Annotated[Path, typer.Option("--out", help="Folder for tables and charts to make.")],
    world: Annotated[str, typer.Option("--world", help="thesis or clean.")] = "thesis",
    individuals: Annotated[
        int, typer.Option("--individuals", min=1, help="Simulated robots to average over.")
    ] = 5,
    repeats: Annotated[
        int, typer.Option("--repeats", min=2, help="Random subsets of the repeat test.")
    ] = 100,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the first individual.")] = 0,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing folder.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Learn an arm under motion capture from few and from many samples (chapter 6)."""
    from nico_selfmodel.experiments.motion_capture import run_motion_capture
    from nico_selfmodel.experiments.motion_capture_report import report_of
    from nico_selfmodel.files import refuse_folder
    from nico_selfmodel.plant import ArmDescription
    from nico_selfmodel.systems import imperfections_named

    refuse_folder(out, force=force)
    chosen = imperfections_named(world)
    with console.progress_bar() as stage:
        results = run_motion_capture(
            ArmDescription.named("nico"),
            chosen,
            individuals=individuals,
            repeats=repeats,
            seed=seed,
            progress=stage,
        )
    experiment_body.finish(report_of(results), out, force, as_json)


@app.command("mirror")
def mirror(
    out: Annotated[Path, typer.Option("--out", help="Folder for tables and charts to make.")],
    individuals: Annotated[
        int | None,
        typer.Option(
            "--individuals", min=1, help="Simulated robots to average over: 5, 1 if --rendered."
        ),
    ] = None,
    pixel_sigma: Annotated[
        float | None,
        typer.Option("--pixel-sigma", help="Noise of the tracked marker [px]; 0.3 if omitted."),
    ] = None,
    play_deg: Annotated[
        float, typer.Option("--play-deg", min=0.0, help="Half the width of the joints' play.")
    ] = 0.5,
    rendered: Annotated[
        bool, typer.Option("--rendered", help="Through rendered pictures; minutes a robot.")
    ] = False,
    world: Annotated[
        str, typer.Option("--world", help="Of the rendered robots: thesis or clean.")
    ] = "thesis",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the first individual.")] = 0,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing folder.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Learn three mirrors from 10 to 50 poses and predict the hand in them (chapter 9)."""
    from nico_selfmodel.experiments.mirror import run_mirror
    from nico_selfmodel.experiments.mirror_report import report_of
    from nico_selfmodel.files import refuse_folder

    refuse_folder(out, force=force)
    if rendered and pixel_sigma is not None:
        raise ValueError("--pixel-sigma has no meaning with --rendered: pictures have their noise")
    pixel_sigma = 0.3 if pixel_sigma is None else pixel_sigma
    if not 0.0 < pixel_sigma < 10.0:
        raise ValueError(f"--pixel-sigma must lie between 0 and 10 px, got {pixel_sigma}")
    if not play_deg <= 10.0:
        raise ValueError(f"--play-deg must be at most 10, got {play_deg}")
    with console.progress_bar() as stage:
        if rendered:
            # The renderer is slow to load.
            from nico_selfmodel.experiments.mirror_rendered import run_rendered_mirror
            from nico_selfmodel.systems import imperfections_named

            chosen = imperfections_named(world).with_noise(play_deg=play_deg)
            results = run_rendered_mirror(chosen, individuals or 1, seed, progress=stage)
        else:
            results = run_mirror(individuals or 5, pixel_sigma, play_deg, seed, stage)
    experiment_body.finish(report_of(results), out, force, as_json)


@app.command("vision")
def vision(
    out: Annotated[Path, typer.Option("--out", help="Folder for table and charts to make.")],
    world: Annotated[str, typer.Option("--world", help="thesis or clean.")] = "thesis",
    individuals: Annotated[
        int, typer.Option("--individuals", min=1, help="Simulated robots to average over.")
    ] = 3,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the first individual.")] = 0,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing folder.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Learn eyes and arm by sight, through rendered pictures (chapter 7); minutes a robot."""
    from nico_selfmodel.files import refuse_folder
    from nico_selfmodel.systems import imperfections_named

    refuse_folder(out, force=force)
    chosen = imperfections_named(world)
    from nico_selfmodel.experiments.vision import report_of, run_vision

    with console.progress_bar() as stage:
        results = run_vision(chosen, individuals=individuals, seed=seed, progress=stage)
    experiment_body.finish(report_of(results), out, force, as_json)

"""`nico-selfmodel simulate`: data of a simulated body."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import console
from nico_selfmodel.cli.given_names import name_after
from nico_selfmodel.cli.robot_options import Arm, Base, Hold, Point, Robot, Tip, chosen_arm

app = typer.Typer(help="Record data of a simulated body.", no_args_is_help=True)


@app.callback()
def _describe() -> None:
    """Record data of a simulated body."""


@app.command("motion-capture")
def motion_capture(
    out: Annotated[Path, typer.Option("--out", help="Folder of the data set to make.")],
    world: Annotated[
        str, typer.Option("--world", help="Imperfections of body and tracker: thesis or clean.")
    ] = "thesis",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Which individual.")] = 0,
    session: Annotated[
        int, typer.Option("--session", min=0, help="Which recording of it: poses and noise.")
    ] = 0,
    circle_points: Annotated[
        int, typer.Option("--circle-points", min=0, help="Poses on each circle; 0 for none.")
    ] = 26,
    arc_share: Annotated[
        float, typer.Option("--arc-share", min=0.01, help="Share of the visible arcs swept.")
    ] = 1.0,
    random_poses: Annotated[int, typer.Option("--random", min=0, help="Random poses.")] = 100,
    play_deg: Annotated[
        float | None, typer.Option("--play-deg", min=0.0, help="Half the joint play, instead.")
    ] = None,
    marker_mm: Annotated[
        float | None, typer.Option("--marker-mm", min=0.0, help="Marker noise, instead.")
    ] = None,
    robot: Robot = "nico",
    arm: Arm = None,
    base: Base = None,
    tip: Tip = None,
    hold: Hold = None,
    point: Point = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing data set.")] = False,
) -> None:
    """Sweep and pose a simulated arm under motion capture; writes a data set."""
    from nico_selfmodel.experiments.protocol import simulated_session
    from nico_selfmodel.files import refuse_existing
    from nico_selfmodel.planning.sweep_protocol import Protocol
    from nico_selfmodel.systems import imperfections_named

    refuse_existing(out, force=force)
    name = name_after(out)
    if circle_points == 0 and random_poses == 0:
        raise ValueError("nothing to record: give --circle-points or --random")
    chosen = imperfections_named(world).with_noise(play_deg=play_deg, marker_mm=marker_mm)
    description = chosen_arm(robot or "nico", arm, base, tip, hold, point)
    protocol = Protocol.for_arm(description).on_share_of_arcs(arc_share)
    repeats = 1 if circle_points <= 3 else protocol.home_repeats
    protocol = replace(
        protocol,
        random_poses=random_poses,
        circle_points=max(circle_points, 1),
        home_repeats=repeats,
    )
    with console.progress_bar() as stage:
        data = simulated_session(
            description,
            chosen,
            protocol,
            name,
            seed=seed,
            session=session,
            sweeps=circle_points > 0,
            progress=lambda done, total: stage("moving", done, total),
        )
    data.save(out, force=force)
    console.out.print(f"{len(data)} rows, {len(data.joints)} joints: {out}", markup=False)

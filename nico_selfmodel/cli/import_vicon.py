"""`nico-selfmodel import vicon`: trajectories of Vicon Nexus with encoder readings beside them."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import inputs, options, printer


def from_vicon(
    trajectories: Annotated[Path, typer.Argument(help="Trajectory CSV exported by Vicon Nexus.")],
    encoders: Annotated[
        Path,
        typer.Option(
            "--encoders",
            help="CSV of readings by `frame`, or by `frame_start` and `frame_end`, averaged.",
        ),
    ],
    out: options.Out,
    encoder_unit: Annotated[
        str, typer.Option("--encoder-unit", help="counts, rad or deg.")
    ] = "counts",
    counts_per_turn: Annotated[
        float | None, typer.Option("--counts-per-turn", help="Where the unit is counts.")
    ] = None,
    marker: Annotated[
        list[str] | None, typer.Option("--marker", help="Only these markers; all by default.")
    ] = None,
    name: options.DatasetName = None,
    force: options.Force = False,
) -> None:
    """Import a trajectory export of Vicon Nexus, with encoder readings."""
    from nico_selfmodel.dataset.folder import save_dataset
    from nico_selfmodel.dataset.importers.vicon_importer import import_vicon
    from nico_selfmodel.files.whole import refuse_existing

    refuse_existing(out, force=force, inputs=[trajectories, encoders])
    if encoder_unit == "counts" and counts_per_turn is None:
        raise ValueError("--encoder-unit counts, the default, needs --counts-per-turn")
    name = name or inputs.name_after(out)
    data = import_vicon(
        trajectories,
        encoders,
        encoder_unit=encoder_unit,
        counts_per_turn=counts_per_turn,
        markers=marker or None,
        name=name,
    )
    save_dataset(data, out, force=force)
    printer.dataset(data, out)

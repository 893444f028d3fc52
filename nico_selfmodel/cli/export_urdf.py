"""`nico-selfmodel export-urdf`: the learned arm as a URDF."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import console


def export_urdf(
    model: Annotated[Path, typer.Argument(help="self_model.yaml, or a result folder.")],
    out: Annotated[Path, typer.Option("--out", help="URDF file to write.")],
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
) -> None:
    """Write the learned geometry as a URDF; the robot's own, calibrated, where it is known."""
    from nico_selfmodel.files import refuse_existing, write_whole
    from nico_selfmodel.model import SelfModel
    from nico_selfmodel.plant import ArmDescription, learned_urdf

    refuse_existing(out, force=force)
    learned = SelfModel.load(model)
    text = learned_urdf(learned, ArmDescription.of_model(learned), folder=out.parent)
    write_whole(out, text)
    console.out.print(f"{out}", markup=False)

"""`nico-selfmodel rezero`: find the encoders' zeros again after a restart."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import body_tables, console


def rezero(
    model: Annotated[Path, typer.Argument(help="The body: self_model.yaml, or its folder.")],
    dataset: Annotated[Path, typer.Argument(help="Folder of three to five poses.")],
    out: Annotated[Path, typer.Option("--out", help="Result folder to make.")],
    joint: Annotated[
        list[str] | None, typer.Option("--joint", help="A joint whose zero is lost; else all.")
    ] = None,
    sensor: Annotated[str, typer.Option("--sensor", help="auto, pixels or points.")] = "auto",
    loss: Annotated[
        str, typer.Option("--loss", help="trimmed, none, huber, cauchy or tukey.")
    ] = "trimmed",
    force: Annotated[bool, typer.Option("--force", help="Replace an existing folder.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json instead.")] = False,
) -> None:
    """Find the encoders' zeros again, everything else held."""
    from nico_selfmodel.dataset import Dataset
    from nico_selfmodel.estimation import judge, to_json
    from nico_selfmodel.estimation import rezero as find_zeros
    from nico_selfmodel.estimation.monitoring.update_evaluation import evaluate_update
    from nico_selfmodel.estimation.monitoring.update_result import rezero_result
    from nico_selfmodel.files import refuse_folder
    from nico_selfmodel.model import SelfModel

    refuse_folder(out, force=force, inputs=[dataset, model])
    known, data = SelfModel.load(model), Dataset.load(dataset)
    found = find_zeros(
        known, data, joints=tuple(joint) if joint else None, sensor=sensor, loss=loss
    )
    verdict = judge(found)
    evaluation = evaluate_update(known, found.update, data, sensor)
    document = to_json(rezero_result(found, evaluation), verdict)
    # Drawing is slow to load, and only needed once there is something to draw.
    from nico_selfmodel.viz.update_report import write_update_folder

    write_update_folder(out, evaluation, verdict, document, force=force)
    if as_json:
        console.print_json(document)
    else:
        body_tables.print_rezero(found.model.name, document, out)
    raise typer.Exit(1 if verdict.status == "FAIL" else 0)

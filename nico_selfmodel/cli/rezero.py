"""`nico-selfmodel rezero`: find the encoders' zeros again after a restart."""

from functools import partial
from typing import Annotated

import typer

from nico_selfmodel.cli import option_groups as groups
from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.calibrate import any_body
from nico_selfmodel.cli.result_files import judge_and_write


def rezero(
    context: typer.Context,
    model: options.Model,
    dataset: options.Dataset,
    output: groups.Output,
    joint: Annotated[
        list[str] | None, typer.Option("--joint", help="A joint whose zero is lost; else all.")
    ] = None,
    sensor: options.DataSensor = "auto",
    loss: options.Loss = "trimmed",
) -> None:
    """Find the encoders' zeros again from three to five poses.

    Everything else is held. Of an arm, or of a body of any tree, from a recording of poses and
    observations.
    """
    from nico_selfmodel.dataset.folder import load_dataset
    from nico_selfmodel.estimation.judging import judge
    from nico_selfmodel.estimation.monitoring.tool import rezero as find_zeros
    from nico_selfmodel.estimation.monitoring.update_evaluation import evaluate_update
    from nico_selfmodel.estimation.monitoring.update_result import rezero_result
    from nico_selfmodel.model.self_model_file import load_model
    from nico_selfmodel.model.tree.body_model import is_body

    output.refuse(dataset, model)
    if is_body(model):
        options.refuse_given(context, ["sensor", "loss"], any_body.NOISE_IS_KNOWN)
        any_body.rezero(model, dataset, output, joint)
    known, data = load_model(model), load_dataset(dataset)
    found = find_zeros(
        known, data, joints=tuple(joint) if joint else None, sensor=sensor, loss=loss
    )
    evaluation = evaluate_update(known, found.update, data, sensor)
    from nico_selfmodel.viz.reports.updates import update_report  # slow to load

    result, draw = rezero_result(found, evaluation), partial(update_report, evaluation)
    document = judge_and_write(result, evaluation.after, draw, output, verdict=judge(found))
    printer.result(found.model.name, document, output)

"""`nico-selfmodel rezero`: find the encoders' zeros again after a restart."""

from typing import Annotated

import typer

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.calibrate import any_body
from nico_selfmodel.cli.result_files import stamped, write_with_report


def rezero(
    context: typer.Context,
    model: options.Model,
    dataset: options.Dataset,
    out: options.Out,
    joint: Annotated[
        list[str] | None, typer.Option("--joint", help="A joint whose zero is lost; else all.")
    ] = None,
    sensor: options.DataSensor = "auto",
    loss: options.Loss = "trimmed",
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Find the encoders' zeros again from three to five poses, everything else held.

    Of an arm, or of a body of any tree, from a recording of poses and observations.
    """
    from nico_selfmodel.dataset.folder import load_dataset
    from nico_selfmodel.estimation.judging import judge, to_json
    from nico_selfmodel.estimation.monitoring.tool import rezero as find_zeros
    from nico_selfmodel.estimation.monitoring.update_evaluation import evaluate_update
    from nico_selfmodel.estimation.monitoring.update_result import rezero_result
    from nico_selfmodel.files.whole import refuse_folder
    from nico_selfmodel.model.self_model_file import load_model
    from nico_selfmodel.model.tree.body_model import is_body

    refuse_folder(out, force=force, inputs=[dataset, model])
    if is_body(model):
        options.refuse_given(context, ["sensor", "loss"], any_body.NOISE_IS_KNOWN)
        any_body.rezero(model, dataset, out, joints=joint, force=force, as_json=as_json)
    known, data = load_model(model), load_dataset(dataset)
    found = find_zeros(
        known, data, joints=tuple(joint) if joint else None, sensor=sensor, loss=loss
    )
    verdict = judge(found)
    evaluation = evaluate_update(known, found.update, data, sensor)
    document = stamped(to_json(rezero_result(found, evaluation), verdict))
    # Drawing is slow to load, and only needed once there is something to draw.
    from nico_selfmodel.viz.reports.updates import update_report

    write_with_report(out, evaluation.after, update_report(evaluation, document), force=force)
    printer.result(found.model.name, document, out, json_instead=as_json)

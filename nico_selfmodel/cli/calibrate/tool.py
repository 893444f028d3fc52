"""`nico-selfmodel calibrate tool`: a tool in the hand becomes part of the body."""

from functools import partial
from typing import Annotated

import typer

from nico_selfmodel.cli import inputs, options, printer
from nico_selfmodel.cli import option_groups as groups
from nico_selfmodel.cli.calibrate import any_body
from nico_selfmodel.cli.result_files import judge_and_write


def tool(
    context: typer.Context,
    dataset: options.Dataset,
    model: options.KnownModel,
    output: groups.Output,
    held_out: groups.HeldOut,
    tool: Annotated[
        str | None, typer.Option("--tool", help="Name of the tip among the tracked points.")
    ] = None,
    free_body: Annotated[
        bool, typer.Option("--free-body", help="Estimate all else too, the model as prior.")
    ] = False,
    sensor: options.DataSensor = "auto",
    loss: options.Loss = "trimmed",
) -> None:
    """Make a tool in the hand part of the body, by three poses.

    Of a body of any tree the recording lists the tip as a marker on the link that holds it.
    """
    from nico_selfmodel.estimation.judging import judge
    from nico_selfmodel.estimation.monitoring.tool import calibrate_tool, of_tip, with_marker
    from nico_selfmodel.estimation.monitoring.update_evaluation import evaluate_update
    from nico_selfmodel.estimation.monitoring.update_result import tool_result
    from nico_selfmodel.model.self_model_file import load_model
    from nico_selfmodel.model.tree.body_model import is_body

    output.refuse(dataset, model, held_out.test)
    if is_body(model):
        options.refuse_given(context, ["free_body", "sensor", "loss"], any_body.NOISE_IS_KNOWN)
        any_body.calibrate_tool(dataset, model, output, held_out, tool)
    known = load_model(model)
    train, test = inputs.train_and_test(dataset, held_out)
    free = "body" if free_body else "point"
    found = calibrate_tool(known, train, tool=tool, free=free, sensor=sensor, test=test, loss=loss)
    evaluation = evaluate_update(
        with_marker(known, found.tool),
        found.update,
        of_tip(known, train, found.tool),
        found.sensor,
        None if test is None else of_tip(known, test, found.tool),
        with_prior=free_body,
    )
    from nico_selfmodel.viz.reports.updates import update_report  # slow to load

    result, draw = tool_result(found, evaluation), partial(update_report, evaluation)
    document = judge_and_write(result, evaluation.after, draw, output, verdict=judge(found))
    printer.result(found.model.name, document, output)

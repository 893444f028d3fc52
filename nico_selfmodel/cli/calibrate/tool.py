"""`nico-selfmodel calibrate tool`: a tool in the hand becomes part of the body."""

from typing import Annotated

import typer

from nico_selfmodel.cli import inputs, options, printer
from nico_selfmodel.cli.calibrate import any_body
from nico_selfmodel.cli.result_files import stamped, write_with_report


def tool(
    context: typer.Context,
    dataset: options.Dataset,
    model: options.KnownModel,
    out: options.Out,
    tool: Annotated[
        str | None, typer.Option("--tool", help="Name of the tip among the tracked points.")
    ] = None,
    free_body: Annotated[
        bool, typer.Option("--free-body", help="Estimate all else too, the model as prior.")
    ] = False,
    sensor: options.DataSensor = "auto",
    test: options.Test = None,
    test_fraction: options.TestFraction = None,
    seed: options.SplitSeed = 0,
    loss: options.Loss = "trimmed",
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Make a tool in the hand part of the body: three numbers, from three poses on.

    Of a body of any tree the recording lists the tip as a marker on the link that holds it.
    """
    from nico_selfmodel.estimation.judging import judge, to_json
    from nico_selfmodel.estimation.monitoring.tool import calibrate_tool, of_tip, with_marker
    from nico_selfmodel.estimation.monitoring.update_evaluation import evaluate_update
    from nico_selfmodel.estimation.monitoring.update_result import tool_result
    from nico_selfmodel.files.whole import refuse_folder
    from nico_selfmodel.model.self_model_file import load_model
    from nico_selfmodel.model.tree.body_model import is_body

    refuse_folder(out, force=force, inputs=[dataset, model, test])
    if is_body(model):
        options.refuse_given(context, ["free_body", "sensor", "loss"], any_body.NOISE_IS_KNOWN)
        any_body.calibrate_tool(
            dataset,
            model,
            out,
            tool=tool,
            test=test,
            test_fraction=test_fraction,
            seed=seed,
            force=force,
            as_json=as_json,
        )
    known = load_model(model)
    train, held_out = inputs.train_and_test(dataset, test, test_fraction, seed)
    free = "body" if free_body else "point"
    found = calibrate_tool(
        known, train, tool=tool, free=free, sensor=sensor, test=held_out, loss=loss
    )
    verdict = judge(found)
    evaluation = evaluate_update(
        with_marker(known, found.tool),
        found.update,
        of_tip(known, train, found.tool),
        found.sensor,
        None if held_out is None else of_tip(known, held_out, found.tool),
        with_prior=free_body,
    )
    document = stamped(to_json(tool_result(found, evaluation), verdict))
    # Drawing is slow to load, and only needed once there is something to draw.
    from nico_selfmodel.viz.reports.updates import update_report

    write_with_report(out, evaluation.after, update_report(evaluation, document), force=force)
    printer.result(found.model.name, document, out, json_instead=as_json)

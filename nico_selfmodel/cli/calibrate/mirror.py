"""`nico-selfmodel calibrate mirror`: learn mirrors from reflections of the hand."""

from functools import partial
from typing import Annotated

import typer

from nico_selfmodel.cli import inputs, options, printer
from nico_selfmodel.cli import option_groups as groups
from nico_selfmodel.cli.calibrate import any_body
from nico_selfmodel.cli.result_files import judge_and_write


def mirror(
    context: typer.Context,
    dataset: options.Dataset,
    model: options.KnownModel,
    output: groups.Output,
    held_out: groups.HeldOut,
    joint_sigma_deg: Annotated[
        float | None,
        typer.Option(
            "--joint-sigma-deg",
            help="Noise of a joint, standard deviation; the model's noise explains it if left.",
        ),
    ] = None,
    loss: options.Loss = "trimmed",
    name: options.ModelName = None,
    require_test_px: options.RequireTestPx = None,
) -> None:
    """Learn where mirrors stand from the hand seen in them.

    The model has arm and cameras; rows of the data set name their mirror. A body whose head moves
    learns planes that stand still, from a recording of poses and observations.
    """
    from math import radians

    from nico_selfmodel.dataset.body.body_folder import is_body_dataset
    from nico_selfmodel.estimation.judging import judge
    from nico_selfmodel.estimation.mirrors.mirror import calibrate_mirrors
    from nico_selfmodel.estimation.mirrors.mirror_findings import judged
    from nico_selfmodel.model.self_model_file import load_model

    output.refuse(dataset, held_out.test, model)
    bounds = groups.Bounds(None, require_test_px)
    if is_body_dataset(dataset):
        options.refuse_given(context, ["joint_sigma_deg", "loss"], any_body.NOISE_IS_KNOWN)
        any_body.calibrate_mirrors(dataset, model, output, held_out, bounds, name=name)
    inputs.refuse_untested(bounds, held_out)
    train, test = inputs.train_and_test(dataset, held_out)
    body = load_model(model)
    with printer.progress_bar() as progress:
        progress("learning mirrors", 0, 1)
        found = calibrate_mirrors(
            train,
            body,
            test=test,
            joint_sigma=None if joint_sigma_deg is None else radians(joint_sigma_deg),
            loss=loss,
            name=name,
        )
        progress("learning mirrors", 1, 1)
        # Drawing is slow to load, and only needed once there is something to draw.
        from nico_selfmodel.plant import ArmDescription
        from nico_selfmodel.viz.reports.mirrors import mirror_report
        from nico_selfmodel.viz.scene.mirror_picture import recorded_pictures

        verdict = judge(found, require_test_px=require_test_px)
        found, pictures = judged(found, verdict), recorded_pictures(dataset, train)
        robot = ArmDescription.of_model(body) if pictures else None
        draw = partial(mirror_report, found, pictures=pictures, robot=robot)
        document = judge_and_write(found, found.model, draw, output, progress, verdict=verdict)
    printer.result(found.model.name, document, output)

"""`nico-selfmodel calibrate shape`: the outer shape of links, by pictures of them."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nico_selfmodel.cli import inputs, options, printer
from nico_selfmodel.cli import option_groups as groups
from nico_selfmodel.cli.learn.shape import shape_document, told_in_words
from nico_selfmodel.cli.result_files import judge_and_write

if TYPE_CHECKING:
    from nico_selfmodel.model.self_model import SelfModel
    from nico_selfmodel.progress import Progress


def shape(
    dataset: options.Dataset,
    model: options.KnownModel,
    output: groups.Output,
    link: Annotated[
        list[str],
        typer.Option("--link", help="Whose shape is learned; all stand still, or all move."),
    ],
    held_out: groups.HeldOut,
) -> None:
    """Learn the outer shape of links from pictures of them.

    The model has arm, cameras and its robot's description. The recording kept its pictures
    (`--images`). Links that stand still are seen in at least six mirrors, and once without: the
    hand tells where the mirrors stand. Links that the arm moves are seen without a mirror, in some
    fifty poses in a plain room. The shape has colours, and a standard deviation a vertex. Poses
    that are held out judge the mirrors, or the arm.
    """
    from nico_selfmodel.model.self_model_file import load_model

    output.refuse(dataset, held_out.test, model)
    body = load_model(model)
    from nico_selfmodel.sessions.shapes.rigid_body import all_move  # slow to load, as the renderer

    learn = _of_arm if all_move(body, link) else _in_mirrors
    with printer.progress_bar() as progress:
        name, document = learn(body, dataset, link, held_out, output, progress)
    printer.result(name, document, output, more=told_in_words(document))


def _in_mirrors(
    body: "SelfModel",
    dataset: Path,
    links: list[str],
    held_out: groups.HeldOut,
    output: groups.Output,
    progress: "Progress",
) -> tuple[str, dict[str, Any]]:
    """Learn links that stand still; return the model's name and the document."""
    import numpy as np

    from nico_selfmodel.plant import ArmDescription
    from nico_selfmodel.sessions.mirrors.recorded_shape import shape_of_recording
    from nico_selfmodel.viz.reports.mirrors import shape_report

    train, test = inputs.train_and_test(dataset, held_out)
    rng = np.random.default_rng(held_out.seed)
    found = shape_of_recording(body, train, dataset, links, rng, progress, test)
    robot = ArmDescription.of_model(body)
    document = judge_and_write(
        found.mirrors,
        found.mirrors.model,
        partial(shape_report, found.mirrors, found.shape.body, robot=robot),
        output,
        progress,
        more={"shape": shape_document(found.shape.body, mirrors=len(found.shape.all.standpoints))},
        shape=found.shape.body,
    )
    return found.mirrors.model.name, document


def _of_arm(
    body: "SelfModel",
    dataset: Path,
    links: list[str],
    held_out: groups.HeldOut,
    output: groups.Output,
    progress: "Progress",
) -> tuple[str, dict[str, Any]]:
    """Learn links that the arm moves; return the model's name and the document."""
    import numpy as np

    from nico_selfmodel.estimation.shape.arm_shape_result import arm_shape_result
    from nico_selfmodel.plant import ArmDescription
    from nico_selfmodel.sessions.shapes.moving_shape import shape_of_arm
    from nico_selfmodel.viz.reports.mirrors import arm_shape_report

    train, test = inputs.train_and_test(dataset, held_out)
    rng = np.random.default_rng(held_out.seed)
    found = shape_of_arm(body, train, dataset, links, rng, progress)
    document = judge_and_write(
        arm_shape_result(body, found.errors, train, test),
        body,
        partial(arm_shape_report, body, found.body, robot=ArmDescription.of_model(body)),
        output,
        progress,
        more={"shape": shape_document(found.body, poses=found.looks)},
        shape=found.body,
    )
    return body.name, document

"""`nico-selfmodel calibrate shape`: the outer shape of links, by pictures of them."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from nico_selfmodel.cli import inputs, options, printer
from nico_selfmodel.cli import option_groups as groups
from nico_selfmodel.cli.learn.shape import shape_document, told_in_words
from nico_selfmodel.cli.result_files import judge_and_write

if TYPE_CHECKING:
    import numpy as np

    from nico_selfmodel.dataset.dataset import Dataset
    from nico_selfmodel.estimation.judging import Calibration
    from nico_selfmodel.model.self_model import SelfModel
    from nico_selfmodel.model.shape.link_shape import BodyShape
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
    import numpy as np

    from nico_selfmodel.model.self_model_file import load_model

    output.refuse(dataset, held_out.test, model)
    body = load_model(model)
    from nico_selfmodel.plant import ArmDescription
    from nico_selfmodel.sessions.shapes.rigid_body import all_move  # slow to load, as the renderer

    learn = _of_arm if all_move(body, link) else _in_mirrors
    train, test = inputs.train_and_test(dataset, held_out)
    rng = np.random.default_rng(held_out.seed)
    with printer.progress_bar() as progress:
        found = learn(body, train, test, dataset, link, rng, progress)
        document = judge_and_write(
            found.result,
            found.model,
            partial(found.report, robot=ArmDescription.of_model(body)),
            output,
            progress,
            more={"shape": shape_document(found.shape, **found.seen_in)},
            shape=found.shape,
        )
    printer.result(found.model.name, document, output, more=told_in_words(document))


class _Learned(NamedTuple):
    """What is judged and written down."""

    result: "Calibration"
    model: "SelfModel"
    shape: "BodyShape"
    seen_in: dict[str, int]
    report: Callable[..., Any]


def _in_mirrors(
    body: "SelfModel",
    train: "Dataset",
    test: "Dataset | None",
    folder: Path,
    links: list[str],
    rng: "np.random.Generator",
    progress: "Progress",
) -> _Learned:
    """Learn links that stand still."""
    from nico_selfmodel.sessions.mirrors.recorded_shape import shape_of_recording
    from nico_selfmodel.viz.reports.mirrors import shape_report

    found = shape_of_recording(body, train, folder, links, rng, progress, test)
    mirrors, shape = found.mirrors, found.shape.body
    count, report = len(found.shape.all.standpoints), partial(shape_report, mirrors, shape)
    return _Learned(mirrors, mirrors.model, shape, {"mirrors": count}, report)


def _of_arm(
    body: "SelfModel",
    train: "Dataset",
    test: "Dataset | None",
    folder: Path,
    links: list[str],
    rng: "np.random.Generator",
    progress: "Progress",
) -> _Learned:
    """Learn links that the arm moves."""
    from nico_selfmodel.estimation.shape.arm_shape_result import arm_shape_result
    from nico_selfmodel.sessions.shapes.moving_shape import shape_of_arm
    from nico_selfmodel.viz.reports.mirrors import arm_shape_report

    found = shape_of_arm(body, train, folder, links, rng, progress)
    result = arm_shape_result(body, found.errors, train, test)
    report = partial(arm_shape_report, body, found.body)
    return _Learned(result, body, found.body, {"poses": found.looks}, report)

"""`nico-selfmodel calibrate shape`: the outer shape of links, by pictures in many mirrors."""

from functools import partial
from typing import Annotated

import typer

from nico_selfmodel.cli import inputs, options, printer
from nico_selfmodel.cli import option_groups as groups
from nico_selfmodel.cli.learn.shape import shape_document, told_in_words
from nico_selfmodel.cli.result_files import judge_and_write


def shape(
    dataset: options.Dataset,
    model: options.KnownModel,
    output: groups.Output,
    link: Annotated[
        list[str], typer.Option("--link", help="Whose shape is learned; it stands still.")
    ],
    held_out: groups.HeldOut,
) -> None:
    """Learn the outer shape of links from pictures in mirrors.

    The model has arm, cameras and its robot's description. The recording kept its pictures
    (`--images`) before at least six mirrors, and one without: the hand tells where the mirrors
    stand, the pictures the shape, in colours, with a standard deviation a vertex. Poses that are
    held out judge the mirrors.
    """
    import numpy as np

    from nico_selfmodel.model.self_model_file import load_model

    output.refuse(dataset, held_out.test, model)
    train, test = inputs.train_and_test(dataset, held_out)
    body = load_model(model)
    # The renderer is slow to load.
    from nico_selfmodel.sessions.mirrors.recorded_shape import shape_of_recording

    with printer.progress_bar() as progress:
        rng = np.random.default_rng(held_out.seed)
        found = shape_of_recording(body, train, dataset, link, rng, progress, test)
        from nico_selfmodel.plant import ArmDescription
        from nico_selfmodel.viz.reports.mirrors import shape_report

        robot = ArmDescription.of_model(body)
        draw = partial(shape_report, found.mirrors, found.shape.body, robot=robot)
        document = judge_and_write(
            found.mirrors,
            found.mirrors.model,
            draw,
            output,
            progress,
            more={"shape": shape_document(found.shape)},
            shape=found.shape.body,
        )
    printer.result(found.mirrors.model.name, document, output, more=told_in_words(document))

"""`nico-selfmodel calibrate mirror`: learn mirrors from reflections of the hand."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import console
from nico_selfmodel.cli.given_names import ModelName
from nico_selfmodel.cli.mirror_tables import print_mirrors


def mirror(
    dataset: Annotated[Path, typer.Argument(help="Folder of poses; rows name their mirror.")],
    model: Annotated[
        Path, typer.Option("--model", help="Self-model with arm and eyes, or its result folder.")
    ],
    out: Annotated[Path, typer.Option("--out", help="Result folder to make.")],
    test: Annotated[Path | None, typer.Option("--test", help="Folder of held-out data.")] = None,
    test_fraction: Annotated[
        float | None, typer.Option("--test-fraction", help="Share of the poses to hold out.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the poses held out.")] = 0,
    joint_play: Annotated[
        float | None,
        typer.Option(
            "--joint-sigma-deg",
            help="Play of a joint, as a standard deviation; the model's noise explains it if left.",
        ),
    ] = None,
    loss: Annotated[
        str, typer.Option("--loss", help="trimmed, none, huber, cauchy or tukey.")
    ] = "trimmed",
    name: ModelName = None,
    require_test_px: Annotated[
        float | None, typer.Option("--require-test-px", help="FAIL above this mean test error.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing folder.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json instead.")] = False,
) -> None:
    """Learn where mirrors stand from poses in which the eyes saw the hand in them."""
    from math import radians

    from nico_selfmodel.dataset import Dataset
    from nico_selfmodel.estimation import judge, to_json
    from nico_selfmodel.estimation.mirrors.mirror import calibrate_mirrors
    from nico_selfmodel.estimation.mirrors.mirror_findings import judged
    from nico_selfmodel.files import refuse_folder
    from nico_selfmodel.model import SelfModel

    refuse_folder(out, force=force, inputs=[dataset, test, model])
    if test is not None and test_fraction is not None:
        raise ValueError("give --test or --test-fraction, not both")
    if require_test_px is not None and not 0.0 < require_test_px < float("inf"):
        raise ValueError(f"--require-test-px must be a positive number, got {require_test_px}")
    body, train = SelfModel.load(model), Dataset.load(dataset)
    held_out = None if test is None else Dataset.load(test)
    if held_out is not None and held_out.sha256 == train.sha256:
        raise ValueError(f"--test {test} holds the training data: nothing would be held out")
    if test_fraction is not None:
        train, held_out = train.split(test_fraction, seed)
    with console.progress_bar() as stage:
        stage("learning mirrors", 0, 1)
        found = calibrate_mirrors(
            train,
            body,
            test=held_out,
            joint_sigma=None if joint_play is None else radians(joint_play),
            loss=loss,
            name=name,
        )
        verdict = judge(found, require_test_px=require_test_px)
        found = judged(found, verdict)
        document = to_json(found, verdict)
        stage("learning mirrors", 1, 1)
        stage("writing the result", 0, 1)
        # Drawing is slow to load, and only needed once there is something to draw.
        from nico_selfmodel.plant import ArmDescription
        from nico_selfmodel.viz.mirror_picture import recorded_pictures
        from nico_selfmodel.viz.mirror_report import write_mirror_folder

        pictures = recorded_pictures(dataset, train)
        robot = ArmDescription.of_model(body) if pictures else None
        write_mirror_folder(
            out, found, verdict, document, pictures=pictures, robot=robot, force=force
        )
        stage("writing the result", 1, 1)
    if as_json:
        console.print_json(document)
    else:
        print_mirrors(found.model.name, document, out)
    raise typer.Exit(1 if verdict.status == "FAIL" else 0)

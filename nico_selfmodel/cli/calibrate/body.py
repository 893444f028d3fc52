"""`nico-selfmodel calibrate body`: arm and cameras together."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import inputs, options
from nico_selfmodel.cli.calibrate import any_body, arm_and_cameras

_OF_TWO_CAMERAS = (
    "model", "board_test_fraction", "stage", "variant", "loss",
    "arm", "base", "tip", "hold", "point",
)  # fmt: skip
"""Options for an arm and two cameras."""
_OF_ANY_BODY = ("cameras", "prior", "robot_sigma")


def body(
    context: typer.Context,
    dataset: options.Dataset,
    out: options.Out,
    model: options.KnownModelOrNone = None,
    cameras: options.Cameras = None,
    boards: Annotated[
        Path | None, typer.Option("--boards", help="Photographs of a board by the cameras.")
    ] = None,
    board: options.Board = "9x6",
    square_mm: options.SquareMm = 28.0,
    tag_mm: options.TagMm = None,
    family: options.Family = None,
    board_test_fraction: Annotated[
        float, typer.Option("--board-test-fraction", help="Share of the boards to hold out.")
    ] = 0.2,
    stage: Annotated[
        str, typer.Option("--stage", help="kinematics, intrinsics-fixed or full.")
    ] = "full",
    variant: Annotated[
        str, typer.Option("--variant", help="anchored, unanchored, or the thesis' own: thesis.")
    ] = "anchored",
    test: options.Test = None,
    test_fraction: options.TestFraction = None,
    seed: options.SplitSeed = 0,
    fix: options.Fix = None,
    free: options.Free = None,
    prior: options.Prior = None,
    effects: options.Effects = "auto",
    up: options.Up = None,
    loss: options.Loss = "trimmed",
    robot: options.Robot = None,
    robot_sigma: options.RobotSigma = None,
    arm: options.Arm = None,
    base: options.Base = None,
    tip: options.Tip = None,
    hold: options.Hold = None,
    point: options.Point = None,
    name: options.ModelName = None,
    require_test_mm: options.RequireTestMm = None,
    require_test_px: options.RequireTestPx = None,
    no_report: options.NoReport = False,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Learn a body from all that was seen of it.

    A data set with `poses.csv` and `observations.csv` is of any body and any sensors, and needs
    nothing else; --boards tell lenses that it does not, and where cameras stand. One with
    `samples.csv` is of an arm and two cameras, which refine each other (thesis chapter 8): its
    --model has both cameras, and the arm if it is known.
    """
    if _is_any_body(context, dataset):
        any_body.calibrate(
            dataset,
            out,
            test=test,
            test_fraction=test_fraction,
            seed=seed,
            fix=fix,
            free=free,
            prior=prior,
            robot=robot,
            robot_sigma=robot_sigma,
            cameras=cameras,
            boards=boards,
            board=inputs.board(board, square_mm, tag_mm, family),
            name=name,
            require_test_mm=require_test_mm,
            require_test_px=require_test_px,
            no_report=no_report,
            force=force,
            as_json=as_json,
            effects=effects,
            up=up,
        )
    arm_and_cameras.calibrate(
        dataset,
        out,
        model=model,
        boards=boards,
        board=inputs.board(board, square_mm, tag_mm, family),
        board_test_fraction=board_test_fraction,
        stage=stage,
        variant=variant,
        robot=robot,
        nominal=inputs.described_arm(robot, arm, base, tip, hold, point)[1],
        test=test,
        test_fraction=test_fraction,
        seed=seed,
        fix=fix,
        free=free,
        loss=loss,
        effects=effects,
        up=up,
        name=name,
        require_test_mm=require_test_mm,
        require_test_px=require_test_px,
        no_report=no_report,
        force=force,
        as_json=as_json,
    )


def _is_any_body(context: typer.Context, dataset: Path) -> bool:
    """Return whether a data set is of any body; refuse options that its form does not use."""
    from nico_selfmodel.dataset.body.body_folder import is_body_dataset

    found = is_body_dataset(dataset)
    if found:
        why = f"{dataset} is of any body; they are for an arm and two cameras (samples.csv)"
    else:
        why = f"{dataset} is of an arm and two cameras; they are for any body (observations.csv)"
    options.refuse_given(context, _OF_TWO_CAMERAS if found else _OF_ANY_BODY, why)
    return found

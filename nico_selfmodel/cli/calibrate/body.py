"""`nico-selfmodel calibrate body`: arm and cameras together."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import inputs, options, printer
from nico_selfmodel.cli.calibrate import any_body
from nico_selfmodel.cli.result_files import NoReport, stamped, write_with_report
from nico_selfmodel.progress import Progress

if TYPE_CHECKING:
    from nico_selfmodel.dataset.board_views import BoardViews
    from nico_selfmodel.vision.boards.board_detection import AnyBoard


_OF_TWO_CAMERAS = (
    "model", "boards", "board", "square_mm", "tag_mm", "family", "board_test_fraction", "stage",
    "variant", "loss",
    "arm", "base", "tip", "hold", "point",
)  # fmt: skip
"""Options for an arm and two cameras."""
_OF_ANY_BODY = ("cameras", "prior")


def body(
    context: typer.Context,
    dataset: options.Dataset,
    out: options.Out,
    model: options.KnownModelOrNone = None,
    cameras: options.Cameras = None,
    boards: Annotated[
        Path | None, typer.Option("--boards", help="Photographs of a chessboard by both cameras.")
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
    loss: options.Loss = "trimmed",
    robot: options.Robot = None,
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
    nothing else. One with `samples.csv` is of an arm and two cameras, which refine each other
    (thesis chapter 8): its --model has both cameras, and the arm if it is known.
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
            cameras=cameras,
            name=name,
            require_test_mm=require_test_mm,
            require_test_px=require_test_px,
            no_report=no_report,
            force=force,
            as_json=as_json,
        )
    if model is None:
        raise ValueError(f"{dataset} is of an arm and two cameras: give them with --model")
    from nico_selfmodel.estimation.body.body import calibrate_body
    from nico_selfmodel.estimation.body.body_options import BodyOptions
    from nico_selfmodel.estimation.judging import judge, to_json
    from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
    from nico_selfmodel.files.whole import refuse_folder
    from nico_selfmodel.model.self_model_file import load_model

    wanted = inputs.board(board, square_mm, tag_mm, family)
    refuse_folder(out, force=force, inputs=[dataset, model, boards, test, robot])
    pins = FixedParameters.from_text(fix or (), free or ())
    chosen = BodyOptions(stage, variant, pins.pinned, pins.freed, loss)
    start = load_model(model)
    train, held_out = inputs.train_and_test(dataset, test, test_fraction, seed)
    _, nominal = inputs.described_arm(robot, arm, base, tip, hold, point)
    with printer.progress_bar() as progress:
        views, held_boards = _boards(boards, wanted, board_test_fraction, seed, progress)
        progress("learning", 0, 1)
        found = calibrate_body(
            train,
            start,
            views,
            chosen,
            test=held_out,
            test_boards=held_boards,
            nominal=nominal,
            name=name,
            seed=seed,
        )
        document = stamped(to_json(found, judge(found, require_test_mm, require_test_px)))
        progress("learning", 1, 1)
        progress("writing the result", 0, 1)
        report = NoReport(document)
        if not no_report:
            from nico_selfmodel.viz.reports.body import body_report  # slow to load

            report = body_report(found, document)
        write_with_report(out, found.model, report, force=force)
        progress("writing the result", 1, 1)
    printer.result(found.model.name, document, out, json_instead=as_json)


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


def _boards(
    folder: Path | None,
    board: "AnyBoard",
    fraction: float,
    seed: int,
    progress: Progress,
) -> tuple["BoardViews | None", "BoardViews | None"]:
    """Return the boards to learn from and those held out."""
    if folder is None:
        return None, None
    from nico_selfmodel.estimation.cameras.camera_calibration import FEWEST_VIEWS
    from nico_selfmodel.vision.boards.board_detections import detect_boards

    found = detect_boards(folder, board, progress=progress).seen_views
    if not fraction or len(found) <= FEWEST_VIEWS:
        # So few are all needed to learn from; the result says that none was held out.
        return found, None
    return found.split(fraction, seed)

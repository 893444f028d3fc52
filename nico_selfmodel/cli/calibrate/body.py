"""`nico-selfmodel calibrate body`: arm and cameras together."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nico_selfmodel.cli import inputs, options, printer
from nico_selfmodel.cli import option_groups as groups
from nico_selfmodel.cli.calibrate import any_body
from nico_selfmodel.cli.option_groups import (
    Bends,
    Bounds,
    Fixed,
    HeldOut,
    NamedOutput,
    NicoBoard,
    OptionGroup,
)
from nico_selfmodel.cli.result_files import judge_and_write
from nico_selfmodel.progress import Progress

if TYPE_CHECKING:
    from nico_selfmodel.dataset.board_views import BoardViews
    from nico_selfmodel.estimation.initialization.nominal_arm import NominalArm
    from nico_selfmodel.vision.boards.board_detection import AnyBoard
    from nico_selfmodel.viz.reports.page import Report


_OF_TWO_CAMERAS = (
    "model", "board_test_fraction", "stage", "variant", "loss",
    "arm", "base", "tip", "hold", "point",
)  # fmt: skip
"""Options for an arm and two cameras."""
_OF_ANY_BODY = ("cameras", "prior", "robot_sigma")


@dataclass(frozen=True)
class Boards(NicoBoard):
    """Photographs of a board by the body's cameras."""

    boards: Annotated[
        Path | None, typer.Option("--boards", help="Photographs of a board by the cameras.")
    ] = None
    board_test_fraction: Annotated[
        float, typer.Option("--board-test-fraction", help="Share of the boards to hold out.")
    ] = 0.2


@dataclass(frozen=True)
class Choices(OptionGroup):
    """What is refined, from which arm and cameras."""

    model: options.KnownModelOrNone = None
    stage: Annotated[str, typer.Option("--stage", help="kinematics, intrinsics-fixed or full.")] = (
        "full"
    )
    variant: Annotated[
        str, typer.Option("--variant", help="anchored, unanchored, or the thesis' own: thesis.")
    ] = "anchored"
    loss: options.Loss = "trimmed"


def body(
    context: typer.Context,
    dataset: options.Dataset,
    output: groups.NamedOutput,
    held_out: groups.HeldOut,
    fixed: groups.Fixed,
    known: any_body.Known,
    bounds: groups.Bounds,
    bends: groups.Bends,
    chain: groups.Chain,
    boards: Boards,
    choices: Choices,
    robot_sigma: options.RobotSigma = None,
) -> None:
    """Learn a body from all that was seen of it.

    A data set with `poses.csv` and `observations.csv` is of any body and any sensors, and needs
    nothing else; --boards tell lenses that it does not, and where cameras stand. One with
    `samples.csv` is of an arm and two cameras, which refine each other (thesis chapter 8): its
    --model has both cameras, and the arm if it is known.
    """
    any_tree = _is_any_body(context, dataset)
    board = boards.load()
    if any_tree:
        any_body.calibrate(
            dataset,
            output,
            held_out,
            fixed,
            known,
            bounds,
            bends=bends,
            robot=chain.robot,
            robot_sigma=robot_sigma,
            boards=boards.boards,
            board=board,
        )
    nominal = inputs.described_arm(chain)[1]
    _calibrate(
        dataset,
        output,
        held_out,
        fixed,
        bounds,
        bends,
        boards,
        board,
        choices,
        chain.robot,
        nominal,
    )


def _is_any_body(context: typer.Context, dataset: Path) -> bool:
    """Return whether a data set is of any body; refuse options that its form does not use."""
    from nico_selfmodel.dataset.body.body_folder import is_body_dataset

    found = is_body_dataset(dataset)
    if found:
        why = f"{dataset} is of any body; such options are for an arm and two cameras"
    else:
        why = f"{dataset} is of an arm and two cameras; such options are for any body"
    options.refuse_given(context, _OF_TWO_CAMERAS if found else _OF_ANY_BODY, why)
    return found


def _calibrate(
    dataset: Path,
    output: NamedOutput,
    held_out: HeldOut,
    fixed: Fixed,
    bounds: Bounds,
    bends: Bends,
    boards: Boards,
    board: "AnyBoard",
    choices: Choices,
    robot: str | None,
    nominal: "NominalArm | None",
) -> None:
    """Learn an arm and two cameras together, and leave a result folder.

    Raises:
        ValueError: If no self-model with both cameras is given.
    """
    from nico_selfmodel.dataset.folder import load_dataset

    if choices.model is None:
        data = load_dataset(dataset)  # says what it is instead
        if data.measured.any():
            raise ValueError(
                f"{dataset} has points of an arm that a tracker measured: learn it with "
                "`nico-selfmodel calibrate kinematics`, or make a recording of any body of it with "
                "`nico-selfmodel convert`"
            )
        raise ValueError(f"{dataset} is of an arm and two cameras: give them with --model")
    from nico_selfmodel.estimation.bending.what_bends import effects_of, up_of
    from nico_selfmodel.estimation.body.body import calibrate_body
    from nico_selfmodel.estimation.body.body_options import BodyOptions
    from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
    from nico_selfmodel.model.self_model_file import load_model

    inputs_read = [dataset, choices.model, boards.boards, held_out.test, robot]
    output.refuse(*inputs_read)
    inputs.refuse_untested(bounds, held_out)
    pins = FixedParameters.from_text(fixed.fix or (), fixed.free or ())
    may_bend, vertical = effects_of(bends.effects), up_of(bends.up)
    chosen = BodyOptions(choices.stage, choices.variant, pins, choices.loss)
    start = load_model(choices.model)
    train, test = inputs.train_and_test(dataset, held_out)
    with printer.progress_bar() as progress:
        views, held_boards = _views(boards, board, held_out.seed, progress)
        progress("learning", 0, 1)
        found = calibrate_body(
            train,
            start,
            views,
            chosen,
            test=test,
            test_boards=held_boards,
            nominal=nominal,
            name=output.name,
            seed=held_out.seed,
            effects=may_bend,
            up=vertical,
        )
        progress("learning", 1, 1)

        def draw(document: dict[str, Any]) -> "Report":
            from nico_selfmodel.viz.reports.body import body_report  # slow to load

            return body_report(found, document)

        document = judge_and_write(found, found.model, draw, output, progress, bounds=bounds)
    printer.result(found.model.name, document, output)


def _views(
    boards: Boards, board: "AnyBoard", seed: int, progress: Progress
) -> tuple["BoardViews | None", "BoardViews | None"]:
    """Return the boards to learn from and those held out."""
    if boards.boards is None:
        return None, None
    from nico_selfmodel.estimation.cameras.camera_calibration import FEWEST_VIEWS
    from nico_selfmodel.vision.boards.board_detections import detect_boards

    found = detect_boards(boards.boards, board, progress=progress).told_views
    if not boards.board_test_fraction or len(found) <= FEWEST_VIEWS:
        # So few are all needed to learn from; the result says that none was held out.
        return found, None
    return found.split(boards.board_test_fraction, seed)

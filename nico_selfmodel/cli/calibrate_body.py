"""`nico-selfmodel calibrate body` and `calibrate tool`: arm and eyes together, and what is held."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import body_tables, console
from nico_selfmodel.cli.given_names import ModelName
from nico_selfmodel.cli.robot_options import Arm, Base, Hold, Point, Robot, Tip, chosen_arm

if TYPE_CHECKING:
    from nico_selfmodel.dataset import BoardViews, Dataset
    from nico_selfmodel.estimation import NominalArm

Data = Annotated[Path, typer.Argument(help="Folder of the training data, with pixels.")]
Out = Annotated[Path, typer.Option("--out", help="Result folder to make.")]
Test = Annotated[Path | None, typer.Option("--test", help="Folder of held-out data.")]
TestFraction = Annotated[
    float | None, typer.Option("--test-fraction", help="Share of the poses to hold out.")
]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Of what is held out, and of starts.")]
LossName = Annotated[str, typer.Option("--loss", help="trimmed, none, huber, cauchy or tukey.")]
Force = Annotated[bool, typer.Option("--force", help="Replace an existing folder.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print result.json instead.")]


def body(
    dataset: Data,
    model: Annotated[
        Path, typer.Option("--model", help="Self-model with both eyes, and the arm if known.")
    ],
    out: Out,
    boards: Annotated[
        Path | None, typer.Option("--boards", help="Photographs of a chessboard by both eyes.")
    ] = None,
    board: Annotated[
        str, typer.Option("--board", metavar="COLSxROWS", help="Its inner corners.")
    ] = "9x6",
    square_mm: Annotated[float, typer.Option("--square-mm", help="Side of a square.")] = 28.0,
    board_test_fraction: Annotated[
        float, typer.Option("--board-test-fraction", help="Share of the boards to hold out.")
    ] = 0.2,
    stage: Annotated[
        str, typer.Option("--stage", help="kinematics, intrinsics-pinned or full.")
    ] = "full",
    variant: Annotated[
        str, typer.Option("--variant", help="anchored, unanchored, or the thesis' own: thesis.")
    ] = "anchored",
    test: Test = None,
    test_fraction: TestFraction = None,
    seed: Seed = 0,
    pin: Annotated[
        list[str] | None, typer.Option("--pin", metavar="NAME[=VALUE]", help="Hold a parameter.")
    ] = None,
    free: Annotated[
        list[str] | None, typer.Option("--free", metavar="NAME", help="Let a parameter move.")
    ] = None,
    loss: LossName = "trimmed",
    robot: Robot = None,
    arm: Arm = None,
    base: Base = None,
    tip: Tip = None,
    hold: Hold = None,
    point: Point = None,
    name: ModelName = None,
    require_test_mm: Annotated[
        float | None, typer.Option("--require-test-mm", help="FAIL above this mean test error.")
    ] = None,
    require_test_px: Annotated[
        float | None, typer.Option("--require-test-px", help="FAIL above this mean test error.")
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Let arm and eyes refine each other by where the eyes saw the hand (thesis chapter 8)."""
    from nico_selfmodel.estimation import BodyOptions, Pins, calibrate_body, judge, to_json
    from nico_selfmodel.files import refuse_folder
    from nico_selfmodel.model import SelfModel

    refuse_folder(out, force=force, inputs=[dataset, model, boards, test, robot])
    pins = Pins.from_text(pin or (), free or ())
    options = BodyOptions(stage, variant, pins.pinned, pins.freed, loss)
    start = SelfModel.load(model)
    train, held_out = _split(dataset, test, test_fraction, seed)
    nominal = _nominal(robot, arm, base, tip, hold, point)
    with console.progress_bar() as stage_bar:
        views, held_boards = _boards(boards, board, square_mm, board_test_fraction, seed, stage_bar)
        stage_bar("learning", 0, 1)
        found = calibrate_body(
            train,
            start,
            views,
            options,
            test=held_out,
            test_boards=held_boards,
            nominal=nominal,
            name=name,
            seed=seed,
        )
        verdict = judge(found, require_test_mm, require_test_px)
        document = to_json(found, verdict)
        stage_bar("learning", 1, 1)
        stage_bar("writing the result", 0, 1)
        # Drawing is slow to load, and only needed once there is something to draw.
        from nico_selfmodel.viz.body_report import write_body_folder

        write_body_folder(out, found, verdict, document, force=force)
        stage_bar("writing the result", 1, 1)
    if as_json:
        console.print_json(document)
    else:
        body_tables.print_body(found.model.name, document, out)
    raise typer.Exit(1 if verdict.status == "FAIL" else 0)


def tool(
    model: Annotated[Path, typer.Argument(help="The body: self_model.yaml, or its folder.")],
    dataset: Annotated[Path, typer.Argument(help="Folder of poses that show the tool's tip.")],
    out: Out,
    tool: Annotated[
        str | None, typer.Option("--tool", help="Name of the tip among the tracked points.")
    ] = None,
    free: Annotated[
        str, typer.Option("--free", help="point: the tip alone; body: all else too, as known.")
    ] = "point",
    sensor: Annotated[str, typer.Option("--sensor", help="auto, pixels or points.")] = "auto",
    test: Test = None,
    test_fraction: TestFraction = None,
    seed: Seed = 0,
    loss: LossName = "trimmed",
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Make a tool in the hand part of the body: three numbers, from three poses on."""
    from nico_selfmodel.estimation import calibrate_tool, judge, to_json
    from nico_selfmodel.estimation.monitoring.tool import with_marker
    from nico_selfmodel.estimation.monitoring.update_evaluation import evaluate_update, marked
    from nico_selfmodel.estimation.monitoring.update_result import tool_result
    from nico_selfmodel.files import refuse_folder
    from nico_selfmodel.model import SelfModel

    refuse_folder(out, force=force, inputs=[dataset, model, test])
    known = SelfModel.load(model)
    train, held_out = _split(dataset, test, test_fraction, seed)
    found = calibrate_tool(
        known, train, tool=tool, free=free, sensor=sensor, test=held_out, loss=loss
    )
    verdict = judge(found)
    evaluation = evaluate_update(
        with_marker(known, found.tool),
        found.update,
        marked(train, found.tool),
        found.sensor,
        None if held_out is None else marked(held_out, found.tool),
        with_prior=free == "body",
    )
    document = to_json(tool_result(found, evaluation), verdict)
    # Drawing is slow to load, and only needed once there is something to draw.
    from nico_selfmodel.viz.update_report import write_update_folder

    write_update_folder(out, evaluation, verdict, document, force=force)
    if as_json:
        console.print_json(document)
    else:
        body_tables.print_tool(found.model.name, document, out)
    raise typer.Exit(1 if verdict.status == "FAIL" else 0)


def _split(
    dataset: Path, test: Path | None, fraction: float | None, seed: int
) -> tuple["Dataset", "Dataset | None"]:
    """Return training and held-out data."""
    from nico_selfmodel.dataset import Dataset

    if test is not None and fraction is not None:
        raise ValueError("give --test or --test-fraction, not both")
    train = Dataset.load(dataset)
    if fraction is not None:
        return train.split(fraction, seed)
    held_out = None if test is None else Dataset.load(test)
    if held_out is not None and held_out.sha256 == train.sha256:
        raise ValueError(f"--test {test} holds the training data: nothing would be held out")
    return train, held_out


def _boards(
    folder: Path | None,
    board: str,
    square_mm: float,
    fraction: float,
    seed: int,
    stage: console.Stage,
) -> tuple["BoardViews | None", "BoardViews | None"]:
    """Return the boards to learn from and those held out."""
    if folder is None:
        return None, None
    from nico_selfmodel.estimation.cameras.stereo import FEWEST_VIEWS
    from nico_selfmodel.vision import Board, detect_boards

    found = detect_boards(folder, Board.parse(board, square_mm), progress=stage).seen_views
    if not fraction or len(found) <= FEWEST_VIEWS:
        # So few are all needed to learn from; the result says that none was held out.
        return found, None
    return found.split(fraction, seed)


def _nominal(
    robot: str | None,
    arm: str | None,
    base: str | None,
    tip: str | None,
    hold: list[str] | None,
    point: list[str] | None,
) -> "NominalArm | None":
    """Return the robot as described, where one was named."""
    if robot is None:
        if any((arm, base, tip, hold, point)):
            raise ValueError("--arm, --base, --tip, --hold and --point need --robot")
        return None
    from nico_selfmodel.experiments.first_arm import nominal_of

    return nominal_of(chosen_arm(robot, arm, base, tip, hold, point))

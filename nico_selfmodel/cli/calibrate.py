"""`nico-selfmodel calibrate`: learn from recorded data."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import calibrate_body, calibrate_cameras, calibrate_mirror, console
from nico_selfmodel.cli.given_names import ModelName
from nico_selfmodel.cli.robot_options import (
    Arm,
    Base,
    Hold,
    Point,
    Robot,
    Tip,
    check_points,
    chosen_arm,
)

if TYPE_CHECKING:
    from nico_selfmodel.dataset import Dataset
    from nico_selfmodel.estimation.body.arm_through_cameras import Sight

app = typer.Typer(help="Learn a self-model from recorded data.", no_args_is_help=True)
app.command("stereo")(calibrate_cameras.stereo)
app.command("camera")(calibrate_cameras.camera)
app.command("body")(calibrate_body.body)
app.command("tool")(calibrate_body.tool)
app.command("mirror")(calibrate_mirror.mirror)


@app.callback()
def _describe() -> None:
    """Learn a self-model from recorded data."""


@app.command("kinematics")
def kinematics(
    dataset: Annotated[Path, typer.Argument(help="Folder of the training data.")],
    out: Annotated[Path, typer.Option("--out", help="Result folder to make.")],
    test: Annotated[Path | None, typer.Option("--test", help="Folder of held-out data.")] = None,
    test_fraction: Annotated[
        float | None,
        typer.Option("--test-fraction", help="Share of the poses beside sweeps to hold out."),
    ] = None,
    seed: Annotated[
        int, typer.Option("--seed", min=0, help="Of the split and of random starts.")
    ] = 0,
    method: Annotated[
        str, typer.Option("--method", help="refine, or circle-points for the sweeps alone.")
    ] = "refine",
    pin: Annotated[
        list[str] | None, typer.Option("--pin", metavar="NAME[=VALUE]", help="Hold a parameter.")
    ] = None,
    free: Annotated[
        list[str] | None, typer.Option("--free", metavar="NAME", help="Let a parameter move.")
    ] = None,
    loss: Annotated[
        str, typer.Option("--loss", help="trimmed, none, huber, cauchy or tukey.")
    ] = "trimmed",
    starts: Annotated[int, typer.Option("--starts", min=0, help="Random starts allowed.")] = 10,
    robot: Robot = None,
    arm: Arm = None,
    base: Base = None,
    tip: Tip = None,
    hold: Hold = None,
    point: Point = None,
    eyes: Annotated[
        Path | None,
        typer.Option(
            "--eyes",
            help="Result of `calibrate stereo`: learn from the hand's pixels, in the left eye's "
            "frame.",
        ),
    ] = None,
    name: ModelName = None,
    require_test_mm: Annotated[
        float | None, typer.Option("--require-test-mm", help="FAIL above this mean test error.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing folder.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json instead.")] = False,
) -> None:
    """Learn an arm from encoder readings and measured points of the hand."""
    from nico_selfmodel.estimation import Pins, calibrate_kinematics, judge, result_of, to_json
    from nico_selfmodel.files import refuse_folder

    refuse_folder(out, force=force, inputs=[dataset, test, robot, eyes])
    _check_options(robot, (arm, base, tip, hold, point), require_test_mm)
    _check_held_out(test, test_fraction)
    pins = Pins.from_text(pin or (), free or ())
    train, held_out = _parts(dataset, test, test_fraction, seed)
    sight = None if eyes is None else _by_sight(eyes, train, held_out, frozenset(pins.pinned))
    if sight is not None:
        train, held_out = sight.train, sight.test
    description, nominal = None, None
    if robot is not None:
        from nico_selfmodel.experiments.first_arm import nominal_of

        description = chosen_arm(robot, arm, base, tip, hold, point)
        check_points(point, train.markers)
        nominal = nominal_of(description)
    with console.progress_bar() as stage:
        stage("learning", 0, 1)
        calibration = calibrate_kinematics(
            train,
            method=method,
            test=held_out,
            nominal=nominal,
            pins=pins,
            loss=loss,
            starts=starts,
            seed=seed,
            name=name,
        )
        if sight is not None:
            calibration = sight.complete(calibration)
        stage("learning", 1, 1)
        result = result_of(calibration)
        if sight is not None:
            result = sight.with_pixels(result, calibration.model)
        verdict = judge(result, require_test_mm)
        document = to_json(result, verdict)
        stage("writing the result", 0, 1)
        # Drawing is slow to load, and only needed once there is something to draw.
        from nico_selfmodel.plant import learned_urdf
        from nico_selfmodel.viz import write_result_folder

        write_result_folder(
            out,
            calibration,
            verdict,
            document,
            urdf_text=learned_urdf(calibration.model, description, folder=out),
            robot_name=Path(description.robot).stem if description else None,
            robot=description,
            force=force,
        )
        stage("writing the result", 1, 1)
    if as_json:
        console.print_json(document)
    else:
        console.print_calibration(calibration.model.name, document, out)
    raise typer.Exit(1 if verdict.status == "FAIL" else 0)


def _parts(
    dataset: Path, test: Path | None, test_fraction: float | None, seed: int
) -> "tuple[Dataset, Dataset | None]":
    """Load the training data and what is held out of them or beside them."""
    from nico_selfmodel.dataset import Dataset

    train = Dataset.load(dataset)
    if test_fraction is not None:
        return train.split(test_fraction, seed)
    held_out = None if test is None else Dataset.load(test)
    if held_out is not None and held_out.sha256 == train.sha256:
        raise ValueError(f"--test {test} holds the training data: nothing would be held out")
    return train, held_out


def _by_sight(
    eyes: Path, train: "Dataset", held_out: "Dataset | None", pinned: frozenset[str]
) -> "Sight":
    """Reconstruct the hand from its pixels with calibrated eyes."""
    from nico_selfmodel.estimation.body.arm_through_cameras import Sight
    from nico_selfmodel.model import SelfModel

    return Sight.of(SelfModel.load(eyes), train, held_out, pinned)


def _check_options(
    robot: str | None, chain: tuple[object, ...], require_test_mm: float | None
) -> None:
    """Refuse options that would be ignored, and a bound that is none."""
    if robot is None and any(chain):
        raise ValueError("--arm, --base, --tip, --hold and --point need --robot")
    if require_test_mm is not None and not 0.0 < require_test_mm < float("inf"):
        raise ValueError(f"--require-test-mm must be a positive number, got {require_test_mm}")


def _check_held_out(test: Path | None, test_fraction: float | None) -> None:
    """Refuse two ways of holding out at once, and a share that is none."""
    if test_fraction is None:
        return
    if test is not None:
        raise ValueError("give --test or --test-fraction, not both")
    if not 0.0 < test_fraction < 1.0:
        raise ValueError(
            f"--test-fraction must lie between 0 and 1, both exclusive, got {test_fraction:g}"
        )

"""`nico-selfmodel learn`: the main job."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nico_selfmodel.cli import console
from nico_selfmodel.cli.robot_options import Arm, Base, Hold, Point, Robot, Tip, chosen_arm

if TYPE_CHECKING:
    from nico_selfmodel.experiments.first_arm import MotionCaptureScenario
    from nico_selfmodel.plant import ArmDescription
    from nico_selfmodel.systems import Imperfections

SENSORS = ("stereo-fiducial", "stereo-color", "motion-capture")


def learn(
    out: Annotated[Path, typer.Option("--out", help="Result folder to make.")] = Path("first_arm"),
    world: Annotated[
        str, typer.Option("--world", help="Imperfections of the body: thesis or clean.")
    ] = "thesis",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Which individual wakes up.")] = 0,
    random_poses: Annotated[
        int, typer.Option("--random", min=0, help="Random training poses beside the circles.")
    ] = 100,
    sensor: Annotated[
        str | None,
        typer.Option(
            "--sensor",
            help=f"Who watches: {', '.join(SENSORS)}. By default Nico's eyes; motion capture where "
            "another robot or arm is named.",
        ),
    ] = None,
    mirror: Annotated[
        bool,
        typer.Option("--mirror", help="Put a mirror before the robot at last; needs its eyes."),
    ] = False,
    robot: Robot = "nico",
    arm: Arm = None,
    base: Base = None,
    tip: Tip = None,
    hold: Hold = None,
    point: Point = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing folder.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json instead.")] = False,
) -> None:
    """Let a simulated robot watch its hand as it moves its arm; it learns eyes, arm, then both."""
    from nico_selfmodel.files import refuse_folder

    refuse_folder(out, force=force)
    # What learns and draws is slow to load, and only needed once the input is known to be right.
    from nico_selfmodel.systems import imperfections_named

    chosen_world = imperfections_named(world)
    chain = (arm, base, tip, hold, point)
    elsewhere = robot not in (None, "nico") or any(chain)
    sensor = _chosen_sensor(sensor, elsewhere)
    if sensor != "motion-capture":
        from nico_selfmodel.cli.learn_by_sight import learn_by_sight

        learn_by_sight(out, sensor, chosen_world, seed, random_poses, force, as_json, mirror)
    elif mirror:
        raise ValueError("--mirror needs eyes: --sensor stereo-fiducial or stereo-color")
    else:
        description = chosen_arm(robot or "nico", *chain)
        _by_motion_capture(out, chosen_world, seed, random_poses, description, force, as_json)


def _chosen_sensor(sensor: str | None, elsewhere: bool) -> str:
    """Return who watches; refuse eyes that another robot or arm does not have."""
    if sensor is None:
        return "motion-capture" if elsewhere else _eyes_or_else()
    if sensor not in SENSORS:
        raise ValueError(f"no sensor {sensor!r}; there are {', '.join(SENSORS)}")
    if elsewhere and sensor != "motion-capture":
        raise ValueError(
            f"--sensor {sensor} is for Nico's own right arm: leave out the options that choose "
            "another one, or take --sensor motion-capture"
        )
    return sensor


def _eyes_or_else() -> str:
    """Return Nico's eyes, or motion capture where nothing can be rendered, and say so."""
    from nico_selfmodel.systems.renderer import can_render

    if can_render():
        return "stereo-fiducial"
    warnings.warn(
        "nothing can be rendered here (libegl1 and libgl1-mesa-dri are missing): motion capture "
        "watches instead of the eyes",
        stacklevel=2,
    )
    return "motion-capture"


def _by_motion_capture(
    out: Path,
    world: "Imperfections",
    seed: int,
    random_poses: int,
    description: "ArmDescription",
    force: bool,
    as_json: bool,
) -> None:
    """Learn an arm from what motion capture sees of it (chapter 6)."""
    from nico_selfmodel.estimation import judge, to_json
    from nico_selfmodel.experiments.first_arm import learn_by_motion_capture
    from nico_selfmodel.plant import learned_urdf
    from nico_selfmodel.viz import write_result_folder

    with console.progress_bar() as stage:
        first = learn_by_motion_capture(
            description, world, seed=seed, random_poses=random_poses, stage=stage
        )
        stage("writing the result", 0, 1)
        verdict = judge(first.refined)
        write_result_folder(
            out,
            first.refined,
            verdict,
            urdf_text=learned_urdf(first.refined.model, description, folder=out),
            robot_name=Path(description.robot).stem,
            robot=description,
            recordings={"train": first.train, "test": first.test},
            force=force,
        )
        stage("writing the result", 1, 1)
    document = to_json(first.refined, verdict)
    if as_json:
        console.print_json(document)
    else:
        _print(first, document, out)
    raise typer.Exit(1 if verdict.status == "FAIL" else 0)


def _print(first: "MotionCaptureScenario", document: Mapping[str, Any], out: Path) -> None:
    circles = first.circle_points.test if first.circle_points else None
    alone = circles and {"n": circles.statistics.n, "position_mm": circles.statistics.as_mm()}
    console.print_table(
        f"{first.refined.model.name}: error of the predicted hand position",
        console.STATISTICS_HEADINGS,
        [
            console.statistics_row("held out, circle points", alone),
            console.statistics_row("held out, refined", document["test"]),
            console.statistics_row("training, refined", document["train"]),
            ["thesis, refined (real robot)", "100", "3.19", "1.71", "-", "-", "-"],
        ],
    )
    console.print_outliers(document)
    console.print_verdict(document["status"], document["reasons"], document.get("warnings", ()))
    console.print_where(out)

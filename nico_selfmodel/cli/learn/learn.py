"""`nico-selfmodel learn`: the main job."""

import warnings
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nico_selfmodel.cli import inputs, options, printer
from nico_selfmodel.cli import option_groups as groups
from nico_selfmodel.cli.result_files import judge_and_write
from nico_selfmodel.names import refuse_unknown

if TYPE_CHECKING:
    from nico_selfmodel.plant import ArmDescription
    from nico_selfmodel.systems.simulated.imperfections import Imperfections

_OF_ONE_ARM = ("random_poses", "sensor", "mirror", "robot", "arm", "base", "tip", "hold", "point")
"""Options for one arm before a head that stands still, or for another robot."""
SENSORS = ("stereo-fiducial", "stereo-color", "motion-capture")


@dataclass(frozen=True)
class FirstArm(groups.Output):
    """The folder to make; a first arm's where nothing is said."""

    out: options.Out = Path("first_arm")


def learn(
    context: typer.Context,
    chain: groups.NicoOrChain,
    output: FirstArm,
    imperfections: options.Imperfections = "thesis",
    seed: options.RobotSeed = 0,
    random_poses: options.RandomPoses = 100,
    sensor: Annotated[
        str | None,
        typer.Option(
            "--sensor",
            help=f"Who watches: {', '.join(SENSORS)}. By default Nico's cameras; motion capture "
            "where another robot or arm is named.",
        ),
    ] = None,
    mirror: Annotated[
        bool,
        typer.Option("--mirror", help="Put a mirror before the robot at last; needs its cameras."),
    ] = False,
    head: Annotated[
        bool,
        typer.Option("--head", help="Let the head turn and be learned, with the lenses, too."),
    ] = False,
    arms: options.Arms = None,
    shape: Annotated[
        bool,
        typer.Option(
            "--shape",
            help="Let the robot learn an arm of six joints, two mirrors, and in these and twelve "
            "more the outer shape of head and chest, kept in body/. Some 7 minutes.",
        ),
    ] = False,
) -> None:
    """Let a simulated robot learn its body by watching its hand.

    It looks at a chessboard, moves every joint before its cameras, and learns the cameras, the arm,
    and then both together.
    """
    output.refuse()
    # What learns and draws is slow to load, and only needed once the input is known to be right.
    from nico_selfmodel.systems.simulated.imperfections import imperfections_named

    world = imperfections_named(imperfections)
    if shape:
        from nico_selfmodel.cli.learn.shape import learn_shape

        why = "with --shape Nico learns its right arm of six joints, by its cameras, and mirrors"
        options.refuse_given(context, (*_OF_ONE_ARM, "head", "arms"), why)
        learn_shape(output, world, seed)
    if head or arms is not None:
        from nico_selfmodel.cli.learn.whole_body import learn_whole_body

        why = "with --head Nico's own cameras watch its whole arms"
        options.refuse_given(context, _OF_ONE_ARM, why)
        learn_whole_body(output, world, seed, _chosen_arms(arms, head=head))
    elsewhere = chain.robot not in (None, "nico") or chain.names_a_part
    sensor = _chosen_sensor(sensor, elsewhere)
    if sensor != "motion-capture":
        from nico_selfmodel.cli.learn.by_cameras import learn_by_cameras

        learn_by_cameras(output, sensor, world, seed, random_poses, mirror)
    if mirror:
        raise ValueError("--mirror needs cameras: --sensor stereo-fiducial or stereo-color")
    description = inputs.chosen_arm(chain)
    _by_motion_capture(output, world, seed, random_poses, description)


def _chosen_arms(arms: str | None, *, head: bool) -> tuple[str, ...]:
    """Return the arms to learn; refuse those that there are not."""
    chosen = inputs.arms_named(arms)
    if not head:
        raise ValueError(
            f"--arms {arms} needs --head, which turns to the hands; without both, `learn` is of "
            "the right arm's four joints before a head that stands still"
        )
    return chosen


def _chosen_sensor(sensor: str | None, elsewhere: bool) -> str:
    """Return who watches; refuse cameras that another robot or arm does not have."""
    if sensor is None:
        return "motion-capture" if elsewhere else _cameras_or_else()
    refuse_unknown("sensor", sensor, SENSORS)
    if elsewhere and sensor != "motion-capture":
        raise ValueError(
            f"--sensor {sensor} is for Nico's own right arm: leave out the options that choose "
            "another one, or take --sensor motion-capture"
        )
    return sensor


def _cameras_or_else() -> str:
    """Return Nico's cameras, or motion capture where nothing can be rendered, and say so."""
    from nico_selfmodel.systems.rendering.renderer import can_render

    if can_render():
        return "stereo-fiducial"
    warnings.warn(
        "nothing can be rendered here (libegl1 and libgl1-mesa-dri are missing): motion capture "
        "watches instead of the cameras",
        stacklevel=2,
    )
    return "motion-capture"


def _by_motion_capture(
    output: groups.Output,
    world: "Imperfections",
    seed: int,
    random_poses: int,
    description: "ArmDescription",
) -> None:
    """Learn an arm from what motion capture sees of it (chapter 6)."""
    from nico_selfmodel.sessions.motion_capture_scenario import learn_by_motion_capture
    from nico_selfmodel.viz.reports.arm import arm_report

    with printer.progress_bar() as progress:
        first = learn_by_motion_capture(
            description, world, seed=seed, random_poses=random_poses, stage=progress
        )
        document = judge_and_write(
            first.refined,
            first.refined.model,
            partial(arm_report, first.refined, robot=description),
            output,
            progress,
            robot=description,
            recordings={"train": first.train, "test": first.test},
        )
    circles = first.circle_points.test if first.circle_points else None
    alone = circles and {"n": circles.statistics.n, "position_mm": circles.statistics.as_mm()}
    thesis: dict[str, Any] = {"n": 100, "position_mm": {"mean": 3.19, "sd": 1.71}}
    parts = [
        ("held out, circle points", alone),
        ("held out, refined", document["test"]),
        ("training, refined", document["train"]),
        ("thesis, refined (real robot)", thesis),
    ]
    printer.result(first.refined.model.name, document, output, parts=parts)

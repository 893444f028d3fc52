"""`nico-selfmodel record`: watch a robot move, by motion capture or by its own eyes."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import console
from nico_selfmodel.cli.given_names import name_after
from nico_selfmodel.cli.record_hardware import (
    REAL,
    Baud,
    Config,
    Hardware,
    LeftCamera,
    MotionCapture,
    RightCamera,
    Speed,
    TrustZero,
    Yes,
    record_hardware,
)
from nico_selfmodel.cli.record_mirror import POSES, Mirrors, record_before_mirrors

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from nico_selfmodel.dataset import Dataset
    from nico_selfmodel.systems import Imperfections

SENSORS = ("motion-capture", "stereo-fiducial", "stereo-color", "chessboard")


def record(
    out: Annotated[Path, typer.Argument(help="Folder to make; a recording in it is resumed.")],
    sensor: Annotated[
        str, typer.Option("--sensor", help=f"Who watches what: {', '.join(SENSORS)}.")
    ] = "stereo-fiducial",
    world: Annotated[
        str, typer.Option("--world", help="Imperfections of the body: thesis or clean.")
    ] = "thesis",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Which individual.")] = 0,
    session: Annotated[
        int, typer.Option("--session", min=0, help="Which recording of it: poses and noise.")
    ] = 0,
    circle: Annotated[
        int | None,
        typer.Option(
            "--circle", min=0, help="Poses on the joints' circles in all; 60, with --mirror none."
        ),
    ] = None,
    random_poses: Annotated[
        int | None,
        typer.Option(
            "--random",
            min=0,
            help=f"Random poses; 100, with --mirror {POSES} in each mirror and {POSES} without.",
        ),
    ] = None,
    poses: Annotated[
        Path | None,
        typer.Option("--poses", help="CSV of `choose-poses`: visited instead of random ones."),
    ] = None,
    mirror: Mirrors = None,
    boards: Annotated[
        int, typer.Option("--boards", min=1, help="Pairs of pictures of the chessboard.")
    ] = 16,
    eyes: Annotated[
        Path | None,
        typer.Option("--eyes", help="Result of `calibrate stereo`: fiducials behind its lenses."),
    ] = None,
    images: Annotated[bool, typer.Option("--images", help="Keep the pictures too.")] = False,
    port: Annotated[
        str | None,
        typer.Option("--port", help="Serial port of a real robot.", rich_help_panel=REAL),
    ] = None,
    config: Config = None,
    baud: Baud = None,
    left_camera: LeftCamera = None,
    right_camera: RightCamera = None,
    motion_capture: MotionCapture = None,
    speed: Speed = None,
    trust_zero: TrustZero = False,
    yes: Yes = False,
) -> None:
    """Move a simulated Nico, or a real one, and record what is seen.

    An interrupted recording goes on.
    """
    from nico_selfmodel.files import refuse_existing
    from nico_selfmodel.systems import imperfections_named

    refuse_existing(out, force=True)  # what is there is gone on with, or refused by name
    name_after(out)
    if sensor not in SENSORS:
        raise ValueError(f"no sensor {sensor!r}; there are {', '.join(SENSORS)}")
    _check_poses(poses, random_poses, sensor, bool(mirror))
    circle = (0 if mirror or poses else 60) if circle is None else circle
    random_poses = (POSES if mirror else 100) if random_poses is None else random_poses
    _check(sensor, circle, random_poses, eyes, images)
    hardware = Hardware(
        *(port, config, baud, left_camera, right_camera, motion_capture, speed, trust_zero, yes)
    )
    if mirror:
        _check_mirror(sensor, circle, random_poses, hardware.is_meant(world, sensor))
        chosen = imperfections_named(world)
        data = record_before_mirrors(
            *(out, sensor, chosen, seed, session, mirror, random_poses, eyes, images)
        )
        console.out.print(f"{len(data)} rows, {len(data.joints)} joints: {out}", markup=False)
        return
    if hardware.is_meant(world, sensor):
        data = record_hardware(
            *(out, sensor, hardware, seed, session, circle, random_poses, eyes, images, poses)
        )
        console.out.print(f"{len(data)} rows, {len(data.joints)} joints: {out}", markup=False)
        return
    chosen = imperfections_named(world)
    if sensor == "chessboard":
        _boards(out, chosen, seed, session, boards)
        return
    data = (
        _motion_capture(out, chosen, seed, session, circle, random_poses, poses)
        if sensor == "motion-capture"
        else _by_sight(
            out, sensor, chosen, seed, session, circle, random_poses, eyes, images, poses
        )
    )
    console.out.print(f"{len(data)} rows, {len(data.joints)} joints: {out}", markup=False)


def _check(sensor: str, circle: int, free: int, eyes: Path | None, images: bool) -> None:
    """Refuse options that would be ignored, and a recording of nothing."""
    if not sensor.startswith("stereo-") and (eyes is not None or images):
        raise ValueError("--eyes and --images need --sensor stereo-fiducial or stereo-color")
    if sensor != "chessboard" and circle == 0 and free == 0:
        raise ValueError("nothing to record: give --circle or --random")


def _check_poses(poses: Path | None, free: int | None, sensor: str, mirror: bool) -> None:
    """Refuse chosen poses where they would not be visited, or beside random ones."""
    if poses is None:
        return
    if sensor == "chessboard" or mirror:
        raise ValueError("--poses moves the arm before motion capture or eyes, without a mirror")
    if free is not None:
        raise ValueError("--poses are visited instead of random ones: leave out --random")


def _chosen(poses: Path | None, joints: tuple[str, ...]) -> "NDArray | None":
    """Read the poses of a file."""
    from nico_selfmodel.files.reading import LARGEST_TABLE, read_text
    from nico_selfmodel.model.readings import readings_from_table

    if poses is None:
        return None
    return readings_from_table(read_text(poses, LARGEST_TABLE), joints, str(poses))


def _check_mirror(sensor: str, circle: int, free: int, real: bool) -> None:
    """Refuse what cannot be done before a mirror."""
    if real:
        raise ValueError("--mirror is for the simulated robot: a real one needs a real mirror")
    if not sensor.startswith("stereo-"):
        raise ValueError("--mirror needs --sensor stereo-fiducial or stereo-color")
    if circle or not free:
        raise ValueError("--mirror records random poses: leave out --circle, give --random")


def _by_sight(
    out: Path,
    sensor: str,
    world: "Imperfections",
    seed: int,
    session: int,
    circle: int,
    free: int,
    eyes: Path | None,
    images: bool,
    poses: Path | None,
) -> "Dataset":
    from nico_selfmodel.experiments.eyes_lesson import MARKERS, RenderedNico
    from nico_selfmodel.model import SelfModel

    rig = None if eyes is None else SelfModel.load(eyes).rig
    nico = RenderedNico(world, seed, (MARKERS[sensor],))
    with console.progress_bar() as stage:
        return nico.record(
            name_after(out),
            session,
            circle,
            free,
            rig=rig,
            folder=out,
            keep_images=images,
            poses=_chosen(poses, nico.arm.joints),
            progress=lambda done, total: stage("moving and looking", done, total),
        )


def _motion_capture(
    out: Path,
    world: "Imperfections",
    seed: int,
    session: int,
    circle: int,
    free: int,
    poses: Path | None,
) -> "Dataset":
    from nico_selfmodel.experiments.protocol import simulated_session
    from nico_selfmodel.planning.sweep_protocol import Protocol
    from nico_selfmodel.plant import ArmDescription

    arm = ArmDescription.named("nico")
    each = max(1, round(circle / len(arm.joints))) + 1
    protocol = replace(Protocol.for_arm(arm), random_poses=free, circle_points=each)
    with console.progress_bar() as stage:
        return simulated_session(
            arm,
            world,
            protocol,
            name_after(out),
            seed=seed,
            session=session,
            sweeps=circle > 0,
            folder=out,
            poses=_chosen(poses, arm.joints),
            progress=lambda done, total: stage("moving", done, total),
        )


def _boards(out: Path, world: "Imperfections", seed: int, session: int, count: int) -> None:
    from nico_selfmodel.experiments.eyes_lesson import RenderedNico
    from nico_selfmodel.files import folder_written_whole

    with folder_written_whole(out) as folder, console.progress_bar() as stage:
        nico = RenderedNico(world, seed, ("fiducial",))
        nico.board_views(
            count,
            session,
            folder=folder,
            progress=lambda done, total: stage("looking at a chessboard", done, total),
        )
    console.out.print(
        f"{count} pairs: {out}\n"
        f"next  nico-selfmodel calibrate stereo {out} --board 9x6 --square-mm 28 --window 5 "
        "--out eyes",
        markup=False,
    )

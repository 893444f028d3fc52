"""`nico-selfmodel record`: watch a robot move, by motion capture or by its own cameras."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import inputs, options, printer
from nico_selfmodel.cli.record.hardware import Hardware, record_hardware
from nico_selfmodel.cli.record.request import POSES, SENSORS, Request
from nico_selfmodel.cli.record.whole_body import WholeRequest, record_body, record_real_body

_SOURCE = "Real camera: N of /dev/videoN, a video, or a folder of images."


def record(
    out: options.Out,
    sensor: Annotated[
        str, typer.Option("--sensor", help=f"Who watches what: {', '.join(SENSORS)}.")
    ] = "stereo-fiducial",
    imperfections: options.Imperfections = "thesis",
    seed: options.RobotSeed = 0,
    session: options.Session = 0,
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
    mirror: Annotated[
        list[str] | None,
        typer.Option(
            "--mirror",
            metavar=options.MIRROR,
            help="Record the hand in a mirror too: its distance from the left camera, and how far "
            "it is turned to the image's right and upwards; 300,0,-20 if left out. Repeat for more "
            "mirrors.",
        ),
    ] = None,
    glass: Annotated[
        str | None,
        typer.Option(
            "--glass-size",
            metavar="WIDTH,HEIGHT",
            help="Size of the mirrors [mm]; 400,300 if left out.",
        ),
    ] = None,
    board_views: Annotated[
        int, typer.Option("--board-views", min=1, help="Pairs of pictures of the chessboard.")
    ] = 16,
    head: Annotated[
        bool,
        typer.Option(
            "--head",
            help="Let the head turn: cards in the room are looked at, and --random times each hand "
            "of --arms; needs --cameras.",
        ),
    ] = False,
    arms: options.Arms = None,
    room: Annotated[
        Path | None,
        typer.Option("--room", help="Where cards of markers hang (nico-cards/1), with --head."),
    ] = None,
    cameras: options.Cameras = None,
    images: Annotated[bool, typer.Option("--images", help="Keep the pictures too.")] = False,
    port: options.PortOrNone = None,
    config: options.ConfigOrNone = None,
    baud: options.BaudOrNone = None,
    left_camera: Annotated[str | None, typer.Option("--left-camera", help=_SOURCE)] = None,
    right_camera: Annotated[str | None, typer.Option("--right-camera", help=_SOURCE)] = None,
    motion_capture: Annotated[
        str | None,
        typer.Option(
            "--motion-capture", metavar="HOST:PORT", help="Where real motion capture sends frames."
        ),
    ] = None,
    robot: options.Robot = None,
    arm: options.Arm = None,
    base: options.Base = None,
    tip: options.Tip = None,
    hold: options.Hold = None,
    speed: options.Speed = None,
    trust_zero: options.TrustZero = False,
    yes: options.Yes = False,
) -> None:
    """Move a simulated Nico, or a real robot (--port), and record what is seen.

    Motion capture watches any arm (--robot, of a URDF with --base and --tip), cameras Nico's.
    An interrupted recording goes on. With --head, or --cameras a body (body.yaml), a whole Nico
    is recorded that looks about a room and, --random times, at each of its hands; with --mirror at
    its hands in each mirror.
    """
    from nico_selfmodel.files.whole import refuse_existing
    from nico_selfmodel.systems.simulated.imperfections import imperfections_named

    refuse_existing(out, force=True)  # what is there is gone on with, or refused by name
    inputs.name_after(out)
    request = Request.of(
        *(out, sensor, seed, session, circle, random_poses, poses, mirror, cameras, images),
        glass=glass,
    )
    hardware = Hardware(
        *(port, config, baud, left_camera, right_camera, motion_capture, speed, trust_zero, yes),
        *(robot, arm, base, tip, tuple(hold or ())),
    )
    real = hardware.is_meant(imperfections, sensor)
    request.check_mirrors(real=real)
    whole = WholeRequest.of(request, circle, head=head, arms=arms, room=room, real=real)
    if whole is not None and real:
        record_real_body(whole, hardware)
        return
    if real:
        printer.dataset(record_hardware(request, hardware), out)
        return
    # The renderer is slow to load.
    from nico_selfmodel.cli.record import simulated

    chosen = imperfections_named(imperfections)
    if whole is not None:
        record_body(whole, chosen)
    elif sensor == "chessboard":
        simulated.record_boards(request, chosen, board_views)
    else:
        printer.dataset(simulated.record_hand(request, chosen), out)

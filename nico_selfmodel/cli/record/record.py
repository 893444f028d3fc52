"""`nico-selfmodel record`: watch a robot move, by motion capture or by its own cameras."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import inputs, options, printer
from nico_selfmodel.cli.record.hardware import Hardware, record_hardware
from nico_selfmodel.cli.record.request import Request
from nico_selfmodel.cli.record.whole_body import WholeRequest, record_body, record_real_body


def record(
    request: Request,
    hardware: Hardware,
    imperfections: options.Imperfections = "thesis",
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
) -> None:
    """Record a simulated Nico, or a real robot (--port).

    Motion capture watches any arm (--robot, of a URDF with --base and --tip), cameras Nico's. An
    interrupted recording goes on. With --head, or --cameras a body (body.yaml), a whole Nico is
    recorded that looks about a room and, --random times, at each of its hands; with --mirror at its
    hands in each mirror.
    """
    from nico_selfmodel.files.whole import refuse_existing
    from nico_selfmodel.systems.simulated.imperfections import imperfections_named

    refuse_existing(request.out, force=True)  # what is there is gone on with, or refused by name
    inputs.name_after(request.out)
    request.check()
    real = hardware.is_meant(imperfections, request.sensor)
    request.check_mirrors(real=real)
    whole = WholeRequest.of(request, head=head, arms=arms, room=room, real=real)
    if whole is not None and real:
        record_real_body(whole, hardware)
        return
    if real:
        printer.dataset(record_hardware(request, hardware), request.out)
        return
    # The renderer is slow to load.
    from nico_selfmodel.cli.record import simulated

    chosen = imperfections_named(imperfections)
    if whole is not None:
        record_body(whole, chosen)
    elif request.sensor == "chessboard":
        simulated.record_boards(request, chosen, board_views)
    else:
        printer.dataset(simulated.record_hand(request, chosen), request.out)

"""`nico-selfmodel servo scan`: which motors are on a bus."""

from dataclasses import asdict
from typing import Annotated

import typer

from nico_selfmodel.cli import options, printer


def scan(
    port: options.Port,
    make: options.Make = "pic-servo",
    baud: options.BaudOrNone = None,
    up_to: Annotated[
        int, typer.Option("--up-to", min=1, max=253, help="Highest address to look at.")
    ] = 32,
    as_json: options.AsJson = False,
) -> None:
    """Find the motors of a bus; PIC-SERVO boards get addresses. Moves and resets nothing."""
    from nico_selfmodel.errors import BusError
    from nico_selfmodel.servos.drivers import scan_port
    from nico_selfmodel.servos.makes import make_named

    kind = make_named(make)
    found = scan_port(kind, port, baud, min(up_to, kind.addresses[1]))
    if not found.motors:
        at = f"{found.baud} baud" if baud is not None or not kind.keeps_zero else "any rate"
        more = "" if at == "any rate" else " Another rate may be set: try --baud"
        raise BusError(
            f"no {kind.unit if kind.unit == 'module' else 'servo'} answers on {port} at {at}: are "
            f"the {kind.title} switched on?{more}"
        )
    modules = [asdict(motor) for motor in found.motors]
    if as_json:
        link = found.link.to_mapping()
        printer.as_json({"port": port, "baud": found.baud, "modules": modules, "link": link})
        return
    rows = [[_word(value) for value in module.values()] for module in modules]
    headings = ("address", "device", "counts", "servo on", "homed", "new")
    printer.table(f"{port} at {found.baud} baud", headings, rows)


def _word(value: object) -> str:
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)

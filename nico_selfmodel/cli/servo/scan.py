"""`nico-selfmodel servo scan`: which boards are on a bus."""

from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import options, printer

if TYPE_CHECKING:
    from nico_selfmodel.servos.pic_servo.line.chain import FoundModule


def scan(
    port: options.Port,
    baud: options.Baud = 19200,
    up_to: Annotated[
        int, typer.Option("--up-to", min=1, max=127, help="Highest address to look at.")
    ] = 32,
    as_json: options.AsJson = False,
) -> None:
    """Find the modules of a bus and give addresses to new ones. Moves and resets nothing."""
    from nico_selfmodel.errors import BusError
    from nico_selfmodel.servos.pic_servo.line.bus import Bus
    from nico_selfmodel.servos.pic_servo.line.chain import scan
    from nico_selfmodel.servos.pic_servo.protocol.commands import BAUD_CODES

    if baud not in BAUD_CODES:
        raise ValueError(f"--baud must be one of {sorted(BAUD_CODES)}, got {baud}")
    with Bus.open(port, baud) as bus:
        found = scan(bus, range(1, up_to + 1))
        counts = bus.total().to_mapping()
    if not found:
        raise BusError(
            f"no module answers on {port} at {baud} baud: are the boards switched on? "
            "Another rate may be set: try --baud"
        )
    if as_json:
        modules = [_module(module) for module in found]
        printer.as_json({"port": port, "baud": baud, "modules": modules, "link": counts})
        return
    rows = [[_word(value) for value in _module(module).values()] for module in found]
    headings = ("address", "device", "counts", "servo on", "homed", "new")
    printer.table(f"{port} at {baud} baud", headings, rows)


def _word(value: object) -> str:
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)


def _module(module: "FoundModule") -> dict[str, object]:
    return {
        "address": module.address,
        "device": str(module.device),
        "position_counts": module.status.position,
        "servo_on": module.servo_on,
        "zero_known": module.zero_known,
        "new_address": module.newly_addressed,
    }

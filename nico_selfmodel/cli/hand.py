"""`nico-selfmodel hand`: open and close the hand."""

from dataclasses import dataclass
from typing import Annotated

import typer

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.option_groups import OptionGroup
from nico_selfmodel.cli.servo.opening import ask


@dataclass(frozen=True)
class Motion(OptionGroup):
    """How the motors run."""

    port: options.Port
    finger: Annotated[
        list[str] | None,
        typer.Option("--finger", metavar="NAME", help="index or fingers; both if omitted."),
    ] = None
    seconds: Annotated[float, typer.Option("--seconds", help="How long to run the motors [s].")] = (
        1.0
    )
    power: Annotated[float, typer.Option("--power", help="Share of full power, 0 to 1.")] = 0.7
    current_limit: Annotated[
        int,
        typer.Option("--current-limit", help="Where to cut off, 0 to 1023 (converter reading)."),
    ] = 500
    yes: options.Yes = False
    as_json: options.AsJson = False


def open_hand(motion: Motion) -> None:
    """Open the hand.

    Runs the motors for a time, or until the current is cut off.
    """
    _move("open", motion)


def close_hand(motion: Motion) -> None:
    """Close the hand.

    Runs the motors for a time, or until the current is cut off.
    """
    _move("close", motion)


def _move(way: str, motion: Motion) -> None:
    from nico_selfmodel.servos.hand import FINGERS, Hand, check_motion

    fingers = tuple(motion.finger or FINGERS)
    how = {"seconds": motion.seconds, "power": motion.power, "current_limit": motion.current_limit}
    check_motion(way, fingers, *how.values())
    with Hand.open_port(motion.port) as hand:
        what = " and ".join(fingers)
        if not motion.as_json:
            printer.line(
                f"{what}: {way} for at most {motion.seconds:g} s at {100 * motion.power:g} %, "
                f"current limit {motion.current_limit}"
            )
        ask(f"{way.capitalize()} {what}?", yes=motion.yes)
        causes = hand.move(way, fingers, **how)
    if motion.as_json:
        printer.as_json({"stopped_by": causes})
        return
    for name, cause in causes.items():
        printer.line(f"{name}: stopped by {cause}")

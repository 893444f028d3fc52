"""`nico-selfmodel hand`: open and close the hand."""

from typing import Annotated

import typer

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.servo.opening import ask

Finger = Annotated[
    list[str] | None,
    typer.Option("--finger", metavar="NAME", help="index or fingers; both if omitted."),
]
Seconds = Annotated[float, typer.Option("--seconds", help="How long to run the motors.")]
Power = Annotated[float, typer.Option("--power", help="Share of full power, 0 to 1.")]
CurrentLimit = Annotated[
    int, typer.Option("--current-limit", help="Where to cut off, 0 to 1023 (converter reading).")
]


def open_hand(
    port: options.Port,
    finger: Finger = None,
    seconds: Seconds = 1.0,
    power: Power = 0.7,
    current_limit: CurrentLimit = 500,
    yes: options.Yes = False,
    as_json: options.AsJson = False,
) -> None:
    """Open the hand.

    Runs the motors for a time, or until the current is cut off.
    """
    _move("open", port, finger, seconds, power, current_limit, yes=yes, as_json=as_json)


def close_hand(
    port: options.Port,
    finger: Finger = None,
    seconds: Seconds = 1.0,
    power: Power = 0.7,
    current_limit: CurrentLimit = 500,
    yes: options.Yes = False,
    as_json: options.AsJson = False,
) -> None:
    """Close the hand.

    Runs the motors for a time, or until the current is cut off.
    """
    _move("close", port, finger, seconds, power, current_limit, yes=yes, as_json=as_json)


def _move(
    way: str,
    port: str,
    finger: list[str] | None,
    seconds: float,
    power: float,
    current_limit: int,
    *,
    yes: bool,
    as_json: bool,
) -> None:
    from nico_selfmodel.servos.hand import FINGERS, Hand, check_motion

    fingers = tuple(finger or FINGERS)
    check_motion(way, fingers, seconds, power, current_limit)
    with Hand.open_port(port) as hand:
        what = " and ".join(fingers)
        if not as_json:
            printer.line(
                f"{what}: {way} for at most {seconds:g} s at {100 * power:g} %, current limit "
                f"{current_limit}"
            )
        ask(f"{way.capitalize()} {what}?", yes=yes)
        causes = hand.move(way, fingers, seconds=seconds, power=power, current_limit=current_limit)
    if as_json:
        printer.as_json({"stopped_by": causes})
        return
    for name, cause in causes.items():
        printer.line(f"{name}: stopped by {cause}")

"""`nico-selfmodel servo stop`: stop the arm, or let go of it."""

from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.servo.opening import ask, opened

if TYPE_CHECKING:
    from nico_selfmodel.servos import ArmController


def stop(
    port: options.Port,
    config: options.Config,
    release: Annotated[
        bool, typer.Option("--release", help="Switch the motors off: the arm falls.")
    ] = False,
    yes: options.Yes = False,
) -> None:
    """Stop every joint; the joints that were on go on holding."""
    from nico_selfmodel.errors import RobotError
    from nico_selfmodel.servos.arm.shutdown import stop_unseen

    if release:
        ask("Switch the motors off? What gravity pulls falls.", yes=yes)
    with opened(port, config) as arm:
        stop_unseen(arm.bus, arm.axes, release=release)
        try:
            arm.connect()
        except RobotError as error:
            raise type(error)(f"{error}. {_stop_the_rest(arm, release)}") from error
        arm.stop()
        if release:
            arm.release()
        _require_standstill(arm)
        state = arm.cycle()
    held = [name for name, on in zip(state.joints, state.enabled, strict=True) if on]
    printer.line(f"stopped; holding: {', '.join(held) or 'none'}")


def _require_standstill(arm: "ArmController") -> None:
    from nico_selfmodel.errors import ServoFault
    from nico_selfmodel.servos.arm.shutdown import still_moving

    if going := still_moving(arm.bus, arm.axes):
        raise ServoFault(
            f"told to stop, but still moving: {', '.join(going)}. A joint that is off may fall or "
            "be pushed; else use the emergency stop"
        )


def _stop_the_rest(arm: "ArmController", release: bool) -> str:
    """Stop or release the joints that answer though others do not; return what came of it."""
    from nico_selfmodel.servos.arm.shutdown import stop_what_answers

    done, _ = stop_what_answers(arm.axes, release=release)
    what = "switched off" if release else "stopped"
    if not done:
        return f"None confirmed that it was {what}: all were told, use the emergency stop"
    return f"{what.capitalize()} all the same: {', '.join(done)}"

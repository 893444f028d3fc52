"""`nico-selfmodel servo home`: find the zeros that were lost at power-off."""

import math
from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.servo.opening import ask, opened, stopping

if TYPE_CHECKING:
    from nico_selfmodel.servos import ArmController


def home(
    port: options.Port,
    config: options.Config,
    joints: Annotated[list[str] | None, typer.Argument(help="Which; all if omitted.")] = None,
    here: Annotated[
        bool, typer.Option("--here", help="The joints stand at their homes now; nothing moves.")
    ] = False,
    yes: options.Yes = False,
) -> None:
    """Find the zeros that were lost at power-off."""
    from nico_selfmodel.servos.arm.zeroing import zero_here
    from nico_selfmodel.servos.pic_servo.homing import find_home

    with opened(port, config) as arm:
        arm.connect()
        names = tuple(joints or arm.joints)
        for name in names:
            arm.axis(name)  # a name that does not exist is told before anything is homed
        for name in names:
            plan = arm.axis(name).joint.home
            place = f"{math.degrees(plan.at):g} deg"
            if here or plan.method == "here":
                ask(f"Does {name} stand at its home, {place}?", yes=yes)
                zero_here(arm, name)
                _tell_offset(arm, name)
            else:
                speed, travel = math.degrees(plan.speed), math.degrees(plan.travel)
                printer.line(
                    f"{name}: looks for {plan.method} at {speed:g} deg/s for at most {travel:g} "
                    "deg, without regard to its limits"
                )
                ask(f"Move {name} at {speed:g} deg/s until {plan.method} ({place})?", yes=yes)
                arm.enable([name])
                stopping(arm, lambda name=name: find_home(arm, name))
            printer.line(f"{name} is homed")


def _tell_offset(arm: "ArmController", joint: str) -> None:
    """Say what the configuration must be told, where it names the offset that was just changed."""
    axis = arm.axis(joint)
    if axis.joint.homing_offset is not None and not axis.motor.knows_its_zero():
        printer.line(
            f"{joint}: its servo's homing offset is another one now; take 'homing_offset' of this "
            "joint out of the servo configuration, or correct it"
        )

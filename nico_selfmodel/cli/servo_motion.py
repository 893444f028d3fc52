"""`nico-selfmodel servo move` and `home`: the commands that move an arm."""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import console
from nico_selfmodel.cli.servo_options import (
    Config,
    Json,
    Model,
    Port,
    TrustZero,
    Yes,
    ask,
    opened,
    speed_of,
)

if TYPE_CHECKING:
    from nico_selfmodel.servos import ArmController, ArmState


def move(
    joint: Annotated[str, typer.Argument(help="Which joint.")],
    angle: Annotated[float, typer.Argument(help="Where to [deg].")],
    port: Port,
    config: Config,
    model: Model = None,
    speed: Annotated[
        float | None, typer.Option("--speed-deg-s", help="Largest speed; its limit if omitted.")
    ] = None,
    trust_zero: TrustZero = False,
    yes: Yes = False,
    as_json: Json = False,
) -> None:
    """Move one joint to an angle in degrees and hold it there; Ctrl-C stops it."""
    with opened(port, config, model, trust_zero=trust_zero) as arm:
        arm.connect()
        arm.check_targets({joint: math.radians(angle)})
        arm.check_zero([joint])
        k = arm.joints.index(joint)
        rate = speed_of(speed, float(arm.limits.speeds[k]))
        if not as_json:
            _print_limits(arm, k)
        ask(f"Move {joint} to {angle:g} deg?", yes=yes)
        arm.enable([joint])
        arm.move({joint: math.radians(angle)}, speed=rate)
        state = _until_there(arm)
    if as_json:
        console.print_json(state.to_mapping()["joints"][joint])
    else:
        console.out.print(f"{joint} at {math.degrees(state.q[k]):.2f} deg", markup=False)


def home(
    port: Port,
    config: Config,
    joints: Annotated[list[str] | None, typer.Argument(help="Which; all if omitted.")] = None,
    here: Annotated[
        bool, typer.Option("--here", help="The joints stand at their homes now; nothing moves.")
    ] = False,
    yes: Yes = False,
) -> None:
    """Find the zeros that were lost at power-off."""
    from nico_selfmodel.servos import find_home, zero_here

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
            else:
                speed, travel = math.degrees(plan.speed), math.degrees(plan.travel)
                console.out.print(
                    f"{name}: looks for {plan.method} at {speed:g} deg/s for at most {travel:g} "
                    "deg, without regard to its limits",
                    markup=False,
                )
                ask(f"Move {name} at {speed:g} deg/s until {plan.method} ({place})?", yes=yes)
                arm.enable([name])
                _stopping(arm, lambda name=name: find_home(arm, name))
            console.out.print(f"{name} is homed", markup=False)


def print_state(state: "ArmState") -> None:
    """Print a table of the joints."""
    rows = []
    for k, name in enumerate(state.joints):
        known = math.isfinite(state.q[k])
        rows.append(
            [
                name,
                f"{math.degrees(state.q[k]):.2f}" if known else "not homed",
                f"{state.readings[k]:.0f}",
                "on" if state.enabled[k] else "off",
                "moving" if state.moving[k] else "-",
                state.trouble[k] or "-",
            ]
        )
    console.print_table("servos", ("joint", "deg", "counts", "servo", "motion", "trouble"), rows)


def _print_limits(arm: "ArmController", k: int) -> None:
    low, high = (math.degrees(angle) for angle in arm.limits.positions[k])
    now = math.degrees(arm.state().q[k])
    at = f"at {now:.2f} deg, " if math.isfinite(now) else ""
    speed = math.degrees(arm.limits.speeds[k])
    console.out.print(
        f"{arm.joints[k]}: {at}limits {low:.1f} to {high:.1f} deg, {speed:.0f} deg/s",
        markup=False,
    )


def _until_there(arm: "ArmController") -> "ArmState":
    state = arm.state()

    def go() -> None:
        nonlocal state
        while True:
            arm.heartbeat()
            state = arm.cycle()
            if not arm.moving:
                return

    _stopping(arm, go)
    return state


def _stopping(arm: "ArmController", go: Callable[[], object]) -> None:
    """Do something that moves; on Ctrl-C stop the arm before anything else."""
    try:
        go()
    except KeyboardInterrupt:
        arm.stop()
        typer.echo("stopped; the arm holds", err=True)
        raise

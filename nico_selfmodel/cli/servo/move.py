"""`nico-selfmodel servo move`: move one joint."""

import math
from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.servo.opening import ask, opened, speed_of, stopping

if TYPE_CHECKING:
    from nico_selfmodel.servos import ArmController
    from nico_selfmodel.servos.arm_state import ArmState


def move(
    joint: Annotated[str, typer.Argument(help="Which joint.")],
    angle: Annotated[float, typer.Argument(help="Where to [deg].")],
    port: options.Port,
    config: options.Config,
    model: options.ModelOrNominal = None,
    speed: options.Speed = None,
    trust_zero: options.TrustZero = False,
    yes: options.Yes = False,
    as_json: options.AsJson = False,
) -> None:
    """Move one joint to an angle and hold it there; Ctrl-C stops it."""
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
        printer.as_json(state.to_mapping()["joints"][joint])
    else:
        printer.line(f"{joint} at {math.degrees(state.q[k]):.2f} deg")


def _print_limits(arm: "ArmController", k: int) -> None:
    low, high = (math.degrees(angle) for angle in arm.limits.positions[k])
    now = math.degrees(arm.state().q[k])
    at = f"at {now:.2f} deg, " if math.isfinite(now) else ""
    speed = math.degrees(arm.limits.speeds[k])
    printer.line(f"{arm.joints[k]}: {at}limits {low:.1f} to {high:.1f} deg, {speed:.0f} deg/s")


def _until_there(arm: "ArmController") -> "ArmState":
    state = arm.state()

    def go() -> None:
        nonlocal state
        while True:
            arm.heartbeat()
            state = arm.cycle()
            if not arm.moving:
                return

    stopping(arm, go)
    return state

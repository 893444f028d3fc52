"""An arm of real servos as options name it, its state, and the question before it moves."""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from nico_selfmodel.cli import printer
from nico_selfmodel.cli.interruption import undisturbed

if TYPE_CHECKING:
    from nico_selfmodel.servos import ArmController
    from nico_selfmodel.servos.arm_state import ArmState


def opened(
    port: str, config: Path, model: Path | None = None, *, trust_zero: bool = False
) -> "ArmController":
    """Open the arm that the options name; sends nothing.

    Raises:
        DataError: If the configuration is not valid.
        ModelError: If the self-model is not valid.
        ValueError: If the two are about different joints.
        BusError: If the port cannot be opened.
    """
    from nico_selfmodel.model.self_model_file import load_model
    from nico_selfmodel.servos import ArmController
    from nico_selfmodel.servos.arm.servo_config_file import load_servo_config

    servos = None if model is None else load_model(model).servos
    return ArmController.open(port, load_servo_config(config), servos, trust_zero=trust_zero)


def speed_of(speed_deg_s: float | None, largest: float) -> float | None:
    """Return a speed that an option gives [rad/s], None if it was not given.

    Args:
        speed_deg_s: What was given [deg/s].
        largest: The limit [rad/s].

    Raises:
        ValueError: If it is not positive or beyond the limit.
    """
    if speed_deg_s is None:
        return None
    # A limit that was read off a table must be accepted.
    if not 0.0 < speed_deg_s <= math.degrees(largest) * (1.0 + 1e-9):
        raise ValueError(
            f"--speed-deg-s must be above 0, at most {math.degrees(largest):g} (the limit of the "
            f"servo configuration), got {speed_deg_s:g}"
        )
    return min(math.radians(speed_deg_s), largest)


def ask(question: str, *, yes: bool) -> None:
    """Ask before something moves; anything but yes ends the command.

    Raises:
        typer.Abort: If the answer is no, or there is nobody to answer.
    """
    if not yes:
        typer.confirm(f"{question} (--yes to go without asking)", abort=True, err=True)


def stopping(arm: "ArmController", go: Callable[[], object]) -> None:
    """Do something that moves; on Ctrl-C stop the arm before anything else, whatever comes then.

    Raises:
        KeyboardInterrupt: If it was stopped.
        BusError: If a joint did not confirm the stop.
    """
    try:
        go()
    except KeyboardInterrupt:
        with undisturbed():
            arm.stop()
            say("stopped; the arm holds")
        raise


def say(text: str) -> None:
    """Tell a person on stderr, whose terminal may be gone."""
    with suppress(OSError):
        typer.echo(text, err=True)


def tell_due(joints: Sequence[str]) -> None:
    """Say which zeros are not known."""
    if joints:
        printer.line(f"rezero is due: {', '.join(joints)} (servo home)")


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
    printer.table("servos", ("joint", "deg", "counts", "servo", "motion", "trouble"), rows)

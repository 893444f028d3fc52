"""The options that choose an arm of real servos, and the question before it moves."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from nico_selfmodel.servos import ArmController

Port = Annotated[
    str, typer.Option("--port", help="Serial port: /dev/serial/by-id/..., or of servo simulate.")
]
Config = Annotated[Path, typer.Option("--config", help="Servo configuration (nico-servos/1).")]
Model = Annotated[
    Path | None,
    typer.Option("--model", help="self_model.yaml or a result folder; nominal if omitted."),
]
Yes = Annotated[bool, typer.Option("--yes", help="Do not ask.")]
TrustZero = Annotated[
    bool, typer.Option("--trust-zero", help="Take the zero as it is though it was not homed.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]


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
    from nico_selfmodel.model import SelfModel
    from nico_selfmodel.servos import ArmController, ServoConfig

    servos = None if model is None else SelfModel.load(model).servos
    return ArmController.open(port, ServoConfig.load(config), servos, trust_zero=trust_zero)


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

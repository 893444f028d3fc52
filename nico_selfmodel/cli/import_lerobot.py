"""`nico-selfmodel import lerobot`: a servo configuration of a lerobot arm's calibration."""

import math
from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import inputs, options, printer


def from_lerobot(
    calibration: Annotated[Path, typer.Argument(help="The arm's calibration file (JSON).")],
    out: options.OutFile,
    make: options.Make = "feetech",
    speed: Annotated[
        float, typer.Option("--max-speed-deg-s", min=2.0, help="Largest speed of every joint.")
    ] = 60.0,
    force: options.Force = False,
) -> None:
    """Make a servo configuration of a lerobot arm's calibration."""
    from nico_selfmodel.files.whole import refuse_existing
    from nico_selfmodel.servos.arm.lerobot_calibration import import_lerobot
    from nico_selfmodel.servos.arm.servo_config_file import save_servo_config
    from nico_selfmodel.servos.makes import make_named

    refuse_existing(out, force=force, inputs=[calibration])
    name = inputs.name_after(out)
    config = import_lerobot(calibration, make_named(make), name, max_velocity=math.radians(speed))
    save_servo_config(config, out)
    rows = [
        [joint.name, str(joint.address), f"{math.degrees(joint.lower):.1f} to "
         f"{math.degrees(joint.upper):.1f}", str(joint.homing_offset)]
        for joint in config.joints
    ]  # fmt: skip
    printer.table(str(out), ("joint", "id", "limits (deg)", "homing offset"), rows)

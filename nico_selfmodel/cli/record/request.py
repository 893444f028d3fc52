"""What `nico-selfmodel record` is asked to record."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import options
from nico_selfmodel.cli.option_groups import OptionGroup
from nico_selfmodel.names import refuse_unknown

SENSORS = ("motion-capture", "stereo-fiducial", "stereo-color", "chessboard")
MIRROR_POSES = 20
"""Poses in each mirror, and without one, unless told otherwise."""
_CIRCLE, _RANDOM = 60, 100
"""Poses on the joints' circles in all, and random ones, where nothing else is asked."""


@dataclass(frozen=True)
class Request(OptionGroup):
    """What is recorded of which robot."""

    out: options.Out
    sensor: Annotated[
        str, typer.Option("--sensor", help=f"Who watches what: {', '.join(SENSORS)}.")
    ] = "stereo-fiducial"
    seed: options.RobotSeed = 0
    session: options.Session = 0
    asked_circle: Annotated[
        int | None,
        typer.Option(
            "--circle", min=0, help="Poses on the joints' circles in all; 60, with --mirror none."
        ),
    ] = None
    asked_random: Annotated[
        int | None,
        typer.Option(
            "--random",
            min=0,
            help=f"Random poses; 100, with --mirror {MIRROR_POSES} in each mirror and "
            f"{MIRROR_POSES} without.",
        ),
    ] = None
    poses: Annotated[
        Path | None,
        typer.Option("--poses", help="CSV of `choose-poses`: visited instead of random ones."),
    ] = None
    mirrors: Annotated[
        list[str] | None,
        typer.Option(
            "--mirror",
            metavar=options.MIRROR,
            help="Record the hand in a mirror too: its distance from the left camera, and how far "
            "it is turned to the image's right and upwards; 300,0,-20 if left out. Repeat for more "
            "mirrors.",
        ),
    ] = None
    glass: Annotated[
        str | None,
        typer.Option(
            "--glass-size",
            metavar="WIDTH,HEIGHT",
            help="Size of the mirrors [mm]; 400,300 if left out.",
        ),
    ] = None
    cameras: options.Cameras = None
    images: Annotated[bool, typer.Option("--images", help="Keep the pictures too.")] = False

    @property
    def circle(self) -> int:
        """Poses on the joints' circles in all."""
        if self.asked_circle is not None:
            return self.asked_circle
        return 0 if self.mirrors or self.poses else _CIRCLE

    @property
    def random(self) -> int:
        """Random poses; in each mirror and without one, where there are mirrors."""
        if self.asked_random is not None:
            return self.asked_random
        return MIRROR_POSES if self.mirrors else _RANDOM

    def check(self) -> None:
        """Refuse options that would be ignored.

        Raises:
            ValueError: If the sensor does not exist, or options do not go together.
        """
        sensor = self.sensor
        refuse_unknown("sensor", sensor, SENSORS)
        if self.poses is not None and (sensor == "chessboard" or self.mirrors):
            raise ValueError(
                "--poses moves the arm before motion capture or cameras, without a mirror"
            )
        if self.poses is not None and self.asked_random is not None:
            raise ValueError("--poses are visited instead of random ones: leave out --random")
        if not sensor.startswith("stereo-") and (self.cameras is not None or self.images):
            raise ValueError("--cameras and --images need --sensor stereo-fiducial or stereo-color")
        if sensor != "chessboard" and self.circle == 0 and self.random == 0:
            raise ValueError("nothing to record: give --circle or --random")

    def check_mirrors(self, *, real: bool) -> None:
        """Refuse what cannot be done before a mirror.

        Raises:
            ValueError: If there are mirrors and something else does not suit them.
        """
        if not self.mirrors:
            if self.glass is not None:
                raise ValueError("--glass-size is the size of a mirror: give --mirror too")
            return
        if real:
            raise ValueError("--mirror is for the simulated robot: a real one needs a real mirror")
        if not self.sensor.startswith("stereo-"):
            raise ValueError("--mirror needs --sensor stereo-fiducial or stereo-color")
        if self.circle or not self.random:
            raise ValueError("--mirror records random poses: leave out --circle, give --random")

"""What `nico-selfmodel record` is asked to record."""

from dataclasses import dataclass
from pathlib import Path

SENSORS = ("motion-capture", "stereo-fiducial", "stereo-color", "chessboard")
POSES = 20
"""Poses in each mirror, and without one, unless told otherwise."""


@dataclass(frozen=True)
class Request:
    """What is recorded of which robot."""

    out: Path
    """Folder to make; a recording in it is resumed."""
    sensor: str
    """One of `SENSORS`."""
    seed: int
    """Which robot instance."""
    session: int
    """Which recording of it."""
    circle: int
    """Poses on the joints' circles in all."""
    random: int
    """Random poses; in each mirror and without one, where there are mirrors."""
    poses: Path | None
    """Table of poses to visit instead of random ones."""
    mirrors: tuple[str, ...]
    """As on the command line."""
    cameras: Path | None
    """A self-model with calibrated cameras."""
    images: bool
    """Keep the pictures."""
    glass: str | None = None
    """Width and height of the mirrors' glass, as on the command line."""

    @classmethod
    def of(
        cls,
        out: Path,
        sensor: str,
        seed: int,
        session: int,
        circle: int | None,
        random: int | None,
        poses: Path | None,
        mirrors: list[str] | None,
        cameras: Path | None,
        images: bool,
        glass: str | None = None,
    ) -> "Request":
        """Return what options ask for, with numbers of poses that fit where none were given.

        Raises:
            ValueError: If the sensor does not exist, or options would be ignored.
        """
        if sensor not in SENSORS:
            raise ValueError(f"no sensor {sensor!r}; there are {', '.join(SENSORS)}")
        if poses is not None and (sensor == "chessboard" or mirrors):
            raise ValueError(
                "--poses moves the arm before motion capture or cameras, without a mirror"
            )
        if poses is not None and random is not None:
            raise ValueError("--poses are visited instead of random ones: leave out --random")
        circle = (0 if mirrors or poses else 60) if circle is None else circle
        random = (POSES if mirrors else 100) if random is None else random
        if not sensor.startswith("stereo-") and (cameras is not None or images):
            raise ValueError("--cameras and --images need --sensor stereo-fiducial or stereo-color")
        if sensor != "chessboard" and circle == 0 and random == 0:
            raise ValueError("nothing to record: give --circle or --random")
        named = tuple(mirrors or ())
        return cls(out, sensor, seed, session, circle, random, poses, named, cameras, images, glass)

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

"""Robots that can be asked for by name, and their named arms."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from nico_selfmodel.errors import ModelError
from nico_selfmodel.files.reading import real_path

_PACKAGE = Path(__file__).resolve().parents[1]
# In a wheel the descriptions lie inside the package, in a source checkout beside it.
_URDF_FOLDERS = (_PACKAGE / "urdf", _PACKAGE.parent / "urdf")


@dataclass(frozen=True)
class NamedArm:
    """A serial chain of a robot and the points tracked on it."""

    base_link: str
    """Link that the chain starts from."""
    tip_link: str
    """Link that the chain ends with."""
    held: Mapping[str, float] = field(default_factory=dict)
    """Joints that stand still, at their values [rad or m]."""
    points: Mapping[str, str] = field(default_factory=dict)
    """Marker -> link or frame whose origin is tracked."""


def _nico_arm(side: str) -> NamedArm:
    # The thesis' arm has four joints: the two in forearm and wrist stand still.
    held = {f"{side}_forearm_twist": 0.0, f"{side}_wrist": 0.0}
    return NamedArm("chest", f"{side}_hand", held, {"hand": f"{side}_wrist_marker"})


ROBOTS: Mapping[str, Mapping[str, NamedArm]] = MappingProxyType(
    {
        "nico": MappingProxyType(
            {
                "right_arm": _nico_arm("right"),
                "left_arm": _nico_arm("left"),
                "neck": NamedArm(
                    "chest",
                    "head",
                    {"eyes_tilt": 0.0, "left_eye_pan": 0.0},
                    {"camera": "left_wide_camera"},
                ),
            }
        )
    }
)
"""Robot name -> arm name -> arm. The first arm of a robot is its default."""


def find_robot(name_or_path: str | Path) -> Path:
    """Return the URDF of a named robot, or of a path.

    Args:
        name_or_path: A name in `ROBOTS`, or a URDF file.

    Returns:
        The file, as an absolute path.

    Raises:
        ModelError: If there is no such robot and no such file; the message lists the names.
    """
    if str(name_or_path) in ROBOTS:
        candidates = [folder / f"{name_or_path}.urdf" for folder in _URDF_FOLDERS]
    else:
        candidates = [Path(name_or_path).expanduser()]
    for path in candidates:
        if path.is_file():
            return real_path(path)
    if candidates[0].is_dir():
        raise ModelError(f"{candidates[0]} is a folder: give a URDF file in it")
    raise ModelError(
        f"{name_or_path} is neither a robot's name ({', '.join(ROBOTS)}) nor a URDF file"
    )


def named_arm(robot: str, arm: str | None = None) -> NamedArm:
    """Return an arm of a named robot.

    Args:
        robot: A name in `ROBOTS`.
        arm: A name among the robot's arms; its first one if omitted.

    Raises:
        ModelError: If there is no such robot or arm; the message lists those there are.
    """
    if robot not in ROBOTS:
        raise ModelError(f"no robot is named {robot!r}; there is {', '.join(ROBOTS)}")
    arms = ROBOTS[robot]
    chosen = next(iter(arms)) if arm is None else arm
    if chosen not in arms:
        raise ModelError(f"{robot} has no arm {chosen!r}; it has {', '.join(arms)}")
    return arms[chosen]

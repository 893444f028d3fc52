"""The options that choose a robot's chain, shared by several commands."""

from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.names import listed

if TYPE_CHECKING:
    from nico_selfmodel.plant import ArmDescription

Robot = Annotated[str | None, typer.Option("--robot", help="A robot's name (nico) or a URDF file.")]
Arm = Annotated[
    str | None,
    typer.Option("--arm", help="A named arm of the robot: right_arm, left_arm, neck."),
]
Base = Annotated[str | None, typer.Option("--base", help="Link where the chain starts.")]
Tip = Annotated[str | None, typer.Option("--tip", help="Link where the chain ends.")]
Hold = Annotated[
    list[str] | None,
    typer.Option("--hold", metavar="JOINT[=VALUE]", help="A joint of the chain that stands still."),
]
Point = Annotated[
    list[str] | None,
    typer.Option("--point", metavar="MARKER=LINK", help="Link or frame that a marker sits on."),
]


def chosen_arm(
    robot: str,
    arm: str | None,
    base: str | None,
    tip: str | None,
    hold: list[str] | None,
    point: list[str] | None,
) -> "ArmDescription":
    """Return the chain that the options name.

    Raises:
        ModelError: If it does not exist.
        ValueError: If options contradict each other or a value is no number.
    """
    from nico_selfmodel.plant import ROBOTS, ArmDescription

    if robot in ROBOTS and base is None and tip is None:
        if hold or point:
            raise ValueError("--hold and --point need --base and --tip")
        return ArmDescription.named(robot, arm)
    if arm is not None:
        raise ValueError("--arm names a chain of a named robot: leave out --base and --tip")
    points = dict(_pair(word, "--point") for word in point or [])
    return ArmDescription.from_urdf(robot, base, tip, _held(hold), points or None)


def check_points(point: list[str] | None, markers: tuple[str, ...]) -> None:
    """Refuse a `--point` for a marker that the data do not track.

    Raises:
        ValueError: If there is one; the message lists the markers of the data.
    """
    for word in point or []:
        marker = _pair(word, "--point")[0]
        if marker not in markers:
            raise ValueError(
                f"--point {word}: the data set tracks no {marker!r}; it tracks "
                f"{listed(markers, marker)}"
            )


def _held(words: list[str] | None) -> dict[str, float]:
    from nico_selfmodel.files.csv_rows import number_of_word

    held = {}
    for word in words or []:
        joint, equals, value = word.partition("=")
        held[joint] = number_of_word(value, f"--hold {word}") if equals else 0.0
    return held


def _pair(word: str, option: str) -> tuple[str, str]:
    name, equals, value = word.partition("=")
    if not (name and equals and value):
        raise ValueError(f"{option} {word}: expected NAME=VALUE")
    return name, value

"""Options that go together: a command takes each group as one value.

`held_out: groups.HeldOut` in a command's signature stands for `--test`, `--test-fraction` and
`--seed`: each field of the group is an option, declared in `options.py`. `unfolded` tells Typer so.
"""

import inspect
from collections.abc import Callable
from dataclasses import MISSING, Field, dataclass, fields
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nico_selfmodel.cli import options
from nico_selfmodel.cli.placeholders import with_placeholder

if TYPE_CHECKING:
    from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
    from nico_selfmodel.vision.boards.board_detection import AnyBoard


class OptionGroup:
    """A frozen dataclass, each of whose fields is an option."""


@dataclass(frozen=True)
class HeldOutShare(OptionGroup):
    """What is held out of the training data."""

    test_fraction: options.TestFraction = None
    seed: options.SplitSeed = 0


@dataclass(frozen=True)
class HeldOut(HeldOutShare):
    """What is held out of the training data, or beside them."""

    test: options.Test = None


@dataclass(frozen=True)
class Bounds(OptionGroup):
    """Held-out errors above which a result fails."""

    require_test_mm: options.RequireTestMm = None
    require_test_px: options.RequireTestPx = None


@dataclass(frozen=True)
class Output(OptionGroup):
    """The folder to make, and how to tell of it."""

    out: options.Out
    force: options.Force = False
    as_json: options.AsJson = False

    def refuse(self, *inputs: Path | str | None) -> None:
        """Refuse a folder that is there already, and one in which an input lies.

        Args:
            inputs: What the command reads; None for what it does not.
        """
        from nico_selfmodel.files.whole import refuse_folder

        refuse_folder(self.out, force=self.force, inputs=inputs)


@dataclass(frozen=True)
class NamedOutput(Output):
    """A result folder with a self-model."""

    name: options.ModelName = None
    no_report: options.NoReport = False


@dataclass(frozen=True)
class Fixed(OptionGroup):
    """Which parameters are estimated."""

    fix: options.Fix = None
    free: options.Free = None


@dataclass(frozen=True)
class Bends(OptionGroup):
    """What may bend."""

    effects: options.Effects = "auto"
    up: options.Up = None


@dataclass(frozen=True)
class LensChoice(Fixed):
    """What is estimated of cameras, and what was known of them."""

    prior: options.Prior = None
    lens: options.Lens = "auto"
    tangential: options.Tangential = False
    fixed_aspect: options.FixedAspect = False
    loss: options.Loss = "trimmed"
    known: options.KnownCameras = None

    def load(self) -> "CameraOptions":
        """Return what is estimated.

        Raises:
            ValueError: If a word is not valid.
        """
        from nico_selfmodel.estimation.cameras.camera_options import CameraOptions

        return CameraOptions.from_text(
            self.fix or (),
            self.free or (),
            self.prior or (),
            tangential=self.tangential,
            aspect=1.0 if self.fixed_aspect else None,
            loss=self.loss,
            lens=self.lens,
        )


@dataclass(frozen=True)
class BoardChoice(OptionGroup):
    """Which board was photographed."""

    board: options.Board
    square_mm: options.SquareMm
    tag_mm: options.TagMm = None
    family: options.Family = None

    def load(self) -> "AnyBoard":
        """Return the board.

        Raises:
            ValueError: If there is none such.
        """
        from nico_selfmodel.vision.boards.board_kinds import board_of

        return board_of(self.board, self.square_mm, self.tag_mm, self.family)


@dataclass(frozen=True)
class NicoBoard(BoardChoice):
    """Which board was photographed; the chessboard of the simulated Nico where nothing is said."""

    board: options.Board = "9x6"
    square_mm: options.SquareMm = 28.0


@dataclass(frozen=True)
class Chain(OptionGroup):
    """A robot and its chain, where they are known."""

    robot: options.Robot = None
    arm: options.Arm = None
    base: options.Base = None
    tip: options.Tip = None
    hold: options.Hold = None
    point: options.Point = None

    @property
    def names_a_part(self) -> bool:
        """Whether a part of the robot is named, and not just the robot."""
        return any((self.arm, self.base, self.tip, self.hold, self.point))


@dataclass(frozen=True)
class NicoOrChain(Chain):
    """A robot and its chain; Nico's right arm where nothing is said."""

    robot: options.Robot = "nico"


def unfolded(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command for Typer, which knows no groups: their options are its own parameters."""
    groups: dict[str, type[OptionGroup]] = {}
    parameters: list[inspect.Parameter] = []
    for parameter in inspect.signature(command).parameters.values():
        kind = parameter.annotation
        if inspect.isclass(kind) and issubclass(kind, OptionGroup):
            groups[parameter.name] = kind
            parameters += map(_parameter, fields(kind))  # pyright: ignore[reportArgumentType]
        else:
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))

    @wraps(command)
    def run(**given: Any) -> None:
        for name, group in groups.items():
            own = [field.name for field in fields(group)]  # pyright: ignore[reportArgumentType]
            given[name] = group(**{key: given.pop(key) for key in own})
        command(**given)

    parameters = list(map(with_placeholder, parameters))
    run.__signature__ = inspect.Signature(parameters)  # pyright: ignore[reportAttributeAccessIssue]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def _parameter(field: Field[Any]) -> inspect.Parameter:
    """Return a field of a group as a parameter of a command."""
    default = inspect.Parameter.empty if field.default is MISSING else field.default
    kind = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(field.name, kind, default=default, annotation=field.type)

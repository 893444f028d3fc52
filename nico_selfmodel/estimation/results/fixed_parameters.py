"""What the user holds fixed, lets move or knows: `--fix NAME[=VALUE]`, `--free NAME`, `--prior`."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.plausibility import MAX_SPREAD_M
from nico_selfmodel.errors import NotConvergedError
from nico_selfmodel.files.csv_rows import number_of_word
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.names import listed, refuse_unknown

_ANGLES = ("alpha", "beta", "rx", "ry", "rz", "tilt_x", "tilt_y")
"""Last words of parameters that are angles; encoder zeros may lie turns away."""
_LENGTHS = ("D", "r", "x", "y", "z", "distance")


@dataclass(frozen=True)
class FixedParameters:
    """Parameters pinned and freed by name, beyond what is pinned by default."""

    pinned: dict[str, float | None] = field(default_factory=dict)
    """Name -> value; None keeps the value of the start (the robot's, where one was given)."""
    freed: frozenset[str] = frozenset()
    """Names that move although they are pinned by default: gears, gauges."""

    @classmethod
    def from_text(cls, pin: Sequence[str] = (), free: Sequence[str] = ()) -> "FixedParameters":
        """Read the command line's words.

        Raises:
            ValueError: If a value is no number, or hardly in its parameter's unit, or a name is
                fixed twice, or both fixed and freed.
        """
        _refuse_twice("--fix", pin)
        pinned: dict[str, float | None] = {}
        for word in pin:
            name, equals, value = word.partition("=")
            pinned[name.strip()] = _told(name, value, f"--fix {word}") if equals else None
        return cls(pinned, frozenset(free))

    def __post_init__(self) -> None:
        """Refuse what contradicts itself."""
        both = sorted(set(self.pinned) & self.freed)
        if both:
            raise ValueError(f"{listed(both)}: fixed and freed at once; leave out one of them")

    @property
    def names(self) -> frozenset[str]:
        """All names mentioned."""
        return frozenset(self.pinned) | self.freed

    @property
    def only_gears(self) -> bool:
        """Whether the lines can express them: gears let go, or held at the start's value."""
        return all(name.endswith(".gear") for name in self.names)

    def check(self, parameters: DhParameters) -> None:
        """Check that all names exist.

        Raises:
            ValueError: If one does not; the message suggests and lists those there are.
        """
        for name in sorted(self.names):
            refuse_unknown("parameter", name, parameters.names)

    def refuse_turned_gears(self, gears: NDArray) -> None:
        """Refuse an arm some of whose gears are not positive.

        Raises:
            NotConvergedError: Naming what the user asked for, if anything.
        """
        if np.any(gears <= 0.0):
            asked = f" with {', '.join(sorted(self.names))} as asked" if self.names else ""
            advice = (
                "the values and what the data say without them"
                if asked
                else ("units and pairing of readings, or record more poses that differ")
            )
            raise NotConvergedError(
                f"no arm fits the data{asked}: a gear turned negative on the way; check {advice}"
            )


def priors_of(words: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Read `--prior NAME=MEAN,SIGMA` of the command line.

    Raises:
        ValueError: If a word has another form, a mean is hardly in its parameter's unit, a sigma
            is not positive, or a name stands there twice.
    """
    _refuse_twice("--prior", words)
    found = {}
    for word in words:
        name, equals, numbers = word.partition("=")
        mean, comma, sigma = numbers.partition(",")
        if not (equals and comma) or "," in sigma:
            raise ValueError(f"--prior must be NAME=MEAN,SIGMA, got {word}")
        where = f"--prior {word}"
        known = _told(name, mean, where), number_of_word(sigma, where)
        if not known[1] > 0.0:
            raise ValueError(f"{where}: sigma must be positive")
        found[name.strip()] = known
    return found


def _refuse_twice(option: str, words: Sequence[str]) -> None:
    """Refuse a name that is told two values: which of them holds?"""
    names = [word.partition("=")[0].strip() for word in words]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ValueError(f"{option} {twice} is given twice; leave out one of them")


def _told(name: str, value: str, where: str) -> float:
    """Read a parameter's value; refuse one that is hardly in the parameter's unit."""
    told, what = number_of_word(value, where), name.strip().rpartition(".")[2]
    if what in _ANGLES and abs(told) > 2.0 * np.pi:
        raise ValueError(
            f"{where}: {told:g} rad is more than a turn; if these are degrees, give "
            f"{np.radians(told):.6g}"
        )
    if what in _LENGTHS and abs(told) > MAX_SPREAD_M:
        raise ValueError(f"{where}: {told:g} m is far; if these are mm, give {1e-3 * told:g}")
    if what in ("fx", "fy") and told < 1.0:
        raise ValueError(f"{where}: focal lengths are in pixels, and positive")
    if what == "gear" and told <= 0.0:
        raise ValueError(
            f"{where}: gears are positive; if a joint turns the other way, say sign: -1"
        )
    return told

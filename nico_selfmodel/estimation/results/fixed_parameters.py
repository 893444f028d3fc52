"""What the user holds fixed, lets move or knows: `--fix NAME[=VALUE]`, `--free NAME`, `--prior`."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from nico_selfmodel.files.csv_rows import number_of_word
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.names import listed, refuse_unknown


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
            ValueError: If a value is not a number or a name is both fixed and freed.
        """
        pinned: dict[str, float | None] = {}
        for word in pin:
            name, equals, value = word.partition("=")
            pinned[name.strip()] = number_of_word(value, f"--fix {word}") if equals else None
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


def priors_of(words: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Read `--prior NAME=MEAN,SIGMA` of the command line.

    Raises:
        ValueError: If a word has another form, or a sigma is not positive.
    """
    found = {}
    for word in words:
        name, equals, numbers = word.partition("=")
        mean, comma, sigma = numbers.partition(",")
        if not (equals and comma):
            raise ValueError(f"--prior must be NAME=MEAN,SIGMA, got {word}")
        where = f"--prior {word}"
        known = number_of_word(mean, where), number_of_word(sigma, where)
        if not known[1] > 0.0:
            raise ValueError(f"{where}: sigma must be positive")
        found[name.strip()] = known
    return found

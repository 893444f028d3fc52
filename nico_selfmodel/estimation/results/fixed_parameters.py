"""What the user holds fixed or lets move: `--fix NAME`, `--fix NAME=VALUE`, `--free NAME`."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from nico_selfmodel.files.csv_rows import number_of_word
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.names import did_you_mean, listed


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
            ValueError: If a value is not a number or a name is both pinned and freed.
        """
        pinned: dict[str, float | None] = {}
        for word in pin:
            name, equals, value = word.partition("=")
            pinned[name.strip()] = number_of_word(value, f"--fix {word}") if equals else None
        both = set(pinned) & set(free)
        if both:
            raise ValueError(f"{', '.join(sorted(both))} cannot be both pinned and freed")
        return cls(pinned, frozenset(free))

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
        known = parameters.names
        for name in sorted(self.names - set(known)):
            hint = did_you_mean(name, known) or "."
            raise ValueError(f"no parameter {name!r}{hint} There are: {listed(known)}")

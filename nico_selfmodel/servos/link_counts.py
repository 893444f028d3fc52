"""How well the wire to each motor works."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass


@dataclass
class LinkCounts:
    """What happened on the way to one motor."""

    exchanges: int = 0
    """Commands that were answered in the end."""
    timeouts: int = 0
    """Replies that never came, or came short."""
    damaged: int = 0
    """Replies with a wrong checksum."""
    refused: int = 0
    """Commands that the motor received damaged and said so."""
    stray_bytes: int = 0
    """Bytes that nobody had asked for."""
    implausible: int = 0
    """Positions that a second reading did not confirm."""
    failures: int = 0
    """Commands that failed for good."""

    def to_mapping(self) -> dict[str, int]:
        """Return the counts by name."""
        return asdict(self)


def sum_of(counts: Iterable[LinkCounts]) -> LinkCounts:
    """Return the sum of counts."""
    total = LinkCounts()
    for one in counts:
        for name, value in one.to_mapping().items():
            setattr(total, name, getattr(total, name) + value)
    return total

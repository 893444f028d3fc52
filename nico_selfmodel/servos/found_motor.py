"""A motor as a scan found it, whatever its make."""

from dataclasses import dataclass

from nico_selfmodel.servos.link_counts import LinkCounts


@dataclass(frozen=True)
class FoundMotor:
    """A motor that answers."""

    address: int
    device: str
    """What it says it is."""
    position_counts: int
    servo_on: bool
    """Whether it holds."""
    zero_known: bool
    """Whether its zero outlasted the power, or was set since."""
    new_address: bool
    """Whether this scan gave it its address."""


@dataclass(frozen=True)
class Scan:
    """What answers on a port."""

    baud: int
    motors: tuple[FoundMotor, ...]
    link: LinkCounts

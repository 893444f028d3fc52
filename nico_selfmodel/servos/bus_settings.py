"""How patient a bus is, of whatever make, and what it says when patience ends."""

from dataclasses import dataclass

from nico_selfmodel.errors import BusError

NOISY_FOR = 1.0
"""How long after damage a line counts as bad [s]."""


class NoReplyError(BusError):
    """A motor did not answer, or only with damaged bytes, however often it was asked."""


class NoisyLineError(BusError):
    """The receive line never becomes quiet, so that nobody can be understood."""


@dataclass(frozen=True)
class BusSettings:
    """How patient a bus is."""

    attempts: int = 4
    """How often a repeatable command is sent before the motor counts as lost."""
    slack: float = 0.02
    """Delay in the host beyond what the wire needs [s]; later attempts allow up to 8 times it."""
    latency: float = 1e-3
    """Latency timer of the adapter [s]; 16 ms where it has no low-latency mode."""

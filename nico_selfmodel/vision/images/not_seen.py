"""What a detector returns in place of a detection."""

from dataclasses import dataclass


@dataclass(frozen=True)
class NotSeen:
    """The answer of a detector that saw nothing it can vouch for; there is no point to misuse."""

    reason: str
    """What was tried and why it was not enough, in words."""


@dataclass(frozen=True)
class OtherBoard(NotSeen):
    """The answer where another board is plain to see than was stated."""

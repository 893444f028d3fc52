"""The exceptions of nico_selfmodel, one tree.

A message says what was got, what was expected and what to do. A failure that came after part of
the work was done carries that part in `partial`.
"""

from typing import Any


class SelfModelError(Exception):
    """Root of every error that this package raises on purpose.

    Attributes:
        partial: What had been worked out before the failure, or None.
    """

    def __init__(self, message: str, *, partial: Any = None) -> None:
        """Store the message and the partial result.

        Args:
            message: What was got, what was expected, what to do.
            partial: What had been worked out before the failure.
        """
        super().__init__(message)
        self.partial = partial


def check_kind(value: object, kind: type, cure: str) -> None:
    """Refuse a value of another type, whose attributes would be missed later.

    Args:
        kind: What is expected.
        cure: What to give in its place.

    Raises:
        TypeError: If it is none.
    """
    if not isinstance(value, kind):
        got = type(value).__name__
        raise TypeError(f"a {kind.__name__} is expected, got a {got}: {cure}")


class ModelError(SelfModelError):
    """A self-model, or a file that should hold one, is not valid."""


class ImpossibleModelError(ModelError, ValueError):
    """Numbers that no camera, mirror or body can have; a solver's step to them is refused."""


class DataError(SelfModelError):
    """A data set, or a file that should hold one, is not valid."""


class EstimationError(SelfModelError):
    """An estimate could not be made from valid data."""


class NotIdentifiableError(EstimationError):
    """The data cannot determine what was asked for."""


class ContradictedError(EstimationError):
    """Nothing that was measured agrees with what is known: there is nothing to adjust."""


class NotConvergedError(EstimationError):
    """A solver stopped before it reached a minimum."""


class RobotError(SelfModelError, ConnectionError):
    """The robot, or the way to it, failed."""


class BusError(RobotError):
    """The servo bus failed: port, timing or checksum."""


class ServoFault(RobotError):
    """A servo reported a fault of its own."""

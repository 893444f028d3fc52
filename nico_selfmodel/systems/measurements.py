"""What a robot, or an instrument that watches it, senses at one pose."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Measurement:
    """What is sensed at one pose."""

    encoders: NDArray
    """Encoder readings [counts]. Shape (n,)."""
    points: Mapping[str, NDArray | None]
    """Measured position of each marker in the tracker's frame [m], None where it was lost."""


@dataclass(frozen=True, eq=False)
class CameraMeasurement(Measurement):
    """What a robot with cameras senses at one pose; `points` holds None for every marker."""

    pixels: Mapping[str, NDArray] = field(default_factory=lambda: MappingProxyType({}))
    """Left u, v and right u, v of each marker, nan where a camera does not see it. Shape (4,)."""
    images: tuple[NDArray, NDArray] | None = None
    """Pictures of the left and the right camera, BGR, if they were asked for."""
    reasons: tuple[str, ...] = ()
    """Why a marker was not seen, left and right camera of each in turn; empty where it was."""
    reflected: Mapping[str, NDArray] = field(default_factory=lambda: MappingProxyType({}))
    """Pixels of the reflection of each marker, as `pixels`; empty where no mirror is looked for."""
    reflected_reasons: tuple[str, ...] = ()
    """Why a reflection was not seen, as `reasons`."""

"""What a body that watches itself senses at one pose."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from numpy.typing import NDArray

from nico_selfmodel.systems.simulated_arm import Measurement


@dataclass(frozen=True, eq=False)
class CameraMeasurement(Measurement):
    """What a body with eyes senses at one pose; `points` holds None for every marker."""

    pixels: Mapping[str, NDArray] = field(default_factory=lambda: MappingProxyType({}))
    """Left u, v and right u, v of each marker, nan where an eye does not see it. Shape (4,)."""
    images: tuple[NDArray, NDArray] | None = None
    """Pictures of the left and the right eye, BGR, if they were asked for."""
    reasons: tuple[str, ...] = ()
    """Why a marker was not seen, left and right eye of each in turn; empty where it was."""
    reflected: Mapping[str, NDArray] = field(default_factory=lambda: MappingProxyType({}))
    """Pixels of the reflection of each marker, as `pixels`; empty where no mirror is looked for."""
    reflected_reasons: tuple[str, ...] = ()
    """Why a reflection was not seen, as `reasons`."""

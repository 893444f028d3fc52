"""A flat mirror that stands in the world of a body whose cameras move."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.arrays import frozen_array
from nico_selfmodel.errors import ImpossibleModelError
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.rotation import move_on_sphere, step_on_sphere
from nico_selfmodel.model.cameras.mirror import Mirror


@dataclass(frozen=True, eq=False)
class StandingMirror:
    """The plane n.x + d = 0 in W; n points out of the glass to who looks into it.

    Parameters are called as those of a mirror before a camera that stands still: `tilt_x` and
    `tilt_y` lead n along a great circle from a direction of W (`geometry.rotation.move_on_sphere`),
    `distance` is d, how far the world's origin is in front of the glass; negative where it is
    behind.
    """

    name: str
    """Its name."""
    plane: Plane
    """The glass."""
    facing: NDArray = field(default_factory=lambda: np.zeros(3))
    """Unit direction of W that tilts are told from; the axis nearest to the normal if omitted.
    Shape (3,)."""

    def __post_init__(self) -> None:
        """Check the normal, choose what tilts are told from, and make it read-only."""
        normal = frozen_array(self.plane.normal, (3,), "normal")
        facing = self.facing if np.any(self.facing) else _nearest_axis(normal)
        facing = frozen_array(facing, (3,), "facing")
        for what, direction in (("normal", normal), ("facing", facing)):
            if not abs(np.linalg.norm(direction) - 1.0) < 1e-9:
                raise ValueError(f"{what} of {self.name} must have unit length, got {direction}")
        if not np.isfinite(self.plane.offset):
            raise ImpossibleModelError(
                f"distance of {self.name} must be finite, got {self.plane.offset}"
            )
        object.__setattr__(self, "facing", facing)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its parameters: `mirror.<name>.tilt_x` and so on."""
        return Mirror.names_of(self.name)

    @property
    def values(self) -> NDArray:
        """tilt_x, tilt_y [rad] and distance [m]. Shape (3,)."""
        return self.values_of(self.plane)

    def values_of(self, plane: Plane) -> NDArray:
        """Return another plane's values, told from where this mirror's are. Shape (3,)."""
        return np.append(step_on_sphere(self.facing, plane.normal), plane.offset)

    def with_values(self, values: ArrayLike) -> "StandingMirror":
        """Return the mirror with other values, told from the same direction. Shape (3,)."""
        values = np.asarray(values, dtype=float)
        normal = move_on_sphere(self.facing, values[:2])[0]
        plane = Plane(normal / np.linalg.norm(normal), float(values[2]))
        return replace(self, plane=plane)

    @property
    def slopes(self) -> NDArray:
        """Derivatives of n and d by `values`. Shape (4, 3)."""
        out = np.zeros((4, 3))
        out[:3, :2] = move_on_sphere(self.facing, self.values[:2])[1]
        out[3, 2] = 1.0
        return out

    def scaled(self, factor: float) -> "StandingMirror":
        """Return the mirror of a world so many times as large."""
        return replace(self, plane=Plane(self.plane.normal, factor * self.plane.offset))


def _nearest_axis(normal: NDArray) -> NDArray:
    axis = np.zeros(3)
    most = int(np.argmax(np.abs(normal)))
    axis[most] = np.copysign(1.0, normal[most])
    return axis

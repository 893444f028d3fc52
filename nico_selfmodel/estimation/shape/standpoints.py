"""What lies between a shape and the cameras in one look: a mirror, or how far its link has moved.

The cameras stand still. They see a shape that stands still at its reflections, of a mirror after
another; and a link that an arm moves at the place where it is in this look. Both are one map

    p_W = m(p_F; v)

from the shape's frame F to where the cameras seem to see it, of a few values v that are known to
within a covariance, so that the same pictures tell shape and values of both alike.
"""

from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import frozen_array
from nico_selfmodel.geometry.reflection import reflect, reflection, reflection_slopes
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vector_slope, skew
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.model.cameras.mirror import Mirror, plane_of_values


class Standpoint(Protocol):
    """Where a look shows a shape."""

    @property
    def values(self) -> NDArray:
        """V. Shape (k,)."""
        ...

    @property
    def turns_light(self) -> bool:
        """Whether the shape is lit otherwise than in other looks."""
        ...

    @property
    def R_WF(self) -> NDArray | None:
        """How the frame of a link that moves is turned; None of one that stands. Shape (3, 3)."""
        ...

    def at(self, values: NDArray) -> Self:
        """Return the same with other values. Shape (k,)."""
        ...

    def seen_at(self, p_FQ: NDArray) -> NDArray:
        """Return where the cameras seem to see points; nan where none can be seen. (N, 3)."""
        ...

    def slopes(self, p_FQ: NDArray) -> tuple[NDArray, NDArray]:
        """Return how these places move by points, (3, 3), and by values, (N, 3, k)."""
        ...

    def seen_from(self, p_WC: NDArray) -> NDArray:
        """Return from where in F a camera seems to look. Shape (3,) -> (3,)."""
        ...


@dataclass(frozen=True, eq=False)
class InMirror:
    """A mirror before a shape that stands still, in W."""

    mirror: Mirror
    """Before the left camera."""
    X_WL: NDArray
    """Pose of the left camera. Shape (4, 4)."""

    turns_light = False
    R_WF = None

    @property
    def values(self) -> NDArray:
        """Of the mirror. Shape (3,)."""
        return self.mirror.values

    def at(self, values: NDArray) -> "InMirror":
        """Return a mirror that stands elsewhere. Shape (3,)."""
        return replace(self, mirror=Mirror.from_values(values))

    def seen_at(self, p_FQ: NDArray) -> NDArray:
        """Return where reflections seem to be; nan behind the glass. Shape (N, 3)."""
        plane = self.mirror.plane_in(self.X_WL)
        front = plane.distance_to(p_FQ) > 0.0
        return np.where(front[:, None], reflect(plane, p_FQ), np.nan)

    def slopes(self, p_FQ: NDArray) -> tuple[NDArray, NDArray]:
        """Return how reflections move by points, (3, 3), and by the mirror, (N, 3, 3)."""
        plane, by_values = plane_of_values(self.mirror.values, self.X_WL)
        return reflection(plane)[:3, :3], reflection_slopes(plane, p_FQ) @ by_values

    def seen_from(self, p_WC: NDArray) -> NDArray:
        """Return where a camera's reflection is. Shape (3,)."""
        return reflect(self.mirror.plane_in(self.X_WL), p_WC)


@dataclass(frozen=True, eq=False)
class OnLink:
    """A link that has moved: its pose by the arm's joints, and what that may be wrong by."""

    X_WF: NDArray
    """Pose of the link's frame F by the joints. Shape (4, 4)."""
    values: NDArray
    """By how much it is turned about the origin of F beside that, as a rotation vector in W [rad],
    and shifted [m]. Shape (6,)."""

    turns_light = True

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        object.__setattr__(self, "X_WF", frozen_array(self.X_WF, (4, 4), "X_WF"))
        object.__setattr__(self, "values", frozen_array(self.values, (6,), "values"))

    @property
    def pose(self) -> NDArray:
        """Where the link is, its values counted. Shape (4, 4)."""
        R, p = rotation_from_vector(self.values[:3]), self.X_WF[:3, 3] + self.values[3:]
        return transform(R @ self.X_WF[:3, :3], p)

    @property
    def R_WF(self) -> NDArray:
        """How the link's frame is turned. Shape (3, 3)."""
        return self.pose[:3, :3]

    def at(self, values: NDArray) -> "OnLink":
        """Return the link elsewhere. Shape (6,)."""
        return replace(self, values=values)

    def seen_at(self, p_FQ: NDArray) -> NDArray:
        """Return where points of the link are. Shape (N, 3)."""
        return apply(self.pose, p_FQ)

    def slopes(self, p_FQ: NDArray) -> tuple[NDArray, NDArray]:
        """Return how these places move by points, (3, 3), and by the pose, (N, 3, 6)."""
        turned = apply(self.pose, p_FQ) - self.pose[:3, 3]
        by_values = np.zeros((len(p_FQ), 3, 6))
        by_values[:, :, :3] = -skew(turned) @ rotation_vector_slope(self.values[:3])
        by_values[:, :, 3:] = np.eye(3)
        return self.pose[:3, :3], by_values

    def seen_from(self, p_WC: NDArray) -> NDArray:
        """Return where a camera is in the link's frame. Shape (3,)."""
        return apply(inverse(self.pose), p_WC)

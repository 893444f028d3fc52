"""A flat mirror: its plane before the left camera, and what cameras become when reflected in it."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.arrays import frozen_array, frozen_covariance
from nico_selfmodel.errors import ImpossibleModelError
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.reflection import reflect, reflection
from nico_selfmodel.geometry.rotation import move_on_sphere, step_on_sphere
from nico_selfmodel.model.cameras.camera import Camera

MIRROR_PARTS = ("tilt_x", "tilt_y", "distance")
"""What a mirror's parameters are called, in the order of `Mirror.values`."""
MIRROR_UNITS = ("rad", "rad", "m")
"""Units of `MIRROR_PARTS`."""
_FACING = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True, eq=False)
class Mirror:
    """The plane n.x + d = 0 in the left camera's frame L.

    n points out of the glass to the cameras, so that d is the left camera's distance from the
    glass and n.x + d > 0 in front of it. Three parameters: n follows the great circle from (0, 0,
    -1), a mirror that faces the left camera, towards the image's right by `tilt_x` and upwards by
    `tilt_y` (`geometry.rotation.move_on_sphere`); this chart fails only for a mirror that faces
    away. `distance` is d.
    """

    normal: NDArray
    """Unit normal n in L, towards the cameras. Shape (3,)."""
    distance: float
    """d, the left camera's distance from the glass [m]."""
    covariance: NDArray | None = None
    """Of `values`; None where it is not known. Shape (3, 3)."""

    def __post_init__(self) -> None:
        """Check the numbers and make the arrays read-only."""
        normal = frozen_array(self.normal, (3,), "normal")
        if abs(np.linalg.norm(normal) - 1.0) > 1e-9:
            raise ValueError(f"normal must have unit length, got {normal.tolist()}")
        object.__setattr__(self, "normal", normal)
        object.__setattr__(self, "distance", float(self.distance))
        if not (self.distance > 0.0 and np.isfinite(self.distance)):
            raise ImpossibleModelError(
                f"distance must be positive, got {self.distance:g}: the left camera is in front of "
                "the glass, and the normal points to it"
            )
        if self.covariance is not None:
            covariance = frozen_covariance(self.covariance, 3)
            object.__setattr__(self, "covariance", covariance)

    @classmethod
    def from_values(cls, values: ArrayLike, covariance: ArrayLike | None = None) -> "Mirror":
        """Build a mirror from `MIRROR_PARTS`. Shape (3,), covariance (3, 3)."""
        plane, _ = plane_of_values(values)
        known = None if covariance is None else np.asarray(covariance)
        return cls(plane.normal, plane.offset, known)

    @classmethod
    def from_plane(cls, plane: Plane) -> "Mirror":
        """Build a mirror from a plane in L, whichever way its normal points.

        Raises:
            ValueError: If the left camera lies in the plane.
        """
        side = np.copysign(1.0, plane.offset)
        return cls(side * plane.normal, side * plane.offset)

    @staticmethod
    def names_of(mirror: str) -> tuple[str, ...]:
        """Return the names of a mirror's parameters: `mirror.<id>.tilt_x` and so on."""
        return tuple(f"mirror.{mirror}.{part}" for part in MIRROR_PARTS)

    @property
    def values(self) -> NDArray:
        """tilt_x, tilt_y [rad] and distance [m]. Shape (3,)."""
        return np.append(step_on_sphere(_FACING, self.normal), self.distance)

    @property
    def plane(self) -> Plane:
        """The plane in L."""
        return Plane(self.normal, self.distance)

    @property
    def normal_sigma(self) -> float | None:
        """Root of the summed variance of the normal's direction [rad]; None if not known."""
        if self.covariance is None:
            return None
        slopes = plane_of_values(self.values)[1][:3]
        return float(np.sqrt(np.trace(slopes @ self.covariance @ slopes.T)))

    def plane_in(self, X_WL: ArrayLike) -> Plane:
        """Return the plane in another frame W, in which the left camera has pose `X_WL`."""
        X_WL = np.asarray(X_WL, dtype=float)
        normal = X_WL[:3, :3] @ self.normal
        return Plane(normal, float(self.distance - normal @ X_WL[:3, 3]))

    def in_front_by(self, p_LQ: ArrayLike) -> NDArray:
        """Return how far points are in front of the glass [m], negative behind. (..., 3)."""
        return self.plane.distance_to(p_LQ)

    def reflect(self, p_LQ: ArrayLike) -> NDArray:
        """Reflect points given in L. Shape (..., 3) -> (..., 3)."""
        return reflect(self.plane, p_LQ)

    def angle_to(self, other: "Mirror") -> float:
        """Return the angle between two mirrors' normals [rad]."""
        cross = np.linalg.norm(np.cross(self.normal, other.normal))
        return float(np.arctan2(cross, self.normal @ other.normal))


def plane_of_values(values: ArrayLike, X_WL: ArrayLike | None = None) -> tuple[Plane, NDArray]:
    """Return the plane that parameters describe, also where no mirror could be.

    Args:
        values: `Mirror.values`; a solver may pass through distances below zero. Shape (3,).
        X_WL: Pose of the left camera in the frame in which the plane is asked for; L if omitted.

    Returns:
        The plane, and the derivatives of (n, d) by `values`, shape (4, 3).
    """
    values = np.asarray(values, dtype=float)
    normal, by_tilt = move_on_sphere(_FACING, values[:2])
    normal = normal / np.linalg.norm(normal)
    slopes = np.zeros((4, 3))
    slopes[:3, :2], slopes[3, 2] = by_tilt, 1.0
    if X_WL is None:
        return Plane(normal, float(values[2])), slopes
    X_WL = np.asarray(X_WL, dtype=float)
    normal, slopes[:3] = X_WL[:3, :3] @ normal, X_WL[:3, :3] @ slopes[:3]
    slopes[3] -= X_WL[:3, 3] @ slopes[:3]
    return Plane(normal, float(values[2] - normal @ X_WL[:3, 3])), slopes


def mirror_camera(camera: Camera, plane: Plane) -> Camera:
    """Return the camera that sees real points where `camera` sees their reflections.

    Point x has its reflection at S x - 2 d n, so that a camera K [R | t] shows it through

        K [R S | t - 2 d R n]    det -1, points in front have positive depth, or equally
        K [-R S | -(t - 2 d R n)]    a proper rotation, points in front have NEGATIVE depth

    Both are one homogeneous matrix, hence one X/Z, Y/Z, and lens distortion, which acts on these,
    is the same. This is the first form: a `Camera` whose pose is reflected, and whose frame is
    therefore left-handed. Its centre is the reflected centre (thesis eq. 9.10). The thesis' eq.
    9.12 misses the second by half a turn about the optical axis (the least rotation from z to the
    new axis is not -S).

    Args:
        plane: The mirror, in the same world as the camera.

    Returns:
        A camera for `project`, `projection`, `rays` and a `StereoRig` to triangulate with.
    """
    return replace(camera, X_WC=reflection(plane) @ camera.X_WC)

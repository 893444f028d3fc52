"""Two cameras before a mirror as one instrument: points to reflections, reflections to points.

A reflection in a mirror is seen as by a pair of reflected cameras
(`model.cameras.mirror.mirror_camera`).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.reflection import reflect, reflection_slopes
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.mirror import Mirror, mirror_camera, plane_of_values
from nico_selfmodel.model.cameras.projection import project_in_camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig, Triangulation

GATE_99 = 13.276704135987622
"""What a chi-square of four degrees of freedom exceeds once in a hundred times."""


@dataclass(frozen=True, eq=False)
class ReflectedProjection:
    """Pixels of reflections and how they move."""

    pixels: NDArray
    """u and v in each camera [px]. Shape (N, 2 C)."""
    by_point: NDArray
    """By the real point in the world [px/m]. Shape (N, 2 C, 3)."""
    by_mirror: NDArray
    """By `Mirror.values` [px/rad, px/m]. Shape (N, 2 C, 3)."""


@dataclass(frozen=True, eq=False)
class MirrorRig:
    """A pair of cameras and a mirror before them."""

    rig: StereoRig
    """The cameras."""
    mirror: Mirror
    """The mirror, in the left camera's frame."""

    @cached_property
    def plane(self) -> Plane:
        """The mirror in the world."""
        return self.mirror.plane_in(self.rig.left.X_WC)

    @cached_property
    def virtual(self) -> StereoRig:
        """The reflected cameras: they see a point where the real ones see its reflection."""
        left, right = (mirror_camera(camera, self.plane) for camera in self.rig.cameras)
        return StereoRig(left, right)

    def project(self, p_WQ: ArrayLike) -> NDArray:
        """Return where both cameras see the reflections of points.

        Args:
            p_WQ: Points [m]. Shape (N, 3) or (3,).

        Returns:
            Pixels; nan where a point is not in front of the glass or a camera cannot see its
            reflection. Shape (N, 4) or (4,).
        """
        pixels = self.virtual.project(p_WQ)
        front = self.plane.distance_to(p_WQ) > 0.0
        return np.where(front[..., None], pixels, np.nan)

    def projection(self, p_WQ: ArrayLike) -> ReflectedProjection:
        """Return reflected pixels with derivatives, without asking who can see them.

        Args:
            p_WQ: Points [m]. Shape (N, 3).
        """
        return reflected_projection(self.rig.cameras, self.mirror.values, p_WQ)

    def triangulate(
        self, pixels: ArrayLike, pixel_covariance: ArrayLike | float = 1.0
    ) -> Triangulation:
        """Reconstruct real points, in front of the glass, from the pixels of their reflections.

        Args:
            pixels: Measured pixels of reflections; rows with a nan stay nan. Shape (N, 4).
            pixel_covariance: As in `StereoRig.triangulate`.

        Returns:
            Points with covariance, that of the mirror included where it is known; `in_front` is
            True where the point is in front of the glass and of the reflected cameras.

        Raises:
            ModelError: If a pixel has no ray.
            ValueError: If the shape is wrong.
        """
        found = self.virtual.triangulate(pixels, pixel_covariance)
        front = found.in_front.copy()
        front[front] &= self.plane.distance_to(found.p_WQ[front]) > 0.0
        covariance = found.covariance
        if self.mirror.covariance is not None:
            # The virtual point stays where the cameras see it while the mirror moves.
            behind = np.nan_to_num(reflect(self.plane, found.p_WQ))
            by_values = plane_of_values(self.mirror.values, self.rig.left.X_WC)[1]
            slopes = reflection_slopes(self.plane, behind) @ by_values
            covariance = covariance + slopes @ self.mirror.covariance @ np.swapaxes(slopes, 1, 2)
        return replace(found, covariance=covariance, in_front=front)


def projected(cameras: tuple[Camera, ...], p_WQ: NDArray) -> tuple[NDArray, NDArray]:
    """Project points without asking who can see them.

    Args:
        cameras: C of them.
        p_WQ: Points [m]. Shape (N, 3).

    Returns:
        Pixels, shape (N, 2 C), and their derivatives by the point, shape (N, 2 C, 3).
    """
    pixels = np.empty((len(p_WQ), 2 * len(cameras)))
    slopes = np.empty((len(p_WQ), 2 * len(cameras), 3))
    for c, camera in enumerate(cameras):
        own = slice(2 * c, 2 * c + 2)
        X_CW = camera.X_CW
        p_CQ = X_CW[:3, :3] @ p_WQ.T + X_CW[:3, 3:]
        shown, by_point, _ = project_in_camera(p_CQ, camera.values, camera.lens)
        pixels[:, own] = shown.T
        slopes[:, own] = np.moveaxis(by_point, 2, 0) @ X_CW[:3, :3]
    return pixels, slopes


def reflected_projection(
    cameras: tuple[Camera, ...], values: ArrayLike, p_WQ: ArrayLike
) -> ReflectedProjection:
    """Project reflections into one or two cameras, without asking who can see them.

    Args:
        cameras: C of them; the mirror stands in the frame of the first.
        values: `Mirror.values`. Shape (3,).
        p_WQ: Points [m]. Shape (N, 3).
    """
    p_WQ = np.asarray(p_WQ, dtype=float)
    plane, by_values = plane_of_values(values, cameras[0].X_WC)
    pixels, by_point = projected(cameras, reflect(plane, p_WQ))
    turned = by_point - 2.0 * (by_point @ plane.normal)[:, :, None] * plane.normal
    by_mirror = by_point @ (reflection_slopes(plane, p_WQ) @ by_values)
    return ReflectedProjection(pixels, turned, by_mirror)

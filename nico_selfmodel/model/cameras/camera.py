"""A camera: intrinsic matrix, lens distortion and pose, with every derivative in closed form."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.arrays import frozen_array
from nico_selfmodel.errors import ImpossibleModelError
from nico_selfmodel.geometry.rotation import skew
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.cameras.lens_models import FisheyeLens, Lens, RadialLens
from nico_selfmodel.model.cameras.projection import (
    EVERY_INTRINSIC,
    FISHEYE,
    POLYNOMIAL,
    RATIONAL,
    Projection,
    Rays,
    intrinsics_of,
    project_in_camera,
)


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera with lens distortion, in OpenCV's conventions.

    Pixel = K distort(X/Z, Y/Z), K = [[fx, skew, cx], [0, fy, cy], [0, 0, 1]].
    """

    fx: float
    """Focal length along u [px]."""
    fy: float
    """Focal length along v [px]."""
    cx: float
    """Principal point [px]."""
    cy: float
    """Principal point [px]."""
    image_size: tuple[int, int]
    """Width and height [px]."""
    skew: float = 0.0
    """Shear of the pixel grid [px]."""
    k1: float = 0.0
    """Radial distortion, r^2."""
    k2: float = 0.0
    """Radial distortion, r^4."""
    k3: float = 0.0
    """Radial distortion, r^6."""
    p1: float = 0.0
    """Tangential distortion."""
    p2: float = 0.0
    """Tangential distortion."""
    k4: float = 0.0
    """Of a rational lens, r^2 below; of a fisheye, theta^8."""
    k5: float = 0.0
    """Of a rational lens, r^4 below."""
    k6: float = 0.0
    """Of a rational lens, r^6 below."""
    lens: str = POLYNOMIAL
    """One of `LENSES`."""
    X_WC: NDArray = field(default_factory=lambda: np.eye(4))
    """Pose in the world: z looks forward, x right, y down [m]. Shape (4, 4)."""

    def __post_init__(self) -> None:
        """Check the numbers and make the pose read-only."""
        own = intrinsics_of(self.lens)
        for name in EVERY_INTRINSIC:
            value = float(getattr(self, name))
            object.__setattr__(self, name, value)
            if value != 0.0 and name not in own:
                raise ValueError(f"a {self.lens} lens has no {name}, got {value:g}")
        width, height = (int(size) for size in self.image_size)
        if (width, height) != tuple(self.image_size):
            raise ValueError(f"image_size must be two whole numbers, got {self.image_size}")
        object.__setattr__(self, "image_size", (width, height))
        object.__setattr__(self, "X_WC", frozen_array(self.X_WC, (4, 4), "X_WC"))
        if not np.isfinite(self.values).all():
            raise ImpossibleModelError(f"a camera's parameters must be finite, got {self.values}")
        if not (self.fx > 0.0 and self.fy > 0.0 and width > 0 and height > 0):
            raise ImpossibleModelError(
                "focal lengths and image size must be positive, got "
                f"fx {self.fx:g}, fy {self.fy:g}, {width} x {height}"
            )

    @classmethod
    def from_values(
        cls,
        values: ArrayLike,
        image_size: tuple[int, int],
        X_WC: ArrayLike | None = None,
        lens: str = POLYNOMIAL,
    ) -> "Camera":
        """Build a camera from its numbers in the order of `intrinsics_of` its lens."""
        names = intrinsics_of(lens)
        named = dict(zip(names, np.asarray(values, dtype=float).tolist(), strict=True))
        pose = np.eye(4) if X_WC is None else np.asarray(X_WC)
        return cls(image_size=image_size, X_WC=pose, lens=lens, **named)

    @property
    def values(self) -> NDArray:
        """The numbers inside, in the order of `intrinsics_of` the lens; of a polynomial, (10,)."""
        return np.array([getattr(self, name) for name in intrinsics_of(self.lens)])

    @property
    def named_values(self) -> Mapping[str, float]:
        """The numbers inside, by name."""
        return {name: getattr(self, name) for name in intrinsics_of(self.lens)}

    @property
    def K(self) -> NDArray:
        """The intrinsic matrix. Shape (3, 3)."""
        return np.array([[self.fx, self.skew, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def k(self) -> NDArray:
        """Radial coefficients: k1 to k3, of a rational lens to k6, of a fisheye to k4."""
        last = {POLYNOMIAL: 3, RATIONAL: 6, FISHEYE: 4}[self.lens]
        return np.array([getattr(self, f"k{i}") for i in range(1, last + 1)])

    @property
    def p(self) -> NDArray:
        """Tangential coefficients p1, p2. Shape (2,)."""
        return np.array([self.p1, self.p2])

    @property
    def X_CW(self) -> NDArray:
        """The world in the camera's frame, OpenCV's extrinsics. Shape (4, 4)."""
        return inverse(self.X_WC)

    def at(self, X_WC: ArrayLike) -> "Camera":
        """Return the same camera elsewhere. Shape (4, 4)."""
        return replace(self, X_WC=np.asarray(X_WC, dtype=float))

    def project(self, p_WQ: ArrayLike) -> NDArray:
        """Project points of the world.

        Args:
            p_WQ: Points [m]. Shape (N, 3) or (3,).

        Returns:
            Pixels [px]; nan for points that are not in front of the camera, or so far aside that
            the lens would fold the image. Shape (N, 2) or (2,).
        """
        p_CQ = apply(self.X_CW, _points(p_WQ, 3, "p_WQ"))
        return np.moveaxis(self._on_sensor(self._lens.shown(np.moveaxis(p_CQ, -1, 0))), 0, -1)

    def projection(self, p_WQ: ArrayLike) -> Projection:
        """Project points with derivatives by point, pose and intrinsics.

        Args:
            p_WQ: Points in front of the camera [m]. Shape (N, 3).

        Raises:
            ImpossibleModelError: If a point is not in front of the camera.
        """
        p_WQ = _points(p_WQ, 3, "p_WQ").reshape(-1, 3)
        p_CQ = apply(self.X_CW, p_WQ)
        if self.lens != FISHEYE and not (p_CQ[:, 2] > 0.0).all():
            behind = int(np.sum(~(p_CQ[:, 2] > 0.0)))
            raise ImpossibleModelError(f"{behind} points are behind the camera")
        pixels, by_camera_point, by_intrinsics = project_in_camera(p_CQ.T, self.values, self.lens)
        by_point = np.einsum("abn,bc->nac", by_camera_point, self.X_CW[:3, :3])
        # p_CQ = R_WC' exp(-[w]) (p_WQ - p_WC - t): d/dw = R_WC' [p_WQ - p_WC]x, d/dt = -R_WC'
        turned = by_point @ skew(p_WQ - self.X_WC[:3, 3])
        by_pose = np.concatenate([turned, -by_point], axis=2)
        return Projection(pixels.T, by_point, by_pose, np.moveaxis(by_intrinsics, -1, 0))

    def pixels_of(self, ideal: NDArray) -> NDArray:
        """Return pixels of ideal coordinates X/Z, Y/Z. Shape (2, ...) -> (2, ...)."""
        return self._on_sensor(self._lens.distort(np.asarray(ideal)))

    def pixels_of_points(self, p_CQ: NDArray) -> NDArray:
        """Return pixels of points in its frame, whether it shows them or not; see `project`.

        Args:
            p_CQ: Points, of Drake's scalars or floats [m]. Shape (3, ...).

        Returns:
            Of the same numbers [px]. Shape (2, ...).
        """
        return self._on_sensor(self._lens.bent(p_CQ))

    def _on_sensor(self, bent: NDArray) -> NDArray:
        """Apply the intrinsic matrix. Shape (2, ...)."""
        x, y = bent
        return np.stack([self.fx * x + self.skew * y + self.cx, self.fy * y + self.cy])

    def has_rays(self, pixels: ArrayLike) -> NDArray:
        """Return which pixels have a ray X/Z, Y/Z: those inside the monotone part of the lens.

        Of a fisheye those within 89 deg of its axis.

        Args:
            pixels: Shape (N, 2) or (2,).

        Returns:
            Boolean; False for nan. Shape (N,) or ().
        """
        return self._lens.has_rays(self._distorted(_points(pixels, 2, "pixels")))

    def folds(self, pixels: ArrayLike) -> NDArray:
        """Return which pixels lie where the lens folds its image, beyond its monotone part.

        Args:
            pixels: Shape (N, 2) or (2,).

        Returns:
            Boolean. Shape (N,) or ().
        """
        return self._lens.folds(self._distorted(_points(pixels, 2, "pixels")))

    @property
    def reach(self) -> float:
        """Largest radius X/Z, of a fisheye angle off the axis [rad], up to which it is monotone."""
        return self._lens.reach

    @property
    def widest(self) -> float:
        """Largest radius X/Z that the lens shows."""
        return self._lens.widest

    def profile(self, radii: NDArray) -> tuple[NDArray, NDArray]:
        """Return how far from the axis the lens shows radii, tangential distortion left out.

        Args:
            radii: X/Z, or of a fisheye angles off the axis [rad]. Shape (n,).

        Returns:
            Distorted radii, shape (n,), and their derivatives by k1, k2, ..., shape (n, k).
        """
        return self._lens.profile(radii)

    def undistort(self, pixels: ArrayLike) -> NDArray:
        """Return the ideal coordinates X/Z, Y/Z of pixels, by Newton per point.

        Args:
            pixels: Shape (N, 2) or (2,); nan stays nan.

        Returns:
            Shape (N, 2) or (2,).

        Raises:
            ModelError: If a pixel lies outside the radius where the distortion is monotone.
        """
        distorted = self._distorted(_points(pixels, 2, "pixels"))
        return np.moveaxis(self._lens.undistort(distorted), 0, -1)

    def at_depth(self, pixels: ArrayLike, depth: ArrayLike) -> NDArray:
        """Return the points in the world that pixels show.

        Args:
            pixels: Shape (N, 2).
            depth: Of each, along the optical axis [m]. Shape (N,).

        Returns:
            Shape (N, 3).

        Raises:
            ModelError: If a pixel lies outside the radius where the distortion is monotone.
        """
        ideal = self.undistort(np.asarray(pixels, dtype=float))
        p_CQ = np.concatenate([ideal, np.ones((len(ideal), 1))], axis=1)
        return apply(self.X_WC, p_CQ * np.asarray(depth, dtype=float)[:, None])

    def directions(self, pixels: ArrayLike) -> NDArray:
        """Return unit vectors along the lines of sight in the camera's own frame.

        Args:
            pixels: Shape (N, 2).

        Returns:
            nan where no ray belongs to a pixel; those of a fisheye reach past 90 deg. Shape (N, 3).
        """
        pixels = _points(pixels, 2, "pixels").reshape(-1, 2)
        return self._lens.directions(self._distorted(pixels))

    def rays(self, pixels: ArrayLike) -> Rays:
        """Return the lines of sight of pixels, with derivatives.

        Args:
            pixels: Shape (N, 2).

        Returns:
            Unit directions in the world and how they move.

        Raises:
            ModelError: If a pixel lies outside the radius where the distortion is monotone.
        """
        ideal = self.undistort(np.atleast_2d(np.asarray(pixels, dtype=float)))
        long = np.column_stack([ideal, np.ones(len(ideal))])
        length = np.linalg.norm(long, axis=1)
        in_camera = long / length[:, None]
        # d(v/|v|) = (I - d d') / |v| dv; its first two columns, for v = (x, y, 1)
        project = (np.eye(3) - in_camera[:, :, None] * in_camera[:, None, :])[:, :, :2]
        by_ideal = self.X_WC[:3, :3] @ (project / length[:, None, None])
        _, by_point, by_intrinsics = project_in_camera(long.T, self.values, self.lens)
        # Pixels stay while intrinsics move: dx = -(du/dx)^-1 du/d(intrinsics)
        ideal_by_pixel = np.linalg.inv(np.moveaxis(by_point[:, :2], -1, 0))
        by_pixel = by_ideal @ ideal_by_pixel
        direction = in_camera @ self.X_WC[:3, :3].T
        by_pose = np.zeros((len(ideal), 3, 6))
        by_pose[:, :, :3] = -skew(direction)
        by_inside = -by_pixel @ np.moveaxis(by_intrinsics, -1, 0)
        return Rays(self.X_WC[:3, 3].copy(), direction, by_pixel, by_pose, by_inside)

    @cached_property
    def _lens(self) -> Lens:
        return FisheyeLens(self.k) if self.lens == FISHEYE else RadialLens(self.k, self.p)

    def _distorted(self, pixels: NDArray) -> NDArray:
        """Undo the intrinsic matrix. Shape (..., 2) -> (2, ...)."""
        u, v = np.moveaxis(pixels, -1, 0)
        y = (v - self.cy) / self.fy
        return np.stack([(u - self.cx - self.skew * y) / self.fx, y])


def _points(points: ArrayLike, columns: int, name: str) -> NDArray:
    array = np.asarray(points, dtype=float)
    if array.ndim not in (1, 2) or array.shape[-1] != columns:
        raise ValueError(
            f"{name} must have shape (N, {columns}) or ({columns},), got {array.shape}"
        )
    return array

"""A camera: intrinsic matrix, lens distortion and pose, with every derivative in closed form."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.arrays import frozen_array
from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.rotation import skew
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.cameras import lens

INTRINSICS = ("fx", "fy", "skew", "cx", "cy", "k1", "k2", "k3", "p1", "p2")
"""Names of what lies inside a camera, in the order of `Camera.values`."""

DISTORTION = INTRINSICS[5:]
"""Those of them that bend light."""

INTRINSIC_UNITS = ("px", "px", "px", "px", "px", "1", "1", "1", "1", "1")
"""Units of `INTRINSICS`."""


@dataclass(frozen=True, eq=False)
class Projection:
    """Pixels and how they move with everything that they depend on."""

    pixels: NDArray
    """u right, v down; integers are pixel centres [px]. Shape (N, 2)."""
    by_point: NDArray
    """By the point in the world [px/m]. Shape (N, 2, 3)."""
    by_pose: NDArray
    """By (w, t) that move the camera to exp([w]) R_WC, p_WC + t [px/rad, px/m]. Shape (N, 2, 6)."""
    by_intrinsics: NDArray
    """By `INTRINSICS`. Shape (N, 2, 10)."""


@dataclass(frozen=True, eq=False)
class Rays:
    """Lines of sight: points p_WC + distance * direction."""

    origin: NDArray
    """The camera's centre in the world [m]. Shape (3,)."""
    direction: NDArray
    """Unit vectors in the world. Shape (N, 3)."""
    by_pixel: NDArray
    """Derivatives of the direction by the pixel [1/px]. Shape (N, 3, 2)."""
    by_pose: NDArray
    """By (w, t) as in `Projection`; the origin moves with t. Shape (N, 3, 6)."""
    by_intrinsics: NDArray
    """By `INTRINSICS`. Shape (N, 3, 10)."""


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
    X_WC: NDArray = field(default_factory=lambda: np.eye(4))
    """Pose in the world: z looks forward, x right, y down [m]. Shape (4, 4)."""

    def __post_init__(self) -> None:
        """Check the numbers and make the pose read-only."""
        for name in INTRINSICS:
            object.__setattr__(self, name, float(getattr(self, name)))
        width, height = (int(size) for size in self.image_size)
        if (width, height) != tuple(self.image_size):
            raise ValueError(f"image_size must be two whole numbers, got {self.image_size}")
        object.__setattr__(self, "image_size", (width, height))
        object.__setattr__(self, "X_WC", frozen_array(self.X_WC, (4, 4), "X_WC"))
        if not np.isfinite(self.values).all():
            raise ValueError(f"a camera's parameters must be finite, got {self.values}")
        if not (self.fx > 0.0 and self.fy > 0.0 and width > 0 and height > 0):
            raise ValueError(
                "focal lengths and image size must be positive, got "
                f"fx {self.fx:g}, fy {self.fy:g}, {width} x {height}"
            )

    @classmethod
    def from_values(
        cls, values: ArrayLike, image_size: tuple[int, int], X_WC: ArrayLike | None = None
    ) -> "Camera":
        """Build a camera from its numbers in the order of `INTRINSICS`. Shape (10,)."""
        named = dict(zip(INTRINSICS, np.asarray(values, dtype=float).tolist(), strict=True))
        pose = np.eye(4) if X_WC is None else np.asarray(X_WC)
        return cls(image_size=image_size, X_WC=pose, **named)

    @property
    def values(self) -> NDArray:
        """The numbers inside, in the order of `INTRINSICS`. Shape (10,)."""
        return np.array([getattr(self, name) for name in INTRINSICS])

    @property
    def named_values(self) -> Mapping[str, float]:
        """The numbers inside, by name."""
        return {name: getattr(self, name) for name in INTRINSICS}

    @property
    def K(self) -> NDArray:
        """The intrinsic matrix. Shape (3, 3)."""
        return np.array([[self.fx, self.skew, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def k(self) -> NDArray:
        """Radial coefficients k1, k2, k3. Shape (3,)."""
        return np.array([self.k1, self.k2, self.k3])

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
        x, y, z = np.moveaxis(p_CQ, -1, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            ideal = np.stack([x / z, y / z])
            seen = (z > 0.0) & (np.hypot(*ideal) < lens.largest_radius(self.k))
        pixels = self.pixels_of(np.where(seen, ideal, np.nan))
        return np.moveaxis(pixels, 0, -1)

    def projection(self, p_WQ: ArrayLike) -> Projection:
        """Project points with derivatives by point, pose and intrinsics.

        Args:
            p_WQ: Points in front of the camera [m]. Shape (N, 3).

        Returns:
            Pixels and derivatives.

        Raises:
            ModelError: If a point is not in front of the camera.
        """
        p_WQ = _points(p_WQ, 3, "p_WQ").reshape(-1, 3)
        p_CQ = apply(self.X_CW, p_WQ)
        if not (p_CQ[:, 2] > 0.0).all():
            raise ModelError(f"{int(np.sum(~(p_CQ[:, 2] > 0.0)))} points are behind the camera")
        pixels, by_camera_point, by_intrinsics = project_in_camera(p_CQ.T, self.values)
        by_point = np.einsum("abn,bc->nac", by_camera_point, self.X_CW[:3, :3])
        # p_CQ = R_WC' exp(-[w]) (p_WQ - p_WC - t): d/dw = R_WC' [p_WQ - p_WC]x, d/dt = -R_WC'
        turned = by_point @ skew(p_WQ - self.X_WC[:3, 3])
        by_pose = np.concatenate([turned, -by_point], axis=2)
        return Projection(pixels.T, by_point, by_pose, np.moveaxis(by_intrinsics, -1, 0))

    def pixels_of(self, ideal: NDArray) -> NDArray:
        """Return pixels of ideal coordinates X/Z, Y/Z. Shape (2, ...) -> (2, ...)."""
        x, y = lens.distort(np.asarray(ideal), self.k, self.p)
        return np.stack([self.fx * x + self.skew * y + self.cx, self.fy * y + self.cy])

    def has_rays(self, pixels: ArrayLike) -> NDArray:
        """Return which pixels have a ray: those inside the monotone part of the lens.

        Args:
            pixels: Shape (N, 2) or (2,).

        Returns:
            Boolean; False for nan. Shape (N,) or ().
        """
        return lens.within_fold(self._distorted(_points(pixels, 2, "pixels")), self.k)

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
        return np.moveaxis(lens.undistort(distorted, self.k, self.p), 0, -1)

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
        _, by_point, by_intrinsics = project_in_camera(long.T, self.values)
        # Pixels stay while intrinsics move: dx = -(du/dx)^-1 du/d(intrinsics)
        ideal_by_pixel = np.linalg.inv(np.moveaxis(by_point[:, :2], -1, 0))
        by_pixel = by_ideal @ ideal_by_pixel
        direction = in_camera @ self.X_WC[:3, :3].T
        by_pose = np.zeros((len(ideal), 3, 6))
        by_pose[:, :, :3] = -skew(direction)
        by_inside = -by_pixel @ np.moveaxis(by_intrinsics, -1, 0)
        return Rays(self.X_WC[:3, 3].copy(), direction, by_pixel, by_pose, by_inside)

    def _distorted(self, pixels: NDArray) -> NDArray:
        """Undo the intrinsic matrix. Shape (..., 2) -> (2, ...)."""
        u, v = np.moveaxis(pixels, -1, 0)
        y = (v - self.cy) / self.fy
        return np.stack([(u - self.cx - self.skew * y) / self.fx, y])


def project_in_camera(p_CQ: NDArray, values: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Project points given in the camera's frame; the kernel of every estimator with pixels.

    Args:
        p_CQ: Points with z other than zero [m]. Shape (3, ...).
        values: Intrinsics in the order of `INTRINSICS`. Shape (10,).

    Returns:
        Pixels, shape (2, ...), their derivatives by the point, shape (2, 3, ...), and by the
        intrinsics, shape (2, 10, ...).
    """
    fx, fy, skewness, cx, cy = values[:5]
    k, p = values[5:8], values[8:]
    depth = 1.0 / p_CQ[2]
    ideal = p_CQ[:2] * depth
    x, y = lens.distort(ideal, k, p)
    pixels = np.stack([fx * x + skewness * y + cx, fy * y + cy])
    slopes = lens.distortion_slopes(ideal, k, p)
    shape = ideal.shape[1:]
    # d(u, v)/d(x, y) = K2 distortion', d(x, y)/dX = [1, 0, -x; 0, 1, -y] / Z
    bent = np.stack([fx * slopes[0] + skewness * slopes[1], fy * slopes[1]]) * depth
    by_point = np.empty((2, 3, *shape))
    by_point[:, :2] = bent
    by_point[:, 2] = -(bent[:, 0] * ideal[0] + bent[:, 1] * ideal[1])
    by_values = np.zeros((2, 10, *shape))
    by_values[0, 0], by_values[1, 1], by_values[0, 2] = x, y, y
    by_values[0, 3] = by_values[1, 4] = 1.0
    bends = lens.coefficient_slopes(ideal)
    by_values[0, 5:] = fx * bends[0] + skewness * bends[1]
    by_values[1, 5:] = fy * bends[1]
    return pixels, by_point, by_values


def _points(points: ArrayLike, columns: int, name: str) -> NDArray:
    array = np.asarray(points, dtype=float)
    if array.ndim not in (1, 2) or array.shape[-1] != columns:
        raise ValueError(
            f"{name} must have shape (N, {columns}) or ({columns},), got {array.shape}"
        )
    return array

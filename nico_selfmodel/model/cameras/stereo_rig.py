"""Two cameras as one instrument: project, triangulate, epipolar geometry."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.geometry.epipolar import epipolar_distances, essential, homogeneous
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import project_in_camera
from nico_selfmodel.model.cameras.rig_parameters import (
    SIDES,
    inside_of,
    rig_names,
    rig_units,
    rig_values,
)

_GAUSS_NEWTON_STEPS = 20
_INFINITE = 1e5
"""Distance over the baseline from which a point counts as infinitely far."""


@dataclass(frozen=True, eq=False)
class Triangulation:
    """Points reconstructed from both cameras."""

    p_WQ: NDArray
    """Points [m]; nan where a pixel was, or the rays are parallel. Shape (N, 3)."""
    covariance: NDArray
    """Of each point, carried from the pixels [m^2]. Shape (N, 3, 3)."""
    residuals: NDArray
    """Measured minus reprojected pixels [px]. Shape (N, 4)."""
    in_front: NDArray
    """Whether the point lies in front of both cameras (cheirality). Boolean, shape (N,)."""


@dataclass(frozen=True, eq=False)
class StereoRig:
    """A left and a right camera; pixels are (left u, left v, right u, right v)."""

    left: Camera
    """The left camera."""
    right: Camera
    """The right camera."""

    @property
    def cameras(self) -> tuple[Camera, Camera]:
        """Left and right."""
        return self.left, self.right

    @property
    def X_LR(self) -> NDArray:
        """Pose of the right camera in the left one's frame. Shape (4, 4)."""
        return self.left.X_CW @ self.right.X_WC

    @property
    def baseline(self) -> float:
        """Distance of the two centres [m]."""
        return float(np.linalg.norm(self.X_LR[:3, 3]))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters, in the order of `values`."""
        return rig_names(SIDES, self.lenses)

    @property
    def lenses(self) -> tuple[str, str]:
        """What bends the light of each, of `projection.LENSES`."""
        return self.left.lens, self.right.lens

    @property
    def values(self) -> NDArray:
        """All parameters; of polynomial lenses, shape (26,)."""
        return rig_values(self.cameras)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of `names`."""
        return rig_units(2, self.lenses)

    def with_values(self, values: NDArray) -> "StereoRig":
        """Return the same lenses and images with other `values`, the left camera at the world.

        Args:
            values: Both cameras' intrinsics, then the right one's pose. Shape (26,) of polynomials.

        Raises:
            ValueError: If a focal length is not positive.
        """
        left, right = inside_of(self.lenses)
        X_LR = transform(rotation_from_vector(values[-6:-3]), values[-3:])
        return StereoRig(
            Camera.from_values(values[left], self.left.image_size, lens=self.left.lens),
            Camera.from_values(values[right], self.right.image_size, X_LR, self.right.lens),
        )

    def moved(self, X_WV: ArrayLike) -> "StereoRig":
        """Return the rig seen from another world V, whose pose in W is given. Shape (4, 4)."""
        X_VW = inverse(X_WV)
        return replace(
            self,
            left=self.left.at(X_VW @ self.left.X_WC),
            right=self.right.at(X_VW @ self.right.X_WC),
        )

    def project(self, p_WQ: ArrayLike) -> NDArray:
        """Project points into both cameras; nan where a camera cannot see one.

        Args:
            p_WQ: Points [m]. Shape (N, 3) or (3,).

        Returns:
            Pixels. Shape (N, 4) or (4,).
        """
        return np.concatenate([camera.project(p_WQ) for camera in self.cameras], axis=-1)

    def inside(self, pixels: ArrayLike, margin: float = 0.0) -> NDArray:
        """Return which pixels lie in both images, away from their edges. Shapes (N, 4) -> (N,).

        Args:
            pixels: As `project` has them; nan is outside.
            margin: Least distance from an edge [px].
        """
        far = np.concatenate([camera.image_size for camera in self.cameras]) - 1.0 - margin
        found = np.asarray(pixels, dtype=float)
        return np.asarray(((found >= margin) & (found <= far)).all(axis=1))

    def triangulate(
        self, pixels: ArrayLike, pixel_covariance: ArrayLike | float = 1.0
    ) -> Triangulation:
        """Reconstruct points: linear start, then the optimum of the reprojection error.

        Args:
            pixels: Measured pixels; rows with a nan stay nan. Shape (N, 4).
            pixel_covariance: Standard deviation of a pixel coordinate [px], or covariance of the
                four of a point [px^2]. Shape (), (4, 4) or (N, 4, 4).

        Returns:
            Points with covariance, residuals, and whether they lie in front of both cameras.

        Raises:
            ModelError: If a pixel has no ray.
            ValueError: If the shape is wrong.
        """
        pixels = np.asarray(pixels, dtype=float)
        if pixels.ndim != 2 or pixels.shape[1] != 4:
            raise ValueError(f"pixels must have shape (N, 4), got {pixels.shape}")
        seen = np.asarray(np.isfinite(pixels).all(axis=1))
        start = np.full((len(pixels), 3), np.nan)
        start[seen] = self._triangulate_linearly(pixels[seen])
        seen = np.asarray(np.isfinite(start).all(axis=1))
        weight = _inverse_covariance(pixel_covariance, seen)
        p = self._refine(start[seen], pixels[seen], weight)
        reprojected, slopes = self._project_anywhere(p)
        points, residuals = np.full((len(pixels), 3), np.nan), np.full(pixels.shape, np.nan)
        covariance = np.full((len(pixels), 3, 3), np.nan)
        in_front = np.zeros(len(pixels), dtype=bool)
        points[seen], residuals[seen] = p, pixels[seen] - reprojected
        covariance[seen] = _inverses(np.swapaxes(slopes, 1, 2) @ weight @ slopes)
        points[~np.isfinite(covariance).all(axis=(1, 2))] = np.nan
        in_front[seen] = np.all(
            [apply(camera.X_CW, p)[:, 2] > 0.0 for camera in self.cameras], axis=0
        )
        return Triangulation(points, covariance, residuals, in_front)

    def _refine(self, p: NDArray, pixels: NDArray, weight: NDArray) -> NDArray:
        """Minimise the reprojection error of each point by Gauss-Newton. Shape (n, 3)."""
        for _ in range(_GAUSS_NEWTON_STEPS):
            reprojected, slopes = self._project_anywhere(p)
            weighted = np.swapaxes(slopes, 1, 2) @ weight
            miss = (pixels - reprojected)[:, :, None]
            step = (_inverses(weighted @ slopes) @ (weighted @ miss))[:, :, 0]
            p = p + step
            size = np.linalg.norm(step, axis=1)
            if not (size > 1e-12 * np.linalg.norm(p, axis=1)).any():
                break
        return p

    def essential(self) -> NDArray:
        """Return E with x_R' E x_L = 0 for ideal coordinates. Shape (3, 3)."""
        X_RL = inverse(self.X_LR)
        return essential(X_RL[:3, :3], X_RL[:3, 3])

    def fundamental(self) -> NDArray:
        """Return F = K_R^-T E K_L^-1 for undistorted pixels; thesis eq. 5.15, put right."""
        return np.linalg.inv(self.right.K).T @ self.essential() @ np.linalg.inv(self.left.K)

    def undistorted_pixels(self, pixels: ArrayLike) -> NDArray:
        """Return where pinhole cameras would see the same rays. Shape (N, 4) -> (N, 4)."""
        pixels = np.asarray(pixels, dtype=float)
        return np.concatenate(
            [
                homogeneous(camera.undistort(pixels[:, columns])) @ camera.K[:2].T
                for camera, columns in zip(self.cameras, (slice(0, 2), slice(2, 4)), strict=True)
            ],
            axis=1,
        )

    def epipolar_errors(self, pixels: ArrayLike) -> NDArray:
        """Return distances of undistorted pixels from the other camera's epipolar lines [px].

        Args:
            pixels: Shape (N, 4).

        Returns:
            In the left and in the right image. Shape (N, 2).
        """
        points = self.undistorted_pixels(pixels)
        return epipolar_distances(self.fundamental(), points[:, :2], points[:, 2:])

    def _triangulate_linearly(self, pixels: NDArray) -> NDArray:
        """Solve x (P3 q) = P1 q, y (P3 q) = P2 q for homogeneous q by SVD, both cameras at once."""
        rows = []
        for camera, columns in zip(self.cameras, (slice(0, 2), slice(2, 4)), strict=True):
            ideal = camera.undistort(pixels[:, columns])
            matrix = camera.X_CW[:3]
            rows.append(ideal[:, :, None] * matrix[2] - matrix[:2])
        _, _, vt = np.linalg.svd(np.concatenate(rows, axis=1))
        far, near = np.linalg.norm(vt[:, 3, :3], axis=1), np.abs(vt[:, 3, 3])
        finite = far < _INFINITE * self.baseline * near
        return vt[:, 3, :3] / np.where(finite, vt[:, 3, 3], np.nan)[:, None]

    def _project_anywhere(self, p_WQ: NDArray) -> tuple[NDArray, NDArray]:
        """Project without asking for cheirality. Shapes (N, 4) and (N, 4, 3)."""
        pixels, slopes = [], []
        for camera in self.cameras:
            at, by_point, _ = project_in_camera(
                apply(camera.X_CW, p_WQ).T, camera.values, camera.lens
            )
            pixels.append(at.T)
            slopes.append(np.einsum("abn,bc->nac", by_point, camera.X_CW[:3, :3]))
        return np.concatenate(pixels, axis=1), np.concatenate(slopes, axis=1)


def _inverses(matrices: NDArray) -> NDArray:
    """Invert matrices one by one where it can be done; nan where sights run apart."""
    try:
        return np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        regular = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
        regular[regular] = np.linalg.matrix_rank(matrices[regular]) == 3
        found = np.full_like(matrices, np.nan)
        found[regular] = np.linalg.inv(matrices[regular])
        return found


def _inverse_covariance(covariance: ArrayLike | float, seen: NDArray) -> NDArray:
    """Return the weight matrix of each seen point. Shape (n, 4, 4)."""
    covariance = np.asarray(covariance, dtype=float)
    if covariance.ndim == 0:
        if not covariance > 0.0:
            raise ValueError(f"a pixel's standard deviation must be positive, got {covariance}")
        covariance = covariance**2 * np.eye(4)
    if covariance.shape not in ((4, 4), (len(seen), 4, 4)):
        raise ValueError(
            f"pixel_covariance must be a number, (4, 4) or ({len(seen)}, 4, 4), "
            f"got {covariance.shape}"
        )
    return np.linalg.inv(np.broadcast_to(covariance, (len(seen), 4, 4))[seen])

"""Reprojection errors of board corners in one or more cameras, with derivatives.

A corner p_GQ of view v lies at p_LQ = R_v p_GQ + t_v in the frame of the first camera, L; another
one, R, sees it at p_RQ = R_LR' (p_LQ - p_LR). Pixels follow by `project_in_camera`.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vector_slope
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.arm.line_kinematics import cross
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import POLYNOMIAL, intrinsics_of, project_in_camera
from nico_selfmodel.model.cameras.rig_parameters import (
    POSE_NAMES,
    Lenses,
    each_lens,
    rig_names,
    rig_values,
)
from nico_selfmodel.optimization.residual_block import forget_last, remembers_last
from nico_selfmodel.optimization.separable_block import Parts, SeparableBlock

_AHEAD = np.array([0.0, 0.0, 1.0]).reshape(3, 1, 1)
"""A point that every camera can project."""


class BoardResiduals(SeparableBlock):
    """Pixels of all corners; shared: the cameras; own: the pose of each view's board."""

    own = 6

    def __init__(
        self,
        views: BoardViews,
        X_LG: NDArray,
        sigma: float,
        aspect: float | None = None,
        lens: Lenses = POLYNOMIAL,
    ) -> None:
        """Take the data.

        Args:
            X_LG: Poses of the boards about which they are parameterised. Shape (V, 4, 4).
            sigma: Standard deviation of a pixel coordinate [px].
            aspect: Hold fy / fx at this ratio; `fy` is no variable then.
            lens: Of all cameras, or one each.
        """
        self.views, self.sigma, self.aspect = views, sigma, aspect
        self.lenses = each_lens(lens, len(views.cameras))
        self.rotations = np.array(X_LG)[:, :3, :3]
        self._spreads = [_spread(len(intrinsics_of(own)), aspect) for own in self.lenses]
        ends = np.cumsum([0, *(spread.shape[1] for spread in self._spreads)]).tolist()
        self._columns, self._inside = [slice(a, b) for a, b in pairwise(ends)], ends[-1]
        names = rig_names(views.cameras, self.lenses)
        self.shared_names = tuple(n for n in names if aspect is None or not n.endswith(".fy"))
        boards = tuple(f"board.{view}.{n}" for view in views.names for n in POSE_NAMES)
        self.names = self.shared_names + boards
        self._corners = views.p_GQ.T
        cameras = views.pixels.reshape(len(views), len(views.p_GQ), len(views.cameras), 2)
        self._measured = np.nan_to_num(np.transpose(cameras, (2, 3, 0, 1)))
        self._seen = np.moveaxis(views.seen, 1, 0).astype(float)
        self._missed = [~seen.any(axis=1) for seen in np.moveaxis(views.seen, 1, 0)]

    @property
    def sigma(self) -> float:
        """Standard deviation of a pixel coordinate, which may be another one later [px]."""
        return self._sigma

    @sigma.setter
    def sigma(self, sigma: float) -> None:
        """Take another one."""
        self._sigma = sigma
        forget_last(self)

    @property
    def observation_count(self) -> int:
        """Number of views."""
        return len(self.views)

    def cameras(self, x: NDArray) -> tuple[Camera, ...]:
        """Return the cameras that the shared variables describe, the first one at the world."""
        return tuple(
            Camera.from_values(self._values_of(x, e), size, self._pose_of(x, e), self.lenses[e])
            for e, size in enumerate(self.views.image_sizes)
        )

    def board_poses(self, x: NDArray) -> NDArray:
        """Return the poses of the boards. Shape (V, 4, 4)."""
        own = x[len(self.shared_names) :].reshape(-1, 6)
        return transform(rotation_from_vector(own[:, :3]) @ self.rotations, own[:, 3:])

    def start_of(self, cameras: tuple[Camera, ...], X_LG: NDArray) -> NDArray:
        """Return the variables of given cameras and boards; rotations are those given first."""
        names = rig_names(self.views.cameras, self.lenses)
        keep = [i for i, n in enumerate(names) if self.aspect is None or not n.endswith(".fy")]
        own = np.concatenate([np.zeros((len(X_LG), 3)), X_LG[:, :3, 3]], axis=1)
        return np.concatenate([rig_values(cameras)[keep], own.ravel()])

    @remembers_last
    def evaluate_parts(self, x: NDArray) -> Parts:
        """Return residuals (predicted - measured) / sigma and derivatives; see `SeparableBlock`."""
        # Indices: a of u and v, i of x, y and z, v of a view, p of a corner.
        own = x[len(self.shared_names) :].reshape(-1, 6)
        turned = (rotation_from_vector(own[:, :3]) @ self.rotations) @ self._corners
        turned = np.ascontiguousarray(np.moveaxis(turned, 1, 0))
        p_LQ = turned + own[:, 3:].T[:, :, None]
        slope = np.swapaxes(rotation_vector_slope(own[:, :3]), 1, 2)
        views, corners, cameras = len(own), turned.shape[2], len(self.views.cameras)
        r = np.empty((views, cameras, 2, corners))
        by_shared = np.zeros((views, len(self.shared_names), cameras, 2, corners))
        by_own = np.empty((views, 6, cameras, 2, corners))
        for e in range(cameras):
            weight = self._seen[e] / self.sigma
            pixels, by_point, by_values = self._project(x, e, p_LQ)
            by_point *= weight
            r[:, e] = np.moveaxis((pixels - self._measured[e]) * weight, 1, 0)
            by_shared[:, self._columns[e], e] = np.moveaxis(by_values * weight, 2, 0)
            if e > 0:
                by_pose = _by_pose(x[self._pose_columns(e)], p_LQ, by_point)
                by_shared[:, self._pose_columns(e), e] = np.moveaxis(by_pose, 2, 0)
            # a . (w x q) = (q x a) . w: how a pixel moves when the board turns by w
            about = np.moveaxis(cross(turned[:, None], by_point), 2, 0)
            by_own[:, :3, e] = (slope @ about.reshape(views, 3, -1)).reshape(about.shape)
            by_own[:, 3:, e] = np.moveaxis(by_point, 2, 0)
        shape = (views, -1, cameras * 2 * corners)
        return r.reshape(views, -1), by_shared.reshape(shape), by_own.reshape(shape)

    def _project(self, x: NDArray, camera: int, p_LQ: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Return pixels (2, V, P), derivatives by p_LQ (3, 2, V, P) and by its own (s, 2, V, P)."""
        values = self._values_of(x, camera)
        X_LR = self._pose_of(x, camera)
        p_RQ = _turn(X_LR[:3, :3].T, p_LQ - X_LR[:3, 3, None, None]) if camera else p_LQ
        if self._missed[camera].any():
            # Boards beside or behind a camera have no pixels, and count for nothing.
            p_RQ = np.where(self._missed[camera][:, None], _AHEAD, p_RQ)
        pixels, by_point, by_values = project_in_camera(p_RQ, values, self.lenses[camera])
        by_point = by_point.swapaxes(0, 1)
        if camera:
            by_point = _turn(X_LR[:3, :3], by_point)
        by_values = by_values.swapaxes(0, 1)
        if self.aspect is not None:
            by_values = _turn(self._spreads[camera].T, by_values)
        return pixels, by_point.copy(), by_values

    def pixel_residuals(self, r: NDArray) -> NDArray:
        """Return measured minus predicted pixels, nan where not seen, from residuals (V, k).

        Shape (V, P, 2 C).
        """
        r = -self.sigma * r
        shape = (len(self.views), len(self.views.cameras), 2, len(self.views.p_GQ))
        flat = np.transpose(r.reshape(shape), (0, 3, 1, 2)).reshape(self.views.pixels.shape)
        return np.where(np.isfinite(self.views.pixels), flat, np.nan)

    def _values_of(self, x: NDArray, camera: int) -> NDArray:
        """Return one camera's intrinsics. Shape (c,)."""
        return np.asarray(self._spreads[camera] @ x[self._columns[camera]])

    def _pose_columns(self, camera: int) -> slice:
        """Return where the pose of a camera other than the first stands among the variables."""
        first = self._inside + 6 * (camera - 1)
        return slice(first, first + 6)

    def _pose_of(self, x: NDArray, camera: int) -> NDArray:
        """Return X_LR of a camera; of the first the identity. Shape (4, 4)."""
        if camera == 0:
            return np.eye(4)
        pose = x[self._pose_columns(camera)]
        return transform(rotation_from_vector(pose[:3]), pose[3:])


def _spread(count: int, aspect: float | None) -> NDArray:
    """Return what a camera's variables make of its intrinsics: fy follows where it is held."""
    spread = np.eye(count)
    if aspect is None:
        return spread
    spread[1, 0] = aspect
    return np.delete(spread, 1, axis=1)


def _by_pose(pose: NDArray, p_LQ: NDArray, by_point: NDArray) -> NDArray:
    """Return derivatives by (w, t) of X_LR, with p_RQ = R' exp(-[w]) (p_LQ - p_LR - t)."""
    about = cross(by_point, (p_LQ - pose[3:, None, None])[:, None])
    slope = rotation_vector_slope(pose[:3])
    return np.concatenate([_turn(slope.T, about), -by_point])


def _turn(matrix: NDArray, vectors: NDArray) -> NDArray:
    """Multiply along the first axis. Shapes (m, n) and (n, ...) -> (m, ...)."""
    return (matrix @ vectors.reshape(len(vectors), -1)).reshape(len(matrix), *vectors.shape[1:])

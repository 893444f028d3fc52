"""Reprojection errors of boards seen directly and in mirrors by one camera, with derivatives.

A corner p_GQ of photograph v lies at p_LQ = R_v p_GQ + t_v before the camera, its reflection in
mirror m at S_m p_LQ - 2 d_m n_m. Both are seen through the same lens.
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.mirrored_boards import MirroredBoards
from nico_selfmodel.geometry.reflection import reflect, reflection_slopes
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vector_slope, skew
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.mirror import Mirror, plane_of_values
from nico_selfmodel.model.cameras.projection import INTRINSICS, project_in_camera
from nico_selfmodel.model.cameras.rig_parameters import POSE_NAMES
from nico_selfmodel.optimization.separable_block import Parts, SeparableBlock


class BoardMirrorResiduals(SeparableBlock):
    """Pixels of all corners; shared: the lens and the mirrors; own: the pose of each board."""

    own = 6

    def __init__(self, boards: MirroredBoards, X_LG: NDArray, sigma: float = 1.0) -> None:
        """Take the data.

        Args:
            boards: Corners seen.
            X_LG: Poses of the boards about which they are parameterised. Shape (V, 4, 4).
            sigma: Standard deviation of a pixel coordinate [px].
        """
        self.boards, self.sigma = boards, sigma
        self.rotations = np.array(X_LG)[:, :3, :3]
        self.camera_names = tuple(f"{boards.camera}.{name}" for name in INTRINSICS)
        planes = tuple(n for mirror in boards.mirrors for n in Mirror.names_of(mirror))
        self.shared_names = self.camera_names + planes
        own = tuple(f"board.{view}.{n}" for view in boards.names for n in POSE_NAMES)
        self.names = self.shared_names + own
        self._measured = np.nan_to_num(boards.pixels)
        self._weight = boards.seen / sigma

    @property
    def observation_count(self) -> int:
        """Number of photographs."""
        return len(self.boards)

    def camera(self, x: NDArray) -> Camera:
        """Return the camera that the shared variables describe, at the world."""
        return Camera.from_values(x[: len(INTRINSICS)], self.boards.image_size)

    def planes(self, x: NDArray) -> NDArray:
        """Return `Mirror.values` of every mirror. Shape (M, 3)."""
        return x[len(INTRINSICS) : len(self.shared_names)].reshape(-1, 3)

    def board_poses(self, x: NDArray) -> NDArray:
        """Return the poses of the boards. Shape (V, 4, 4)."""
        own = x[len(self.shared_names) :].reshape(-1, 6)
        return transform(rotation_from_vector(own[:, :3]) @ self.rotations, own[:, 3:])

    def start_of(self, camera: Camera, mirrors: tuple[Mirror, ...], X_LG: NDArray) -> NDArray:
        """Return the variables of a camera, mirrors and boards; rotations are those given first."""
        own = np.concatenate([np.zeros((len(X_LG), 3)), X_LG[:, :3, 3]], axis=1)
        return np.concatenate([camera.values, *(m.values for m in mirrors), own.ravel()])

    def evaluate_parts(self, x: NDArray) -> Parts:
        """Return residuals (predicted - measured) / sigma and derivatives; see `SeparableBlock`."""
        # Indices: v of a photograph, w of a way it was seen, p of a corner, a of u and v.
        own = x[len(self.shared_names) :].reshape(-1, 6)
        turned = self.boards.p_GQ @ np.swapaxes(self.board_poses(x)[:, :3, :3], 1, 2)
        p_LQ = turned + own[:, None, 3:]
        views, corners = p_LQ.shape[:2]
        ways = 1 + len(self.boards.mirrors)
        r = np.empty((views, ways, corners, 2))
        by_shared = np.zeros((views, ways, corners, 2, len(self.shared_names)))
        by_own = np.empty((views, ways, corners, 2, 6))
        by_turn = -skew(turned) @ rotation_vector_slope(own[:, None, :3])
        for way in range(ways):
            pixels, by_point, by_lens, by_plane = self._seen(x, way, p_LQ.reshape(-1, 3))
            shape = (views, corners, 2)
            r[:, way] = pixels.reshape(shape) - self._measured[:, way]
            by_shared[:, way, :, :, : len(INTRINSICS)] = by_lens.reshape(*shape, -1)
            if way:
                column = len(INTRINSICS) + 3 * (way - 1)
                by_shared[:, way, :, :, column : column + 3] = by_plane.reshape(*shape, 3)
            by_point = by_point.reshape(*shape, 3)
            by_own[:, way, :, :, :3] = by_point @ by_turn
            by_own[:, way, :, :, 3:] = by_point
        weight = self._weight[..., None]
        flat = (views, ways * corners * 2)
        by_shared = (by_shared * weight[..., None]).reshape(*flat, -1)
        by_own = (by_own * weight[..., None]).reshape(*flat, 6)
        return (r * weight).reshape(flat), np.swapaxes(by_shared, 1, 2), np.swapaxes(by_own, 1, 2)

    def pixel_residuals(self, r: NDArray) -> NDArray:
        """Return measured minus predicted pixels, nan where not seen, from residuals (V, k).

        Shape (V, 1 + M, P, 2).
        """
        pixels = -self.sigma * r.reshape(self.boards.pixels.shape)
        return np.where(np.isfinite(self.boards.pixels), pixels, np.nan)

    def _seen(
        self, x: NDArray, way: int, p_LQ: NDArray
    ) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Return pixels and derivatives by point, lens and plane, of corners seen one way."""
        values, by_plane = x[: len(INTRINSICS)], np.zeros((len(p_LQ), 2, 3))
        if not way:
            pixels, by_point, by_lens = project_in_camera(p_LQ.T, values)
            by_point = np.moveaxis(by_point, -1, 0)
            return pixels.T, by_point, np.moveaxis(by_lens, -1, 0), by_plane
        plane, by_values = plane_of_values(self.planes(x)[way - 1])
        pixels, by_point, by_lens = project_in_camera(reflect(plane, p_LQ).T, values)
        by_point = np.moveaxis(by_point, -1, 0)
        by_plane = by_point @ (reflection_slopes(plane, p_LQ) @ by_values)
        turned = by_point - 2.0 * (by_point @ plane.normal)[:, :, None] * plane.normal
        return pixels.T, turned, np.moveaxis(by_lens, -1, 0), by_plane

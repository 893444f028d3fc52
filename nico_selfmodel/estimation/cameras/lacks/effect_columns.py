"""Derivatives of all pixels by what boards and cameras may do that the model does not have.

With J_q the derivative of a corner's pixels by its place p_LQ in the frame of the first camera:

    board of another shape     J_q R_v d(q)        d what its corner q is moved by on the board
    camera c moved             J_q (w x (p_LQ - p_LC) + t)    in that camera alone
    camera c zoomed            f dpixels/df        f of both directions at once

Each is a column beside those of the adjustment; where something changed half-way, of the views from
there on.
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.cameras.board_residuals import BoardResiduals
from nico_selfmodel.estimation.cameras.camera_adjustment import CameraCalibration
from nico_selfmodel.model.arm.line_kinematics import cross
from nico_selfmodel.optimization.separable_block import Parts


class EffectColumns:
    """Columns at one solution, each of shape (V, m, k) beside those of `BoardResiduals`."""

    def __init__(self, calibration: CameraCalibration, block: BoardResiduals, parts: Parts) -> None:
        """Take the solution.

        Args:
            block: Of its residuals.
            parts: What that says at the solution.
        """
        self._calibration, self._block, self._by_shared = calibration, block, parts[1]
        views = calibration.views
        # By the shift of a board, which is by the place of each of its corners.
        shape = (len(views), 3, len(views.cameras), 2, len(views.p_GQ))
        self._by_place = parts[2][:, 3:].reshape(shape)
        self._turns = calibration.X_LG[:, :3, :3]
        self._middle = 0.5 * (views.p_GQ.max(axis=0) + views.p_GQ.min(axis=0))
        self.on_board = views.p_GQ - self._middle

    def stretch(self) -> NDArray:
        """By the length of the board in x over that in y. Shape (V, 1, k)."""
        x, y, z = self.on_board.T
        return self._moved([[0.5 * x, -0.5 * y, 0.0 * z]])

    def skew(self) -> NDArray:
        """By the angle that its rows and columns have less than a right one. Shape (V, 1, k)."""
        x, y, z = self.on_board.T
        return self._moved([[0.5 * y, 0.5 * x, 0.0 * z]])

    def bend(self) -> NDArray:
        """By z = a x^2 + b x y + c y^2 of the board, of x and y in half its length. (V, 3, k)."""
        none = np.zeros(len(self.on_board))
        return self._moved([[none, none, z] for z in self.bends()])

    def bends(self) -> NDArray:
        """Return how far out of the plane each number of `bend` puts corners. Shape (3, P)."""
        x, y, _ = self.on_board.T / np.abs(self.on_board).max()
        return np.stack([x * x, x * y, y * y])

    def camera_moved(self, camera: int) -> NDArray:
        """By how what one camera sees turns about it, and is shifted. Shape (V, 6, k)."""
        X_LG = self._calibration.X_LG
        p_LQ = self._calibration.views.p_GQ @ np.swapaxes(self._turns, 1, 2) + X_LG[:, None, :3, 3]
        shift = np.zeros_like(self._by_place)
        shift[:, :, camera] = self._by_place[:, :, camera]
        # a . (w x q) = (q x a) . w
        out = np.transpose(p_LQ - self._centre(camera), (2, 0, 1))[:, :, None, None]
        turn = np.moveaxis(cross(out, np.moveaxis(shift, 1, 0)), 0, 1)
        return self._flat(np.concatenate([turn, shift], axis=1))

    def board_shift(self, camera: int, view: int, e: NDArray) -> float:
        """Return how far numbers (6,) of `camera_moved` shift the middle of a board [m]."""
        p_LG = self._turns[view] @ self._middle + self._calibration.X_LG[view, :3, 3]
        return float(np.linalg.norm(np.cross(e[:3], p_LG - self._centre(camera)) + e[3:]))

    def camera_zoomed(self, camera: int) -> NDArray:
        """By the focal length of one camera, as a share of it. Shape (V, 1, k)."""
        name, own = self._calibration.views.cameras[camera], self._calibration.cameras[camera]
        names = self._block.shared_names
        focal = [(f"{name}.fx", own.fx), (f"{name}.fy", own.fy)]
        by_focal = [f * self._by_shared[:, names.index(n)] for n, f in focal if n in names]
        return np.asarray(sum(by_focal))[:, None]

    def _centre(self, camera: int) -> NDArray:
        """Return p_LC of a camera [m]. Shape (3,)."""
        cameras = self._calibration.cameras
        return np.asarray((cameras[0].X_CW @ cameras[camera].X_WC)[:3, 3])

    def _moved(self, fields: list[list[NDArray]]) -> NDArray:
        """Return what corners that are moved on the board do to pixels.

        Args:
            fields: Of each column x, y and z by which corners are moved [m]. Shapes (P,).
        """
        away = np.einsum("vij,mjp->vmip", self._turns, np.array(fields))
        return self._flat(np.einsum("vmip,vicap->vmcap", away, self._by_place))

    def _flat(self, columns: NDArray) -> NDArray:
        return columns.reshape(*columns.shape[:2], -1)

"""Residuals of the hand, row by row, over the parameters of a body by name (thesis eq. 8.8).

Of pixels the world is the left camera's frame: it carries the image, the right one stands in it,
and the arm is expressed in it. The thesis' sum misses its square, its two cameras and their lenses.
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.observations.pixel_observations import PixelObservations
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vector_slope
from nico_selfmodel.model.arm.dh_parameters import DhParameters, slopes_by_angle
from nico_selfmodel.model.arm.line_kinematics import cross
from nico_selfmodel.model.cameras.projection import POLYNOMIAL, project_in_camera
from nico_selfmodel.model.cameras.rig_parameters import (
    SIDES,
    Lenses,
    each_lens,
    inside_of,
    rig_names,
)


class HandRows:
    """W (predicted - measured) of every row, whatever measured the hand.

    Attributes:
        rows: Encoder angles and tracked points.
        names: Variables: of the arm, then of what sees it.
        measured: Coordinates, zero where not seen. Shape (k, N).
        seen: Which of them were measured. Boolean, shape (N, k).
        whitening: Of the rows, zero where not seen. Shape (N, k, k).
    """

    def __init__(
        self,
        rows: Observations,
        arm: DhParameters,
        names: tuple[str, ...],
        measured: NDArray,
        seen: NDArray,
    ) -> None:
        """Take the data.

        Args:
            rows: Encoder angles and tracked points.
            arm: Table and servos at the start.
            names: Variables.
            measured: nan where not seen. Shape (N, k).
            seen: Boolean, shape (N, k).
        """
        self.rows, self._arm, self.names, self.seen = rows, arm, names, seen
        self._split = len(arm.names)
        self.measured = np.ascontiguousarray(np.nan_to_num(measured).T)
        self.whiten(np.eye(measured.shape[1]) * seen[:, :, None])

    def whiten(self, whitening: NDArray) -> None:
        """Replace the whitening of the rows. Shape (N, k, k)."""
        self.whitening = np.ascontiguousarray(whitening)
        self._plain = bool((whitening == np.eye(whitening.shape[2])).all())

    def evaluate(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return whitened residuals, shape (k, N), and derivatives, shape (P, k, N)."""
        predicted, jacobian = self.project(x)
        r = predicted - self.measured
        if self._plain:
            return r, jacobian
        # Rows last, as everything else; one product per row: its whitening times residual and
        # derivatives side by side.
        both = np.concatenate([r[None], jacobian]).transpose(2, 1, 0)
        whitened = np.ascontiguousarray((self.whitening @ both).transpose(2, 1, 0))
        return whitened[0], whitened[1:]

    def project(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return predicted coordinates, shape (k, N), and their derivatives, shape (P, k, N)."""
        raise NotImplementedError

    def by_angle(self, x: NDArray) -> NDArray:
        """Return the derivatives of each row's coordinates by the joint angles. Shape (N, k, n)."""
        arm = self._arm.with_values(x[: self._split])
        return slopes_by_angle(arm, self.rows.predicted(arm)[1])

    def _points(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return tracked points, shape (3, N), and derivatives by the arm, shape (P_arm, 3, N)."""
        p, jacobian = self.rows.predicted(self._arm.with_values(x[: self._split]))
        return p.T, np.transpose(jacobian, (2, 1, 0))


class HandPoints(HandRows):
    """Residuals of measured points, over an arm [m]."""

    def __init__(self, observations: Observations, arm: DhParameters) -> None:
        """Take the data.

        Args:
            observations: Where the hand was measured.
            arm: Table and servos at the start.
        """
        seen = np.ones((len(observations), 3), dtype=bool)
        super().__init__(observations, arm, arm.names, observations.p_WH, seen)

    def project(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return predicted points, shape (3, N), and their derivatives, shape (P, 3, N)."""
        return self._points(x)


class HandPixels(HandRows):
    """Residuals of the hand's pixels, over an arm and both cameras [px]."""

    def __init__(
        self, observations: PixelObservations, arm: DhParameters, lens: Lenses = POLYNOMIAL
    ) -> None:
        """Take the data.

        Args:
            observations: Where the cameras saw the hand.
            arm: Table and servos at the start.
            lens: Of both cameras, or one each.
        """
        names = (*arm.names, *rig_names(SIDES, lens))
        super().__init__(observations.arm, arm, names, observations.pixels, observations.seen)
        self._lens = lens

    def by_angle(self, x: NDArray) -> NDArray:
        """Return the derivatives of each row's pixels by the joint angles. Shape (N, 4, n)."""
        by_point = project_to_cameras(self._points(x)[0], x[self._split :], self._lens)[1]
        return np.einsum("ain,nij->naj", by_point, super().by_angle(x))

    def project(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return predicted pixels, shape (4, N), and their derivatives, shape (P, 4, N)."""
        split = self._split
        p, by_arm = self._points(x)
        pixels, by_point, by_cameras = project_to_cameras(p, x[split:], self._lens)
        jacobian = np.empty((len(self.names), 4, p.shape[1]))
        # d(pixel)/d(arm) = d(pixel)/d(p) d(p)/d(arm)
        part = jacobian[:split]
        np.multiply(by_arm[:, None, 0], by_point[:, 0], out=part)
        part += by_arm[:, None, 1] * by_point[:, 1]
        part += by_arm[:, None, 2] * by_point[:, 2]
        jacobian[split:] = by_cameras
        return pixels, jacobian


def project_to_cameras(
    p_LH: NDArray, cameras: NDArray, lens: Lenses = POLYNOMIAL
) -> tuple[NDArray, NDArray, NDArray]:
    """Project points of the left camera's frame into both cameras, with derivatives.

    Args:
        p_LH: Points [m]. Shape (3, N).
        cameras: Values of `StereoRig.names`: both insides, and the right camera's pose; of
            polynomial lenses, shape (26,).
        lens: Of both cameras, or one each.

    Returns:
        Pixels, shape (4, N), derivatives by the point, shape (4, 3, N), and by the cameras, shape
        (26, 4, N).
    """
    (of_left, of_right), in_left, in_right = each_lens(lens, 2), *inside_of(lens)
    left, right, turn, place = np.split(cameras, [in_left.stop, in_right.stop, in_right.stop + 3])
    rotation = rotation_from_vector(turn)
    away = p_LH - place[:, None]
    pixels = np.empty((4, p_LH.shape[1]))
    by_point = np.empty((4, 3, p_LH.shape[1]))
    by_cameras = np.zeros((len(cameras), 4, p_LH.shape[1]))
    pixels[:2], by_point[:2], by_left = project_in_camera(p_LH, left, of_left)
    by_cameras[in_left, :2] = by_left.swapaxes(0, 1)
    pixels[2:], by_p_R, by_right = project_in_camera(rotation.T @ away, right, of_right)
    by_cameras[in_right, 2:] = by_right.swapaxes(0, 1)
    # p_R = R' exp(-[w]) (p - t - dt): d/dp = R', d/dw = R' [p - t]x, d/dt = -R'
    by_point[2:] = np.einsum("ij,ajn->ain", rotation, by_p_R)
    about = cross(by_point[2:].swapaxes(0, 1), away[:, None])
    by_cameras[-6:-3, 2:] = np.einsum("ij,ian->jan", rotation_vector_slope(turn), about)
    by_cameras[-3:, 2:] = -by_point[2:].swapaxes(0, 1)
    return pixels, by_point, by_cameras

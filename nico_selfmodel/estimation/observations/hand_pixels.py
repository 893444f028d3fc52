"""Residuals of the hand's pixels in both cameras, over the arm and the cameras (thesis eq. 8.8).

The world is the left camera's frame: it carries the image, the right one stands in it, and the arm
is expressed in it. The thesis' sum misses its square, its two cameras and their lenses.
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.observations.arm_views import ArmView
from nico_selfmodel.estimation.observations.pixel_observations import PixelObservations
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vector_slope
from nico_selfmodel.model.arm.line_kinematics import cross
from nico_selfmodel.model.cameras.projection import POLYNOMIAL, project_in_camera
from nico_selfmodel.model.cameras.rig_parameters import (
    SIDES,
    Lenses,
    each_lens,
    inside_of,
    rig_names,
)


class HandPixels:
    """W (predicted - measured) pixels of every row, over an arm and both cameras.

    Attributes:
        names: Variables of the arm, then those of the cameras.
        measured: Pixels, zero where not seen. Shape (4, N).
        whitening: Of the rows, zero where not seen. Shape (N, 4, 4).
    """

    def __init__(
        self,
        observations: PixelObservations,
        arm: ArmView,
        whitening: NDArray | None = None,
        lens: Lenses = POLYNOMIAL,
    ) -> None:
        """Take the data.

        Args:
            observations: Where the cameras saw the hand.
            arm: How the arm is written down.
            whitening: Of each row's pixels, zero where not seen (`HandNoise.whitening`); one
                pixel each if omitted. Shape (N, 4, 4).
            lens: Of both cameras, or one each.
        """
        self.observations, self.arm, self.lens = observations, arm, lens
        self.names = (*arm.names, *rig_names(SIDES, lens))
        self.measured = np.ascontiguousarray(np.nan_to_num(observations.pixels).T)
        self.whiten(np.eye(4) * observations.seen[:, :, None] if whitening is None else whitening)

    @property
    def seen(self) -> NDArray:
        """Which coordinates were measured. Boolean, shape (N, 4)."""
        return self.observations.seen

    def whiten(self, whitening: NDArray) -> None:
        """Replace the whitening of the rows. Shape (N, 4, 4)."""
        self.whitening = np.ascontiguousarray(whitening)
        # Rows last, as everything else; the transpose serves residuals and derivatives at once.
        self._plain = bool((whitening == np.eye(4)).all())

    def evaluate(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return whitened residuals, shape (4, N), and derivatives, shape (P, 4, N)."""
        pixels, jacobian = self.project(x)
        r = pixels - self.measured
        if self._plain:
            return r, jacobian
        # One product per row: its whitening times residual and derivatives side by side.
        both = np.concatenate([r[None], jacobian]).transpose(2, 1, 0)
        whitened = np.ascontiguousarray((self.whitening @ both).transpose(2, 1, 0))
        return whitened[0], whitened[1:]

    def by_angle(self, x: NDArray) -> NDArray:
        """Return the derivatives of each row's pixels by the joint angles. Shape (N, 4, n)."""
        split = len(self.arm.names)
        by_point = project_to_cameras(self.arm.evaluate(x[:split])[0], x[split:], self.lens)[1]
        return np.einsum("ain,ijn->naj", by_point, self.arm.by_angle(x[:split]))

    def project(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return predicted pixels, shape (4, N), and their derivatives, shape (P, 4, N)."""
        split = len(self.arm.names)
        p, by_arm = self.arm.evaluate(x[:split])
        pixels, by_point, by_cameras = project_to_cameras(p, x[split:], self.lens)
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
    (of_left, of_right), in_left, in_right = each_lens(lens, 2), *inside_of(lens, 2)
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

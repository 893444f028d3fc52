"""Reprojection errors of reflections over the planes of mirrors, and what whitens them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.mirrors.reflections import ReflectionNoise, Reflections
from nico_selfmodel.estimation.noise import hand_noise
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.rotation import rotation_vector_of, rotation_vector_slope
from nico_selfmodel.model.cameras.mirror import Mirror, plane_of_values
from nico_selfmodel.model.cameras.mirror_rig import ReflectedProjection, reflected_projection
from nico_selfmodel.model.cameras.projection import intrinsics_of
from nico_selfmodel.model.cameras.rig_parameters import POSE_NAMES
from nico_selfmodel.model.cameras.stereo_rig import StereoRig


class ReflectionResiduals:
    """W (predicted - measured) pixels of every row, over three parameters a mirror.

    Both cameras share each plane, which the thesis left to future work (section 9.2.2).
    """

    def __init__(self, reflections: Reflections, whitening: NDArray) -> None:
        """Take the data.

        Args:
            whitening: Of each row's pixels, zero where not seen. Shape (N, 2 C, 2 C).
        """
        self.reflections = reflections
        self.names = tuple(n for mirror in reflections.mirrors for n in Mirror.names_of(mirror))
        self.whiten(whitening)
        self._measured = np.nan_to_num(reflections.pixels)
        self._own = [reflections.mirror == m for m in range(len(reflections.mirrors))]

    def whiten(self, whitening: NDArray) -> None:
        """Replace the whitening of the rows. Shape (N, 2 C, 2 C)."""
        self.whitening = whitening
        self._last: tuple[bytes, tuple[NDArray, NDArray]] | None = None

    def evaluate(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return whitened residuals, shape (2 C, N), and derivatives, shape (3 M, 2 C, N)."""
        # A robust solution asks for scale and outliers where its solver has just been.
        key = np.asarray(x).tobytes()
        if self._last is None or self._last[0] != key:
            self._last = (key, self._evaluate(x))
        return self._last[1]

    def _evaluate(self, x: NDArray) -> tuple[NDArray, NDArray]:
        shown = project_reflections(self.reflections, x)
        # One product a row: its whitening times residual and derivatives side by side.
        both = np.concatenate(
            [(shown.pixels - self._measured)[:, :, None], shown.by_mirror], axis=2
        )
        whitened = (self.whitening @ both).transpose(2, 1, 0)
        jacobian = np.zeros((len(self.names), *whitened.shape[1:]))
        for m, own in enumerate(self._own):
            jacobian[3 * m : 3 * m + 3][:, :, own] = whitened[1:, :, own]
        return whitened[0], jacobian


def project_reflections(reflections: Reflections, x: NDArray) -> ReflectedProjection:
    """Project every row's point into its mirror.

    Args:
        reflections: Points, cameras and who belongs to which mirror.
        x: `Mirror.values` of every mirror in turn. Shape (3 M,).

    Returns:
        Pixels and derivatives, of each row by its own mirror.
    """
    values = np.asarray(x).reshape(-1, 3)
    if len(values) == 1:
        return reflected_projection(reflections.cameras, values[0], reflections.p_WQ)
    n, k = reflections.pixels.shape
    pixels, by_point, by_mirror = np.empty((n, k)), np.empty((n, k, 3)), np.empty((n, k, 3))
    for m, own in enumerate(values):
        rows = reflections.mirror == m
        shown = reflected_projection(reflections.cameras, own, reflections.p_WQ[rows])
        pixels[rows], by_point[rows], by_mirror[rows] = (
            shown.pixels,
            shown.by_point,
            shown.by_mirror,
        )
    return ReflectedProjection(pixels, by_point, by_mirror)


def independent_covariance(
    reflections: Reflections, by_point: NDArray, noise: ReflectionNoise
) -> NDArray:
    """Return what each row's pixels are uncertain by on their own [px^2].

    Noise of the pixels, play of the joints, and what the points themselves are uncertain by.

    Args:
        by_point: Derivatives of the pixels by the points. Shape (N, 2 C, 3).

    Returns:
        Shape (N, 2 C, 2 C).
    """
    play = by_point @ reflections.by_angle
    own = by_point @ reflections.covariance @ np.swapaxes(by_point, 1, 2)
    pixel = noise.pixel_sigma**2 * np.eye(by_point.shape[1])
    return pixel + own + noise.joint_sigma**2 * (play @ np.swapaxes(play, 1, 2))


def shared_factor(reflections: Reflections, x: NDArray, by_point: NDArray) -> NDArray | None:
    """Return F with F F' the covariance that all pixels share through arm and cameras.

    Args:
        x: `Mirror.values` of every mirror in turn. Shape (3 M,).
        by_point: Derivatives of the pixels by the points. Shape (N, 2 C, 3).

    Returns:
        Shape (N, 2 C, K); None where nothing is known of such errors.
    """
    shared = reflections.shared
    if shared is None:
        return None
    slopes = by_point @ shared.by_parameter
    if shared.camera_columns:
        by_cameras = _by_cameras(reflections, x)
        for column, camera, part in shared.camera_columns:
            slopes[:, :, column] += by_cameras[f"{camera}.{part}"]
    return slopes @ shared.root


def whitening_of(reflections: Reflections, x: NDArray, noise: ReflectionNoise) -> NDArray:
    """Return W with W S W' = I of each row, S from its own noise and from the arm's covariance.

    Args:
        x: `Mirror.values` of every mirror in turn. Shape (3 M,).

    Returns:
        Lower triangular, zero where nothing was seen. Shape (N, 2 C, 2 C).
    """
    by_point = project_reflections(reflections, x).by_point
    covariance = independent_covariance(reflections, by_point, noise)
    factor = shared_factor(reflections, x, by_point)
    if factor is not None:
        covariance = covariance + factor @ np.swapaxes(factor, 1, 2)
    return hand_noise.whitening_of(covariance, reflections.seen)


def _by_cameras(reflections: Reflections, x: NDArray) -> dict[str, NDArray]:
    """Return derivatives of the pixels by each parameter of the cameras. (N, 2 C) each."""
    virtual = np.empty_like(reflections.p_WQ)
    for m, values in enumerate(np.asarray(x).reshape(-1, 3)):
        rows = reflections.mirror == m
        plane, _ = plane_of_values(values, reflections.cameras[0].X_WC)
        virtual[rows] = reflect(plane, reflections.p_WQ[rows])
    found: dict[str, NDArray] = {}
    for c, camera in enumerate(reflections.cameras):
        shown = camera.projection(virtual)
        columns = slice(2 * c, 2 * c + 2)
        for k, name in enumerate(intrinsics_of(camera.lens)):
            slope = np.zeros(reflections.pixels.shape)
            slope[:, columns] = shown.by_intrinsics[:, :, k]
            found[f"{('left', 'right')[c]}.{name}"] = slope
    if len(reflections.cameras) == 2:
        found |= _by_right_pose(reflections, virtual)
    return found


def _by_right_pose(reflections: Reflections, virtual: NDArray) -> dict[str, NDArray]:
    """Return derivatives of the pixels by `right.pose.*`, given in the left camera's frame."""
    rig = StereoRig(*reflections.cameras)
    in_left = rig.moved(rig.left.X_WC)
    p_LQ = virtual @ rig.left.X_CW[:3, :3].T + rig.left.X_CW[:3, 3]
    by_pose = in_left.right.projection(p_LQ).by_pose
    by_pose[:, :, :3] = by_pose[:, :, :3] @ rotation_vector_slope(
        rotation_vector_of(rig.X_LR[:3, :3])
    )
    found = {}
    for k, name in enumerate(POSE_NAMES):
        slope = np.zeros(reflections.pixels.shape)
        slope[:, 2:] = by_pose[:, :, k]
        found[f"right.pose.{name}"] = slope
    return found


def values_of(mirrors: Sequence[Mirror]) -> NDArray:
    """Return the parameters of mirrors in turn. Shape (3 M,)."""
    return np.concatenate([mirror.values for mirror in mirrors])

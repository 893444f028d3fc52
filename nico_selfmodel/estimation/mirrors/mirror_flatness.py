"""Whether a mirror before cameras that stand still is flat; see `estimation.diagnosis.flatness`."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.diagnosis.flatness import STEADYING, Flatness, flatness_by
from nico_selfmodel.estimation.mirrors.reflection_residuals import (
    independent_covariance,
    project_reflections,
    shared_factor,
)
from nico_selfmodel.estimation.mirrors.reflections import ReflectionNoise, Reflections
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.model.cameras.mirror import Mirror, mirror_camera

_ALIKE = 1.0
"""Joints of poses this far apart err nearly independently, of nearer ones alike [rad]."""


def flatness_of(
    reflections: Reflections, mirror: Mirror, noise: ReflectionNoise
) -> Flatness | None:
    """Test whether one mirror is flat.

    Errors that the arm's and the cameras' uncertainty brings to all poses alike are whitened
    together, or else a slightly wrong arm would look like a bent mirror. So are errors that
    neighbouring poses share, such as sag; the noise of the pixels is measured where the arm cannot
    disturb it. Both models are linearised at the plane that was found.

    Args:
        reflections: Inlier rows of this mirror, their points in front of it.
        mirror: The plane that fits best.

    Returns:
        The test; None where there are too few poses for it.
    """
    x, seen = mirror.values, reflections.seen.ravel()
    seeing = [c for c in range(len(reflections.cameras)) if reflections.seen[:, 2 * c].any()]
    redundancy = int(seen.sum()) - 6 * len(seeing)
    if redundancy < STEADYING:
        return None
    shown = project_reflections(reflections, x)
    by_cameras = _by_cameras(reflections, mirror)[
        :, :, np.repeat(6 * np.array(seeing), 6) + np.tile(np.arange(6), len(seeing))
    ]
    miss = np.nan_to_num(reflections.pixels - shown.pixels)
    sigma = _pixel_sigma(reflections, miss, shown.by_point, by_cameras, noise.pixel_sigma)
    noise = replace(noise, pixel_sigma=sigma)
    # What a camera did not see is left out of the covariance, not of its factor.
    whole = _covariance(reflections, x, shown.by_point, noise)
    white = np.linalg.cholesky(whole[np.ix_(seen, seen)])
    miss = miss.ravel()[seen]

    def whitened(jacobian: NDArray) -> NDArray:
        return np.asarray(np.linalg.solve(white, jacobian.reshape(len(seen), -1)[seen]))

    return flatness_by(
        np.linalg.solve(white, miss),
        whitened(shown.by_mirror),
        whitened(by_cameras),
        6 * len(seeing) - 3,
        redundancy,
    )


def _by_cameras(reflections: Reflections, mirror: Mirror) -> NDArray:
    """Return derivatives of the pixels by the poses of the reflected cameras. (N, 2 C, 6 C)."""
    n, count = len(reflections), len(reflections.cameras)
    plane: Plane = mirror.plane_in(reflections.cameras[0].X_WC)
    slopes = np.zeros((n, 2 * count, 6 * count))
    for c, camera in enumerate(reflections.cameras):
        by_pose = mirror_camera(camera, plane).projection(reflections.p_WQ).by_pose
        slopes[:, 2 * c : 2 * c + 2, 6 * c : 6 * c + 6] = by_pose
    return slopes


def _covariance(
    reflections: Reflections, x: NDArray, by_point: NDArray, noise: ReflectionNoise
) -> NDArray:
    """Return the covariance of all pixels together. (2 C N, 2 C N)."""
    n, k = reflections.pixels.shape
    blocks = independent_covariance(reflections, by_point, noise)
    full = np.zeros((n, k, n, k))
    full[np.arange(n), :, np.arange(n), :] = blocks
    if reflections.q is not None:
        full = full + noise.joint_sigma**2 * _alike(reflections.q, by_point @ reflections.by_angle)
    full = full.reshape(n * k, n * k)
    factor = shared_factor(reflections, x, by_point)
    if factor is not None:
        flat = factor.reshape(n * k, -1)
        full = full + flat @ flat.T
    return full


def _alike(q: NDArray, by_angle: NDArray) -> NDArray:
    """Return the covariance of pixels from joints that err alike at poses that are alike.

    What gravity, eccentric gears and one-sided play do to a joint is a smooth function of the pose,
    unknown where the arm was not learned: a Gaussian process, as large as the joints' scatter.

    Args:
        q: Joint angles [rad]. Shape (N, n).
        by_angle: Derivatives of the pixels by them. Shape (N, 2 C, n).

    Returns:
        For joints that err by one radian. Shape (N, 2 C, N, 2 C).
    """
    near = np.exp(-0.5 * np.sum(((q[:, None] - q) / _ALIKE) ** 2, axis=2))
    flat = by_angle.reshape(-1, by_angle.shape[2])
    pairs = (flat @ flat.T).reshape(*by_angle.shape[:2], *by_angle.shape[:2])
    return near[:, None, :, None] * pairs


def _pixel_sigma(
    reflections: Reflections, miss: NDArray, by_point: NDArray, by_cameras: NDArray, stated: float
) -> float:
    """Return the noise of a pixel coordinate as the two cameras' disagreement shows it [px].

    Wherever the arm puts the hand, both cameras see one point: of a row's four coordinates one
    direction is moved by no point at all, and shows pixel noise alone, once two free cameras have
    taken what is wrong with the cameras. The stated noise counts as some rows too.
    """
    both = np.asarray(reflections.seen.all(axis=1))
    if by_point.shape[1] != 4 or both.sum() < 2:
        return stated
    across = np.linalg.svd(by_point[both])[0][:, :, 3]
    r = np.einsum("ni,ni->n", across, miss[both])
    columns = np.einsum("ni,nik->nk", across, by_cameras[both])
    basis, size, _ = np.linalg.svd(
        columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-12), full_matrices=False
    )
    basis = basis[:, size > 1e-3 * size[0]]
    left_over = r - basis @ (basis.T @ r)
    rows = len(r) - basis.shape[1]
    squares = STEADYING * stated**2 + float(left_over @ left_over)
    return float(np.sqrt(squares / (STEADYING + rows)))

"""How well it is known where in a picture a reflection is seen."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.reflection import reflect, reflection_slopes
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.cameras.mirror import Mirror, plane_of_values
from nico_selfmodel.model.cameras.mirror_rig import projected
from nico_selfmodel.model.cameras.stereo_rig import StereoRig

_STEP = 0.0625
"""Sigmas are rounded up to multiples of this [px]."""


def reflection_sigma(
    rig: StereoRig, mirror: Mirror, side: int, depth: NDArray, point_sigma: NDArray | float
) -> NDArray:
    """Return the standard deviation of where one's own reflection is seen, pixel by pixel.

        S = J_p (s_p^2 1) J_p' + J_m C_m J_m',    sigma^2 = tr S / 2

    J_p and J_m are the derivatives of the pixel by the reflected point and by the mirror, C_m the
    mirror's covariance as it was learned, and s_p what is not known of where the body's points are.

    Args:
        side: Which camera, 0 or 1.
        depth: Along the optical axis to where the reflection seems to be [m]; inf where there is
            none. Shape (h, w).
        point_sigma: s_p, each coordinate; one for all pixels, or one each [m]. Shape () or (h, w).

    Returns:
        sigma, rounded up to a sixteenth of a pixel; nan where there is none, what is seen is
        before the glass, or the lens has no ray [px]. Shape (h, w).
    """
    camera = rig.cameras[side]
    rows, columns = np.nonzero(np.isfinite(depth))
    # At the corners of a picture the middle of a pixel may be beyond where the lens has rays.
    known = camera.has_rays(np.stack([columns, rows], axis=1).astype(float))
    rows, columns = rows[known], columns[known]
    sigma = np.full(depth.shape, np.nan)
    if not len(rows):
        return sigma
    ideal = camera.undistort(np.stack([columns, rows], axis=1).astype(float))
    p_CQ = np.concatenate([ideal, np.ones((len(rows), 1))], axis=1) * depth[rows, columns][:, None]
    behind = apply(camera.X_WC, p_CQ)
    by_point = projected((camera,), behind)[1]
    plane, by_values = plane_of_values(mirror.values, rig.left.X_WC)
    each = np.broadcast_to(point_sigma, depth.shape)[rows, columns]
    variance = each**2 * np.sum(by_point**2, axis=(1, 2))
    if mirror.covariance is not None:
        by_mirror = by_point @ (reflection_slopes(plane, reflect(plane, behind)) @ by_values)
        variance += np.einsum("nij,jk,nik->n", by_mirror, mirror.covariance, by_mirror)
    found = _STEP * np.ceil(np.sqrt(0.5 * variance) / _STEP)
    sigma[rows, columns] = np.where(plane.distance_to(behind) < 0.0, found, np.nan)
    return sigma

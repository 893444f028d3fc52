"""How well it is known where in a picture a reflection is seen."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.mirrors.body_alignment import BodyMotion
from nico_selfmodel.geometry.reflection import reflect, reflection_slopes
from nico_selfmodel.model.cameras.mirror import Mirror, plane_of_values
from nico_selfmodel.model.cameras.mirror_rig import projected
from nico_selfmodel.model.cameras.stereo_rig import StereoRig

_STEP = 0.0625
"""Sigmas are rounded up to multiples of this [px]."""


@dataclass(frozen=True, eq=False)
class LooseParts:
    """What of a body may stand elsewhere."""

    motions: Sequence[BodyMotion]
    """How; k of them."""
    moved: NDArray
    """Which pixels each of them moves. Shape (k, h, w)."""
    covariance: NDArray
    """Of the motions. Shape (k, k)."""


def reflection_sigma(
    rig: StereoRig,
    mirror: Mirror,
    side: int,
    depth: NDArray,
    point_sigma: NDArray | float,
    loose: LooseParts | None = None,
) -> NDArray:
    """Return the standard deviation of where one's own reflection is seen, pixel by pixel.

        S = J_p (s_p^2 1) J_p' + J_m C_m J_m' + J_q C_q J_q',    sigma^2 = tr S / 2

    J_p, J_m and J_q are the derivatives of the pixel by the reflected point, by the mirror and by
    joints that are loose, C_m the mirror's covariance as it was learned, C_q that of the joints,
    and s_p what is not known of where the body's points are.

    Args:
        side: Which camera, 0 or 1.
        depth: Along the optical axis to where the reflection seems to be [m]; inf where there is
            none. Shape (h, w).
        point_sigma: s_p, each coordinate; one for all pixels, or one each [m]. Shape () or (h, w).
        loose: What joints leave open besides.

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
    behind = camera.at_depth(np.stack([columns, rows], axis=1), depth[rows, columns])
    by_point = projected((camera,), behind)[1]
    plane, by_values = plane_of_values(mirror.values, rig.left.X_WC)
    each = np.broadcast_to(point_sigma, depth.shape)[rows, columns]
    variance = each**2 * np.sum(by_point**2, axis=(1, 2))
    if mirror.covariance is not None:
        by_mirror = by_point @ (reflection_slopes(plane, reflect(plane, behind)) @ by_values)
        variance += np.einsum("nij,jk,nik->n", by_mirror, mirror.covariance, by_mirror)
    if loose is not None:
        moved = loose.moved[:, rows, columns]
        some = np.flatnonzero(moved.any(axis=0))
        # Where a point goes its reflection goes turned round.
        turned = by_point[some] @ (np.eye(3) - 2.0 * np.outer(plane.normal, plane.normal))
        p_WQ = reflect(plane, behind[some])
        ways = [
            motion.way(p_WQ) * on[some, None]
            for motion, on in zip(loose.motions, moved, strict=True)
        ]
        by_joint = turned @ np.stack(ways, axis=2)
        variance[some] += np.einsum("nij,jk,nik->n", by_joint, loose.covariance, by_joint)
    found = _STEP * np.ceil(np.sqrt(0.5 * variance) / _STEP)
    sigma[rows, columns] = np.where(plane.distance_to(behind) < 0.0, found, np.nan)
    return sigma

"""How uncertain it is where a camera projects: error bars of pixels, not of parameters.

Numbers inside a camera trade against each other, and against how all boards are turned: only what
no turn of the camera undoes can be seen. With A the derivatives of pixels of far points by the
intrinsics b, and R those by a turn w of the camera, the turn that best undoes a change db over the
image, each place weighted by 1 / sigma^2 of what the intrinsics alone leave it, leaves

    dq = (A - R (sum R'R / sigma^2)^-1 sum R'A / sigma^2) db = M db,      cov(q) = M cov(b) M'

which is what mrcal calls projection uncertainty, at infinity ("the implied transformation").
Without the weights corners that no board reached would turn what boards told.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.estimation.cameras.camera_adjustment import CameraCalibration
from nico_selfmodel.geometry.rotation import skew
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import intrinsics_of, project_in_camera

_ACROSS = 25
"""Places along the longer side of an image."""
_LEAST = 1e-9
"""Uncertainty below which a place weighs no more [px]."""


@dataclass(frozen=True, eq=False)
class ProjectionUncertainty:
    """Standard deviations of where one camera projects far points, over its image."""

    camera: str
    """Which camera."""
    u: NDArray
    """Columns of the places, from edge to edge [px]. Shape (n,)."""
    v: NDArray
    """Their rows [px]. Shape (m,)."""
    sigma: NDArray
    """In the worst direction [px]; nan where no ray belongs to a pixel. Shape (m, n)."""
    alone: NDArray
    """What the intrinsics alone leave, no turn undone [px]. Shape (m, n)."""

    @property
    def middle(self) -> float:
        """In the image's middle [px]."""
        return float(self.sigma[len(self.v) // 2, len(self.u) // 2])

    @property
    def corner(self) -> float:
        """The largest of the image's corners [px]; nan where none has a ray."""
        corners = self.sigma[np.ix_([0, -1], [0, -1])]
        return float(np.nanmax(corners)) if np.isfinite(corners).any() else float("nan")

    @classmethod
    def of(
        cls, calibration: CameraCalibration, camera: str, aspect: float | None = None
    ) -> "ProjectionUncertainty":
        """Carry the covariance of a calibration into the image.

        Args:
            camera: Which camera, as `left`.
            aspect: The ratio fy / fx that was held, if one was.
        """
        found = calibration.cameras[calibration.views.cameras.index(camera)]
        width, height = found.image_size
        half = (_ACROSS - 1) / (2 * (max(width, height) - 1))
        u, v = (np.linspace(0.0, n - 1.0, 2 * round((n - 1) * half) + 1) for n in (width, height))
        pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
        columns = [i for i, name in enumerate(calibration.names) if name.startswith(f"{camera}.")]
        free = [calibration.names[i].partition(".")[2] for i in columns]
        inside = [k for k, name in enumerate(free) if name in intrinsics_of(found.lens)]
        rows = np.array(columns, dtype=int)[inside]
        covariance = calibration.uncertainty.covariance[np.ix_(rows, rows)]
        A, R = _by_intrinsics_and_turn(found, pixels, tuple(free[k] for k in inside), aspect)
        alone = _worst_direction(A @ covariance @ np.swapaxes(A, 1, 2))
        M = without_turn(A, R, alone)
        worst = _worst_direction(M @ covariance @ np.swapaxes(M, 1, 2))
        shape = (len(v), len(u))
        return cls(
            camera,
            read_only(u),
            read_only(v),
            *(read_only(s.reshape(shape)) for s in (worst, alone)),
        )


def without_turn(A: NDArray, R: NDArray, sigma: NDArray) -> NDArray:
    """Return how pixels move with intrinsics, less what a turn of the camera undoes.

    Args:
        A: Derivatives of pixels by intrinsics; nan where no ray belongs to one. Shape (N, 2, k).
        R: Those by a turn. Shape (N, 2, 3).
        sigma: How uncertain each place is [px]; the turn minds the certain ones. Shape (N,).
    """
    seen = np.isfinite(A).all(axis=(1, 2))
    if not seen.any():
        return A
    weighted = R[seen] / np.maximum(sigma[seen], _LEAST)[:, None, None] ** 2
    undo = np.linalg.solve(
        np.einsum("nki,nkj->ij", weighted, R[seen]), np.einsum("nki,nkj->ij", weighted, A[seen])
    )
    return A - R @ undo


def _by_intrinsics_and_turn(
    camera: Camera, pixels: NDArray, names: tuple[str, ...], aspect: float | None
) -> tuple[NDArray, NDArray]:
    """Return derivatives of far points' pixels, (N, 2, k) and (N, 2, 3); nan where no ray is."""
    rays = camera.directions(pixels)
    seen = np.isfinite(rays).all(axis=1)
    A, R = np.full((len(pixels), 2, len(names)), np.nan), np.full((len(pixels), 2, 3), np.nan)
    if not seen.any():
        return A, R
    _, by_point, by_values = project_in_camera(rays[seen].T, camera.values, camera.lens)
    by_values = np.moveaxis(by_values, 2, 0)
    every = intrinsics_of(camera.lens)
    if aspect is not None:
        by_values[:, :, every.index("fx")] += aspect * by_values[:, :, every.index("fy")]
    A[seen] = by_values[:, :, [every.index(name) for name in names]]
    R[seen] = np.moveaxis(by_point, 2, 0) @ skew(rays[seen])
    return A, R


def _worst_direction(covariance: NDArray) -> NDArray:
    """Return the largest standard deviations of pixels; nan stays nan. (N, 2, 2) -> (N,)."""
    worst = np.full(len(covariance), np.nan)
    seen = np.isfinite(covariance).all(axis=(1, 2))
    worst[seen] = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance[seen])[:, 1], 0.0))
    return worst

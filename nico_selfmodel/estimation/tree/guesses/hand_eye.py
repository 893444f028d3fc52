"""Hand-eye calibration in closed form: F_k X = Z M_k (Park, Martin 1994).

F_k are poses of a flange in its base, M_k those of a target in a sensor's frame, X the target on
the flange, Z the sensor in the base. With A = F_i^-1 F_j and B = M_i^-1 M_j it is A X = X B.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import DataError
from nico_selfmodel.geometry.rotation import (
    nearest_rotation,
    rotation_from_vector,
    rotation_vectors_of,
)
from nico_selfmodel.geometry.transform import inverse, transform

_LEAST_TURN = np.radians(5.0)
"""Turns below this tell little of an axis."""
_LEAST_SPREAD = 0.01
"""Places of a flange that is turned on the spot are off by parts of this [m]."""
_FEWEST = 3
"""Poses that a hand-eye calibration needs."""
_MOST_PAIRS = 4000
_ONE_AXIS = 0.05
"""Part of the turns about one axis that those about others must reach to be a second one."""


@dataclass(frozen=True, eq=False)
class HandEye:
    """What stands where."""

    X: NDArray
    """The target on the flange. Shape (4, 4)."""
    Z: NDArray
    """The sensor in the flange's base. Shape (4, 4)."""

    @classmethod
    def from_poses(cls, F: NDArray, M: NDArray) -> "HandEye":
        """Find both from poses that belong together.

        R_X = (N'N)^-1/2 N' of N = sum log(B) log(A)', and (R_A - I) t_X = R_X t_B - t_A. Where all
        turns share one axis, they leave R_X open about it, which the shifts then tell.

        Args:
            F: Poses of the flange. Shape (K, 4, 4).
            M: Poses of the target in the sensor's frame. Shape (K, 4, 4).

        Raises:
            DataError: If fewer than three poses turn by 5 deg against each other.
        """
        if len(F) < _FEWEST:
            raise DataError(
                f"too few poses of the flange ({len(F)} beside those held out): a hand-eye "
                f"calibration needs {_FEWEST} or more, turned about two axes or more"
            )
        i, j = _pairs(len(F))
        A, B = inverse(F[i]) @ F[j], inverse(M[i]) @ M[j]
        a, b = rotation_vectors_of(A[:, :3, :3]), rotation_vectors_of(B[:, :3, :3])
        enough = np.linalg.norm(a, axis=1) > _LEAST_TURN
        if enough.sum() < 2:
            raise DataError(
                "the flange hardly turned (fewer than two pairs of poses differ by 5 deg): a "
                "hand-eye calibration needs poses turned about two axes or more"
            )
        A, B, a, b = A[enough], B[enough], a[enough], b[enough]
        a, b, A, B = _consistent(a, b, A, B)
        R = nearest_rotation(a.T @ b)
        found, axis = cls._turned(R, A, B, F, M), _one_axis(a)
        if axis is None:
            return found
        told = cls._turned(_about_axis(R, axis, A, B), A, B, F, M)
        return min(found, told, key=lambda one: one.misfit(F, M))

    @classmethod
    def _turned(cls, R: NDArray, A: NDArray, B: NDArray, F: NDArray, M: NDArray) -> "HandEye":
        """Return what stands where once it is known how X is turned."""
        left = (A[:, :3, :3] - np.eye(3)).reshape(-1, 3)
        right = (B[:, :3, 3] @ R.T - A[:, :3, 3]).ravel()
        # Where all turns share one axis, X is open along it: the least of what fits.
        t = np.linalg.lstsq(left, right, rcond=1e-3)[0]
        X = transform(R, t)
        each = F @ X @ inverse(M)
        Z = transform(
            nearest_rotation(each[:, :3, :3].sum(axis=0)), np.median(each[:, :3, 3], axis=0)
        )
        return cls(X, Z)

    def misfit(self, F: NDArray, M: NDArray) -> float:
        """Return the usual distance of F X M^-1 from Z, in rad and in the spread of F's places.

        Args:
            F: Poses of the flange. Shape (K, 4, 4).
            M: Poses of the target in the sensor's frame. Shape (K, 4, 4).
        """
        each = F @ self.X @ inverse(M)
        turn = rotation_vectors_of(each[:, :3, :3] @ self.Z[:3, :3].T)
        spread = max(float(np.sqrt(np.var(F[:, :3, 3], axis=0).sum())), _LEAST_SPREAD)
        shift = (each[:, :3, 3] - self.Z[:3, 3]) / spread
        return float(np.median(np.linalg.norm(np.hstack([turn, shift]), axis=1)))


def only_axis(F: NDArray) -> NDArray | None:
    """Return the axis about which poses turn against each other; None where they have two or more.

    Args:
        F: Poses of a flange in its base. Shape (K, 4, 4).

    Returns:
        Unit, in the base, its largest part positive. Shape (3,).
    """
    i, j = _pairs(len(F))
    axis = _one_axis(rotation_vectors_of(F[j, :3, :3] @ np.swapaxes(F[i, :3, :3], 1, 2)))
    return None if axis is None else axis * np.sign(axis[np.argmax(np.abs(axis))])


def _one_axis(turns: NDArray) -> NDArray | None:
    """Return the axis that rotation vectors share, of either sign; None where they have two."""
    _, sizes, axes = np.linalg.svd(turns, full_matrices=False)
    if not sizes[0] > 0.0 or sizes[1] > _ONE_AXIS * sizes[0]:
        return None
    return np.asarray(axes[0])


def _about_axis(R: NDArray, axis: NDArray, A: NDArray, B: NDArray) -> NDArray:
    """Return R turned about the axis of all turns as shifts tell: A X = X B.

    With e the axis, v = R t_B and w = v - e (e.v), R_X t_B = e (e.v) + w cos + (e x v) sin, and
    (R_A - I) t_X - w cos - (e x v) sin = e (e.v) - t_A is linear in t_X, cos and sin.
    """
    v = B[:, :3, 3] @ R.T
    along = np.outer(v @ axis, axis)
    left = np.concatenate(
        [A[:, :3, :3] - np.eye(3), -np.stack([v - along, np.cross(axis, v)], axis=2)], axis=2
    )
    right = (along - A[:, :3, 3]).ravel()
    *_, cos, sin = np.linalg.lstsq(left.reshape(-1, 5), right, rcond=1e-3)[0]
    return np.asarray(rotation_from_vector(np.arctan2(sin, cos) * axis) @ R)


def _pairs(count: int) -> tuple[NDArray, NDArray]:
    i, j = np.triu_indices(count, 1)
    step = max(1, -(-len(i) // _MOST_PAIRS))
    return i[::step], j[::step]


def _consistent(
    a: NDArray, b: NDArray, A: NDArray, B: NDArray
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Keep pairs whose angles agree: a turn has the same angle in every frame."""
    apart = np.abs(np.linalg.norm(a, axis=1) - np.linalg.norm(b, axis=1))
    keep = apart <= max(6.0 * float(np.median(apart)), 1e-9)
    return a[keep], b[keep], A[keep], B[keep]

"""A chain of revolute joints as lines in space: the minimal view, used for estimation."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.arrays import frozen_array
from nico_selfmodel.geometry.rotation import rotation_about
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.arm.line_kinematics import hand_points
from nico_selfmodel.names import refuse_unknown


@dataclass(frozen=True, eq=False)
class Chain:
    """Revolute joints as lines, and the points tracked on the hand, at the zero configuration.

    Everything is expressed in the measuring frame W. The point on a line may lie anywhere along it
    and the zero configuration is free, so n joints and m tracked points hold exactly 4n + 3m
    parameters (and n gears in `ServoMap`): no gauge, no singularity for parallel axes.
    """

    joints: tuple[str, ...]
    """Names from the base outwards. Length n."""
    directions: NDArray
    """Unit axis directions, positive rotation by the right hand. Shape (n, 3)."""
    points: NDArray
    """A point on each axis [m]. Shape (n, 3)."""
    markers: tuple[str, ...]
    """Names of the tracked points. Length m."""
    p_WH_zero: NDArray
    """Tracked points at q = 0 [m]. Shape (m, 3)."""

    def __post_init__(self) -> None:
        """Check shapes and unit lengths, and make the arrays read-only."""
        n, m = len(self.joints), len(self.markers)
        for name, shape in (("directions", (n, 3)), ("points", (n, 3)), ("p_WH_zero", (m, 3))):
            object.__setattr__(self, name, frozen_array(getattr(self, name), shape, name))
        if n == 0 or m == 0:
            raise ValueError("a chain needs at least one joint and one tracked point")
        if len(set(self.joints)) != n or len(set(self.markers)) != m:
            raise ValueError(f"names must be unique, got {self.joints} and {self.markers}")
        if np.any(np.abs(np.linalg.norm(self.directions, axis=1) - 1.0) > 1e-9):
            raise ValueError("directions must have unit length")

    def marker_index(self, marker: str) -> int:
        """Return the position of a marker among `markers`.

        Raises:
            ValueError: If there is no such marker; the message lists those there are.
        """
        refuse_unknown("marker", marker, self.markers)
        return self.markers.index(marker)

    def forward(self, q: ArrayLike, marker: ArrayLike = 0) -> NDArray:
        """Predict tracked points.

        Args:
            q: Joint displacements from the zero configuration [rad], floats or Drake's scalars.
                Shape (N, n) or (n,).
            marker: Index of the tracked point, one for all or one a pose. Shape () or (N,).

        Returns:
            p_WH [m]. Shape (N, 3) or (3,).

        Raises:
            ValueError: If `q` has not n columns.
        """
        q = np.asarray(q)
        if q.shape[-1] != len(self.joints) or q.ndim > 2:
            raise ValueError(f"q must have shape (N, {len(self.joints)}), got {q.shape}")
        rows = np.atleast_2d(q)
        marker = np.broadcast_to(np.asarray(marker), (len(rows),))
        p = hand_points(self.directions, self.points, self.p_WH_zero[marker].T, rows.T).T
        return p[0] if q.ndim == 1 else p

    def link_motions(self, q: ArrayLike) -> NDArray:
        """Return the motions that carry each link from the zero configuration to q.

        Args:
            q: Joint displacements [rad]. Shape (n,).

        Returns:
            Transforms in W; entry i carries what is fixed beyond joint i, entry 0 is the identity.
            Shape (n + 1, 4, 4).
        """
        q = np.asarray(q, dtype=float)
        rotations = rotation_about(self.directions, q)
        offsets = self.points - np.einsum("nij,nj->ni", rotations, self.points)
        motions = [np.eye(4)]
        for screw in transform(rotations, offsets):
            motions.append(motions[-1] @ screw)
        return np.stack(motions)

    def rezeroed(self, q: ArrayLike) -> "Chain":
        """Return the same arm with its zero configuration moved to `q`.

        Args:
            q: Joint displacements [rad] that shall count as zero. Shape (n,).

        Returns:
            A chain with `new.forward(x) == self.forward(x + q)`.
        """
        motions = self.link_motions(q)
        return replace(
            self,
            directions=np.einsum("nij,nj->ni", motions[:-1, :3, :3], self.directions),
            points=apply(motions[:-1], self.points),
            p_WH_zero=apply(motions[-1], self.p_WH_zero),
        )

    def moved(self, x_NW: ArrayLike) -> "Chain":
        """Return the same arm expressed in another frame N. `x_NW` has shape (4, 4)."""
        x = np.asarray(x_NW, dtype=float)
        return replace(
            self,
            directions=self.directions @ x[:3, :3].T,
            points=apply(x, self.points),
            p_WH_zero=apply(x, self.p_WH_zero),
        )

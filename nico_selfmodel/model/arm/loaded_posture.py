"""An arm under its own weight: where its frames are, once it bends."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.model.arm.bending import Bending
from nico_selfmodel.model.arm.bending_slopes import Bent, bending_slopes
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.arm.line_kinematics import cross


@dataclass(frozen=True, eq=False)
class LoadedPosture:
    """Frames of an arm at displacements that its encoders tell."""

    q_read: NDArray
    """As the encoders tell [rad]. Shape (N, n) or (n,)."""
    q: NDArray
    """What the joints really turned [rad]. As `q_read`."""
    frames: NDArray
    """Frame 0 and those after each row, where they are. Shape (n + 1, N, 4, 4)."""
    rigid: NDArray
    """The same, did nothing bend."""
    moments: NDArray | None
    """`Bending.moments`; None of a rigid arm. Shape (n, N, 3)."""
    bearings: NDArray | None
    """`Bending.bearings`. Shape (n, N, 4, 4)."""
    approach: NDArray | None = None
    """How each encoder last moved; not known if None. As `q_read`."""

    def points(self, p_NH: NDArray) -> NDArray:
        """Return where points of the last frame are in W [m].

        Args:
            p_NH: One a pose. Shape (N, 3) or (3,).

        Returns:
            Shape (N, 3) or (3,).
        """
        last = self.frames[-1]
        return np.asarray((last[..., :3, :3] @ p_NH[..., None])[..., 0] + last[..., :3, 3])

    def slopes(self, bending: Bending, p_WH: NDArray) -> NDArray:
        """Return derivatives of tracked points by what bends; those of the moments are left out.

        Args:
            p_WH: The points [m]. Shape (N, 3).

        Returns:
            Shape (3, N, K).
        """
        assert self.moments is not None
        axes = self.frames[:-1, :, :3].transpose(2, 3, 0, 1)
        arm = p_WH.T[:, None] - axes[:, 3]
        by_turn = cross(axes[:, 2], arm)
        arm = arm - axes[:, 2] * bending.pivots[:, None]
        across = cross(axes[:, 0], arm), cross(axes[:, 1], arm)
        side = np.zeros(self.q_read.shape) if self.approach is None else self.approach
        R = self.rigid[..., :3, :3]
        shifts = axes[:, 0], axes[:, 1]
        at = Bent(self.q_read, side, R[:-1], R[1:], self.moments, by_turn, across, shifts)
        return bending_slopes(bending, at)


def loaded(
    table: DhTable, bending: Bending | None, q: ArrayLike, approach: NDArray | None = None
) -> LoadedPosture:
    """Return where an arm's frames are.

    Args:
        bending: What bends; nothing if None.
        q: Displacements as the encoders tell [rad], floats or Drake's scalars. (N, n) or (n,).
        approach: How each encoder last moved, -1, 1, or 0 where it is not known. As `q`.
    """
    q = np.asarray(q)
    rigid = table.frames(q)
    if bending is None:
        return LoadedPosture(q, q, rigid, rigid, None, None)
    if q.ndim == 1:
        one = loaded(table, bending, q[None], None if approach is None else approach[None])
        bearings = None if one.bearings is None else one.bearings[:, 0]
        assert one.moments is not None
        return LoadedPosture(
            *(q, one.q[0], one.frames[:, 0], one.rigid[:, 0], one.moments[:, 0], bearings),
            approach,
        )
    R = rigid[..., :3, :3]
    moments = bending.moments(R[:-1], R[1:])
    turned = q + bending.turns(q, moments, approach)
    bearings = bending.bearings(moments)
    frames = table.frames(turned, bearings)
    return LoadedPosture(q, turned, frames, rigid, moments, bearings, approach)

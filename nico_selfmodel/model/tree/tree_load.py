"""A body under its own weight: what its joints carry at many poses.

Joints that turn give way; those that shift, and flanges, do not. Joints that follow others pass on
to these what they carry: with q = T q_read, what is read feels T' of the moments about the axes.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.model.arm.bending import Bending
from nico_selfmodel.model.tree.body_tree import REVOLUTE, BodyTree


@dataclass(frozen=True, eq=False)
class TreeLoad:
    """What the joints of a body carry, did nothing bend."""

    q: NDArray
    """Displacements as the encoders tell, those of joints without one zero. Shape (N, n)."""
    approach: NDArray
    """How each encoder last moved. Shape (N, n)."""
    before: NDArray
    """Orientations of the joint frames before they move. Shape (n, N, 3, 3)."""
    after: NDArray
    """Those of the links. Shape (n, N, 3, 3)."""
    moments: NDArray
    """`Bending.moments`; about z those that what is read feels. Shape (n, N, 3)."""
    bearings: NDArray | None
    """`Bending.bearings`. Shape (n, N, 4, 4)."""

    @classmethod
    def of(
        cls,
        tree: BodyTree,
        bending: Bending,
        R_WJ: NDArray,
        R_WL: NDArray,
        readings: NDArray,
        approach: NDArray | None,
    ) -> "TreeLoad":
        """Load a body.

        Args:
            R_WJ: Orientations of the joint frames, did nothing bend. Shape (n, 3, 3, N).
            R_WL: Those of the links. Shape (n, 3, 3, N).
            readings: Encoder angles [rad] or lengths [m]. Shape (N, n).
            approach: How each last moved; not known if None. Shape (N, n).
        """
        before, after = R_WJ.transpose(0, 3, 1, 2), R_WL.transpose(0, 3, 1, 2)
        turns = np.array([motion == REVOLUTE for motion in tree.motions], dtype=float)
        moments = bending.moments(before, after, carries(tree)) * turns[:, None, None]
        moments[:, :, 2] = tree.coupling.T @ moments[:, :, 2]
        q = np.asarray(readings) / tree.gear
        side = np.zeros(q.shape) if approach is None else np.asarray(approach, dtype=float)
        return cls(q, side, before, after, moments, bending.bearings(moments))


def carries(tree: BodyTree) -> NDArray:
    """Return whether each joint (row) carries each link (column). Boolean, shape (n, n)."""
    return np.asarray(tree.beyond[:-1].T)

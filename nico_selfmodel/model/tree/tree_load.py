"""A body under its own weight: what its joints carry at many poses, and how its weight is spread.

Joints that turn give way; those that shift, and flanges, do not. Joints that follow others pass on
to these what they carry: with q = T q_read, what is read feels T' of the moments about the axes.

Uniform rods join the feet c_i of the axes, each nearest to the middle of what comes next (feet of
the joints that its link carries, and its markers). With weights m by length, one in all, and M_k of
all that joint k carries:

    l_i = sum over rods of m (c_end - c_i) / 2 + sum over k of M_k (c_k - c_i)
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.model.arm.bending import Bending
from nico_selfmodel.model.tree.body_tree import REVOLUTE, BodyTree

if TYPE_CHECKING:
    from nico_selfmodel.model.tree.tree_motion import TreeMotion


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
        bending: Bending,
        rigid: "TreeMotion",
        readings: NDArray,
        approach: NDArray | None,
    ) -> "TreeLoad":
        """Load a body.

        Args:
            bending: What bends.
            rigid: The body, did nothing bend.
            readings: Encoder angles [rad] or lengths [m]. Shape (N, n).
            approach: How each last moved; not known if None. Shape (N, n).
        """
        tree = rigid.tree
        before = rigid.R_WJ.transpose(0, 3, 1, 2)
        after = rigid.R_WL[:-1].transpose(0, 3, 1, 2)
        turns = np.array([motion == REVOLUTE for motion in tree.motions], dtype=float)
        moments = bending.moments(before, after, carries(rigid)) * turns[:, None, None]
        moments[:, :, 2] = tree.coupling.T @ moments[:, :, 2]
        q = np.asarray(readings) / tree.gear
        side = np.zeros(q.shape) if approach is None else np.asarray(approach, dtype=float)
        return cls(q, side, before, after, moments, bending.bearings(moments))


def carries(motion: "TreeMotion") -> NDArray:
    """Return whether each joint (row) carries each link (column). Boolean, shape (n, n)."""
    return np.asarray(motion.tree.beyond[:-1].T)


def tree_rods(still: "TreeMotion") -> tuple[NDArray, NDArray]:
    """Return the loads and pivots of a `Bending` for a body of uniform rods.

    Args:
        still: The body at one pose.

    Returns:
        First moments on each link, shape (n, 3), and the places of the feet along their axes [m],
        shape (n,).
    """
    tree = still.tree
    n = len(tree.joints)
    o, z = still.p_WJ[:, :, 0], still.R_WJ[:, :, 2, 0]
    feet, ends = np.array(o), _ends(still)
    below = [[k for k in range(n) if tree.parent[k] == i] for i in range(n)]
    for i in reversed(range(n)):
        after = [*ends[i], *feet[below[i]]]
        if after:
            feet[i] = o[i] + z[i] * (z[i] @ (np.mean(after, axis=0) - o[i]))
    moment, weight = np.zeros((n, 3)), np.zeros(n)
    for i in reversed(range(n)):
        ways = np.array([*ends[i], *feet[below[i]]]).reshape(-1, 3) - feet[i]
        rods = np.linalg.norm(ways, axis=1)
        hung = np.append(np.zeros(len(ends[i])), weight[below[i]])
        moment[i] = (0.5 * rods + hung) @ ways
        weight[i] = rods.sum() + hung.sum()
    roots = [i for i in range(n) if tree.parent[i] < 0]
    moment /= max(float(weight[roots].sum()), np.finfo(float).tiny)
    loads = np.einsum("ikj,ik->ij", still.R_WL[:-1, :, :, 0], moment)
    return loads, np.sum((feet - o) * z, axis=1)


def tree_loads(tree: BodyTree, mass: NDArray, centre: NDArray, pivots: NDArray) -> NDArray:
    """Return the loads of a `Bending` for a body whose masses are known.

    Args:
        tree: The body.
        mass: Of each link, in any unit. Shape (n,).
        centre: Centres of mass on the links [m]. Shape (n, 3).
        pivots: Places of the bearings along their axes [m]. Shape (n,).

    Returns:
        First moments l_i = m (centre - c_i) + sum over k of M_k (c_k - c_i). Shape (n, 3).
    """
    n = len(tree.joints)
    foot = pivots[:, None] * np.array([0.0, 0.0, 1.0])
    carried = tree.beyond[:-1].T @ mass
    moment = mass[:, None] * (centre - foot)
    for k in range(n):
        i = int(tree.parent[k])
        if i >= 0:
            at = tree.X_PJ[k, :3, :3] @ foot[k] + tree.X_PJ[k, :3, 3]
            moment[i] += carried[k] * (at - foot[i])
    return np.asarray(moment / max(float(mass.sum()), np.finfo(float).tiny))


def _ends(still: "TreeMotion") -> list[list[NDArray]]:
    """Return where rods end beside the next axes: in the middle of each link's markers."""
    tree = still.tree
    ends: list[list[NDArray]] = []
    for i in range(len(tree.joints)):
        own = [still.pose_of(marker)[1][:, 0] for marker in tree.markers if marker.on == i]
        ends.append([np.mean(own, axis=0)] if own else [])
    return ends

"""How a body's weight is spread over its links: by uniform rods, or by masses that are known.

Uniform rods join the feet c_i of the axes, each nearest to the middle of what comes next (feet of
the joints that its link carries, and its markers). With weights m by length, one in all, and M_k of
all that joint k carries:

    l_i = sum over rods of m (c_end - c_i) / 2 + sum over k of M_k (c_k - c_i)
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.model.tree.body_tree import BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion


def tree_rods(still: TreeMotion) -> tuple[NDArray, NDArray]:
    """Return the loads and pivots of a `Bending` for a body of uniform rods.

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


def _ends(still: TreeMotion) -> list[list[NDArray]]:
    """Return where rods end beside the next axes: in the middle of each link's markers."""
    tree = still.tree
    ends: list[list[NDArray]] = []
    for i in range(len(tree.joints)):
        own = [still.pose_of(marker)[1][:, 0] for marker in tree.markers if marker.on == i]
        ends.append([np.mean(own, axis=0)] if own else [])
    return ends

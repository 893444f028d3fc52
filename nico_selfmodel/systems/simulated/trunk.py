"""Joints of a torso, which carry all the rest of a body: the limbs without them, and on them.

One seed is one robot: limbs are built as they are without a torso that moves, and put on it.
"""

from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.transform import inverse
from nico_selfmodel.model.tree.body_tree import WORLD, Attached, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion

if TYPE_CHECKING:
    # The plant is slow to load.
    from nico_selfmodel.plant.body_description import BodyDescription


def trunk_of(tree: BodyTree) -> int:
    """Return how many joints, the first ones, carry all others; none of a body that is a chain."""
    n = len(tree.joints)
    carries = [bool(tree.beyond[i:n, i].all()) for i in range(n)]
    count = carries.index(False) if False in carries else n
    return 0 if count >= n - 1 else count


def limbs_of(body: "BodyDescription", trunk: int) -> "BodyDescription":
    """Return a described body whose first joints stand at zero for good."""
    tree, n = body.tree, len(body.tree.joints)
    names, own = tree.joints[trunk:], slice(trunk, n)
    X_WL = _links_at_zero(tree)
    on_trunk = tree.parent[own] < trunk
    X_PJ = np.where(
        on_trunk[:, None, None], X_WL[tree.parent[own]] @ tree.X_PJ[own], tree.X_PJ[own]
    )

    def moved(items: tuple[Attached, ...]) -> tuple[Attached, ...]:
        return tuple(
            replace(item, on=WORLD, X_LA=X_WL[item.on] @ item.X_LA) if item.on < trunk
            else replace(item, on=item.on - trunk)
            for item in items
        )  # fmt: skip

    limbs = replace(
        tree,
        joints=names,
        motions=tree.motions[trunk:],
        parent=np.where(on_trunk, WORLD, tree.parent[own] - trunk),
        X_PJ=X_PJ,
        gear=tree.gear[own],
        coupling=tree.coupling[own, own],
        markers=moved(tree.markers),
        sensors=moved(tree.sensors),
    )
    held = {name: angle for name, angle in body.held.items() if name in names}
    return replace(
        body,
        tree=limbs,
        limits=body.limits[:, own],
        joints=tuple(name for name in body.joints if name in names),
        held=MappingProxyType(held),
    )


def put_on_trunk(limbs: BodyTree, described: BodyTree, X_PJ: NDArray) -> BodyTree:
    """Return built limbs on a torso: with that at zero everything is where it was without.

    Args:
        limbs: As `limbs_of` has them, built.
        described: The whole body, of which the limbs are the last joints.
        X_PJ: Built frames of the torso's joints [m]. Shape (t, 4, 4).
    """
    trunk, n = len(X_PJ), len(described.joints)
    frames = np.concatenate([X_PJ, limbs.X_PJ])
    X_LW = inverse(_links_at_zero(replace(described, X_PJ=frames)))
    on = np.flatnonzero((described.parent < trunk) & (np.arange(n) >= trunk))
    frames[on] = X_LW[described.parent[on]] @ frames[on]

    def moved(items: tuple[Attached, ...], whole: tuple[Attached, ...]) -> tuple[Attached, ...]:
        return tuple(
            replace(item, on=there.on, X_LA=X_LW[there.on] @ item.X_LA) if there.on < trunk
            else replace(item, on=there.on)
            for item, there in zip(items, whole, strict=True)
        )  # fmt: skip

    return replace(
        described,
        X_PJ=frames,
        markers=moved(limbs.markers, described.markers),
        sensors=moved(limbs.sensors, described.sensors),
        lenses=limbs.lenses,
    )


def _links_at_zero(tree: BodyTree) -> NDArray:
    """Return where links are with all joints at zero; the last is the world's. (n + 1, 4, 4)."""
    motion = TreeMotion.at(tree, np.zeros((1, len(tree.joints))))
    X_WL = np.tile(np.eye(4), (len(tree.joints) + 1, 1, 1))
    X_WL[:, :3, :3], X_WL[:, :3, 3] = motion.R_WL[..., 0], motion.p_WL[..., 0]
    return X_WL

"""A body without what moves freely beside it, and with it: boards are no part of a robot."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.model.arm.bending import Bending
from nico_selfmodel.model.tree.body_tree import FREE, WORLD, Attached, BodyTree


def body_alone(tree: BodyTree) -> BodyTree:
    """Return a body without its free joints, which stand last, and without their markers."""
    n = len(tree.joints) - tree.motions.count(FREE)
    if n == len(tree.joints):
        return tree
    return replace(
        tree,
        joints=tree.joints[:n],
        motions=tree.motions[:n],
        parent=tree.parent[:n],
        X_PJ=tree.X_PJ[:n],
        gear=tree.gear[:n],
        coupling=tree.coupling[:n, :n],
        markers=tuple(marker for marker in tree.markers if marker.on < n),
        bending=tree.bending and resized(tree.bending, tree.joints[:n]),
    )


def with_free_joints(
    tree: BodyTree, joints: tuple[str, ...], markers: tuple[Attached, ...]
) -> BodyTree:
    """Return a body beside which something moves freely.

    Args:
        joints: Names of what moves freely.
        markers: On links n, n + 1, ... of these joints, n those of the body.
    """
    n, new = len(tree.joints), len(joints)
    coupling = np.eye(n + new)
    coupling[:n, :n] = tree.coupling
    return replace(
        tree,
        joints=(*tree.joints, *joints),
        motions=(*tree.motions, *(FREE,) * new),
        parent=np.append(tree.parent, np.full(new, WORLD)),
        X_PJ=np.concatenate([tree.X_PJ, np.tile(np.eye(4), (new, 1, 1))]),
        gear=np.append(tree.gear, np.ones(new)),
        coupling=coupling,
        markers=(*tree.markers, *markers),
        bending=tree.bending and resized(tree.bending, (*tree.joints, *joints)),
    )


def resized(bending: Bending, joints: tuple[str, ...]) -> Bending:
    """Return what bends of the first joints of a list, or of these and more that do not."""
    old, new = len(bending.joints), len(joints)

    def cut(values: NDArray, axes: int = 1) -> NDArray:
        longer = [(0, max(new - old, 0) if axis < axes else 0) for axis in range(values.ndim)]
        padded = np.pad(values, longer)
        return np.asarray(padded[:new] if axes == 1 else padded[:new, :new])

    return replace(
        bending,
        joints=joints,
        loads=cut(bending.loads),
        pivots=cut(bending.pivots),
        sag=cut(bending.sag),
        bearing_sag=cut(bending.bearing_sag),
        backlash=cut(bending.backlash),
        ripple=cut(bending.ripple),
        coupling=cut(bending.coupling, 2),
    )

"""What a recording of a known body says of it: what carries its joints, markers and cameras."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.dataset.body.sensors import CAMERA, MarkerInfo, SensorInfo
from nico_selfmodel.model.tree.body_tree import REVOLUTE, BodyTree


def link_joints_of(tree: BodyTree) -> tuple[LinkJoint, ...]:
    """Return a body's joints, read in [rad or m]; one that follows others is not read."""
    joints = []
    for i, (name, motion) in enumerate(zip(tree.joints, tree.motions, strict=True)):
        leads = {} if tree.coupling[i, i] else dict(zip(tree.joints, tree.coupling[i], strict=True))
        joints.append(
            LinkJoint(
                name,
                tree.link_name(tree.parent[i]),
                motion,
                "rad" if motion == REVOLUTE else "m",
                follows={lead: float(ratio) for lead, ratio in leads.items() if ratio},
            )
        )
    return tuple(joints)


def marker_infos(
    tree: BodyTree, places: Mapping[str, ArrayLike] | None = None
) -> tuple[MarkerInfo, ...]:
    """Return a body's markers; of some it is known where they are on their links [m]."""
    known = {name: tuple(np.asarray(p, dtype=float).tolist()) for name, p in (places or {}).items()}
    return tuple(MarkerInfo(m.name, tree.link_name(m.on), known.get(m.name)) for m in tree.markers)


def camera_infos(tree: BodyTree) -> tuple[SensorInfo, ...]:
    """Return the cameras of a body that has no other sensors; their lenses are not told."""
    return tuple(
        SensorInfo(s.name, CAMERA, tree.link_name(s.on), image_size=tree.lenses[s.name].image_size)
        for s in tree.sensors
    )

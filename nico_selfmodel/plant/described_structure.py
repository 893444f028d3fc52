"""What a description says of which joint carries and which one moves another, as a recording does.

A recording that says otherwise is of another robot, whatever the adjustment makes of it.
"""

from collections.abc import Sequence

import numpy as np

from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.tree.body_tree import WHOLE_POSES, WORLD_NAME
from nico_selfmodel.plant.kinematic_tree import KinematicTree

_RATIOS_ALIKE = 2e-3
"""Share by which ratios differ that were rounded."""


def check_structure(described: KinematicTree, joints: Sequence[LinkJoint]) -> None:
    """Refuse a recording whose joints hang on others, or follow others, than those described.

    Args:
        joints: Those of the recording, of which the description has all but whole poses.

    Raises:
        ModelError: If some do; it names the first and what both say of it.
    """
    names = {joint.name for joint in joints}
    read = {joint.name for joint in joints if joint.is_read}
    for joint in joints:
        if joint.motion in WHOLE_POSES:
            continue
        link = described.joint(joint.name).parent_body().name()
        above = [one.name() for one in described.joints_down_to(link)]
        parent = carrier(above, names)
        if parent != joint.parent:
            raise ModelError(
                f"joint {joint.name!r} is carried by {joint.parent!r} in the data set, by "
                f"{parent!r} in {described.urdf}: correct 'parent' in dataset.yaml, or that file"
            )
        _refuse_other_ratio(described, joint, read)
        for k, between in enumerate(above):
            lead = None if between in names else _leader(described, between, read)
            if lead is not None:
                raise ModelError(
                    f"{described.urdf} has joint {between!r} above {joint.name!r}, which follows "
                    f"{lead[0]!r} (mimic), but the data set does not list it: add to its joints "
                    f"{{name: {between}, parent: {carrier(above[:k], names)}, motion: "
                    f"{_motion(described, between)}, follows: {{{lead[0]}: {lead[1]:g}}}}}, as "
                    "parent of what it carries"
                )


def carrier(above: Sequence[str], names: set[str]) -> str:
    """Return the last of some joints on the way down from the root; the world if there is none."""
    return next((name for name in reversed(above) if name in names), WORLD_NAME)


def _motion(described: KinematicTree, name: str) -> str:
    return described.joint(name).type_name()


def _refuse_other_ratio(described: KinematicTree, joint: LinkJoint, read: set[str]) -> None:
    lead = _leader(described, joint.name, read)
    if not joint.follows or lead is None:
        return
    leader, ratio = lead
    if set(joint.follows) != {leader} or not np.isclose(
        joint.follows[leader], ratio, rtol=_RATIOS_ALIKE
    ):
        said = ", ".join(f"{name}: {own:g}" for name, own in joint.follows.items())
        raise ModelError(
            f"joint {joint.name!r} follows {{{said}}} in the data set, {{{leader}: {ratio:g}}} in "
            f"{described.urdf} (mimic): correct 'follows' in dataset.yaml, or that file"
        )


def _leader(described: KinematicTree, name: str, read: set[str]) -> tuple[str, float] | None:
    """Return the joint that is read and moves one that mimics, and the ratio; None without it."""
    ratio, passed = 1.0, set[str]()
    while name in described.mimics and name not in passed:
        passed.add(name)
        name, multiplier = described.mimics[name]
        ratio *= multiplier
        if name in read:
            return name, ratio
    return None

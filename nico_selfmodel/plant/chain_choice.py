"""Which joints of a robot make the chain that is learned, and what cannot be learned."""

from collections.abc import Mapping

import numpy as np
from pydrake.multibody.tree import Joint, PrismaticJoint, RevoluteJoint, WeldJoint

from nico_selfmodel.errors import ModelError
from nico_selfmodel.names import listed
from nico_selfmodel.plant.kinematic_tree import KinematicTree

_ROUNDING = 1e-6
"""How far beyond a limit a held value may lie: limits are often written with few digits."""


def only_link(tree: KinematicTree, links: list[str], kind: str, argument: str) -> str:
    """Return the single link of a list.

    Raises:
        ModelError: If there are several; the message lists them and names the argument to give.
    """
    if len(links) != 1:
        option = argument.removesuffix("_link")
        raise ModelError(
            f"{tree.urdf} has {len(links)} {kind} links, choose {argument} (--{option}) among "
            f"{listed(links)}"
        )
    return links[0]


def checked_held(tree: KinematicTree, held: Mapping[str, float]) -> dict[str, float]:
    """Return held joints and their values as plain numbers.

    Raises:
        ModelError: If a joint is not there, cannot move in one direction, or its value is not
            finite or beyond its limits.
    """
    for name, value in held.items():
        joint = tree.joint(name)
        if not isinstance(joint, RevoluteJoint | PrismaticJoint):
            raise ModelError(f"joint {name!r} is {joint.type_name()}: there is nothing to hold")
        if not np.isfinite(value):
            raise ModelError(f"joint {name!r} cannot be held at {value}")
        lower, upper = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
        if not lower - _ROUNDING <= value <= upper + _ROUNDING:
            unit = "rad" if isinstance(joint, RevoluteJoint) else "m"
            raise ModelError(
                f"joint {name!r} cannot be held at {value:g} {unit}: it moves from {lower:g} to "
                f"{upper:g} {unit}"
            )
    return {name: float(value) for name, value in held.items()}


def learned_joints(
    tree: KinematicTree, base: str, tip: str, held: Mapping[str, float]
) -> list[RevoluteJoint]:
    """Return the revolute joints from base to tip that are not held, from the base outwards.

    Raises:
        ModelError: If there is no way between the links, none or another kind of joint on it, or
            a joint that mimics another.
    """
    upwards, downwards = tree.joints_between(base, tip)
    for joint in upwards:
        if not _stands_still(joint, held):
            raise ModelError(
                f"the way from {base!r} to {tip!r} passes joint {joint.name()!r} backwards: start "
                f"from {joint.parent_body().name()!r}, or hold it"
            )
    learned: list[RevoluteJoint] = []
    for joint in downwards:
        if _stands_still(joint, held):
            continue
        if not isinstance(joint, RevoluteJoint):
            raise ModelError(
                f"joint {joint.name()!r} between {base!r} and {tip!r} is {joint.type_name()}: only "
                "revolute joints can be learned, hold it or choose other links"
            )
        learned.append(joint)
    if not learned:
        raise ModelError(f"no revolute joint that is not held lies between {base!r} and {tip!r}")
    _refuse_mimics(tree, learned)
    return learned


def check_point(
    tree: KinematicTree,
    name: str,
    tip: str,
    last: RevoluteJoint,
    held: Mapping[str, float],
) -> None:
    """Refuse a tracked point that is not rigidly beyond the last learned joint.

    Args:
        name: A link or frame.
        tip: The tip link, for the message.
        last: The last learned joint.
        held: Joints that stand still.

    Raises:
        ModelError: If the point is not there, is not moved by the last joint, or moves further.
    """
    path = tree.joints_down_to(tree.frame(name).body().name())
    names = [joint.name() for joint in path]
    if last.name() not in names:
        raise ModelError(f"point {name!r} is not on the hand: joint {last.name()!r} must move it")
    for joint in path[names.index(last.name()) + 1 :]:
        if not _stands_still(joint, held):
            raise ModelError(
                f"point {name!r} moves with joint {joint.name()!r} against {tip!r}: hold the "
                "joint, or track another point"
            )


def _stands_still(joint: Joint, held: Mapping[str, float]) -> bool:
    return isinstance(joint, WeldJoint) or joint.name() in held


def _refuse_mimics(tree: KinematicTree, learned: list[RevoluteJoint]) -> None:
    following = [joint.name() for joint in learned if joint.name() in tree.mimics]
    if following:
        raise ModelError(
            f"joint {listed(following)} mimics another joint and cannot be learned on its own: "
            "hold it or choose other links"
        )

"""An arm as its URDF describes it: which chain of the robot, and its nominal geometry."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.tree import RevoluteJoint

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import listed
from nico_selfmodel.plant.chain_choice import check_point, checked_held, learned_joints, only_link
from nico_selfmodel.plant.kinematic_tree import KinematicTree
from nico_selfmodel.plant.robots import ROBOTS, find_robot, named_arm

DEFAULT_MARKER = "hand"


@dataclass(frozen=True, eq=False)
class LinkPoses:
    """Where the links stand at the chain's zero configuration, in the base link's frame B."""

    root_link: str
    """The link that the whole robot hangs on."""
    X_BR: NDArray
    """Pose of the root link. Shape (4, 4)."""
    X_BP: NDArray
    """Poses of the parent links. Shape (n, 4, 4)."""
    child_links: tuple[str, ...]
    """The link that each learned joint moves. Length n."""
    X_BC: NDArray
    """Poses of the child links. Shape (n, 4, 4)."""
    X_BT: NDArray
    """Pose of the tip link. Shape (4, 4)."""
    X_BH: NDArray
    """Poses of the markers' frames. Shape (m, 4, 4)."""


@dataclass(frozen=True, eq=False)
class ArmDescription:
    """A serial chain of a robot with its nominal geometry.

    The chain's zero configuration is that of the URDF, with held joints at their values and the
    joints that do not belong to it at zero; it is expressed in the base link's frame B.
    """

    urdf: Path
    """The file, absolute."""
    robot: str
    """What was asked for: a robot's name, or the file."""
    base_link: str
    """Link whose frame is B. It carries the first joint, or stands still against what does."""
    tip_link: str
    """Link that carries the tracked points."""
    held: Mapping[str, float]
    """Joints that stand still, at their values [rad or m]."""
    points: Mapping[str, str]
    """Marker -> link or frame whose origin is tracked."""
    chain: Chain
    """The nominal arm in B."""
    lower: NDArray
    """Lower joint limits [rad]; -inf where there is none. Shape (n,)."""
    upper: NDArray
    """Upper joint limits [rad]; inf where there is none. Shape (n,)."""
    links: LinkPoses
    """Where the links stand."""

    @classmethod
    def from_urdf(
        cls,
        urdf: str | Path,
        base_link: str | None = None,
        tip_link: str | None = None,
        held: Mapping[str, float] | None = None,
        points: Mapping[str, str] | None = None,
    ) -> "ArmDescription":
        """Read a chain from a URDF. Meshes need not be there.

        Args:
            urdf: A robot's name or a URDF file.
            base_link: Where the chain starts; the root link if omitted.
            tip_link: Where it ends; the only leaf link if omitted.
            held: Joints that stand still, and their values [rad or m].
            points: Marker -> name of a link or frame; `hand` at the tip link if omitted.

        Raises:
            ModelError: If the file cannot be read, a name is not in it, there is no chain of
                revolute joints between the links, or one of its joints follows another (mimic).
        """
        tree = KinematicTree.from_urdf(find_robot(urdf))
        base, tip = base_link, tip_link
        if base is None:
            base = only_link(tree, tree.roots, "root", "base_link")
        if tip is None:
            tip = only_link(tree, tree.leaves, "leaf", "tip_link")
        for link in (base, tip):
            tree.check_link(link)
        held = checked_held(tree, held or {})
        joints = learned_joints(tree, base, tip, held)
        points = dict(points or {DEFAULT_MARKER: tip})
        for name in points.values():
            check_point(tree, name, tip, joints[-1], held)
        return cls(
            tree.urdf,
            str(urdf) if str(urdf) in ROBOTS else str(tree.urdf),
            base,
            tip,
            MappingProxyType(held),
            MappingProxyType(points),
            _nominal_chain(tree, held, base, joints, points),
            np.concatenate([joint.position_lower_limits() for joint in joints]),
            np.concatenate([joint.position_upper_limits() for joint in joints]),
            _link_poses(tree, held, base, tip, joints, points),
        )

    @classmethod
    def named(cls, robot: str = "nico", arm: str | None = None) -> "ArmDescription":
        """Read a named arm of a named robot, the robot's default arm if none is named.

        Raises:
            ModelError: If there is no such robot or arm; the message lists those there are.
        """
        chosen = named_arm(robot, arm)
        return cls.from_urdf(robot, chosen.base_link, chosen.tip_link, chosen.held, chosen.points)

    @classmethod
    def of_model(cls, model: SelfModel) -> "ArmDescription | None":
        """Read again the chain that a self-model was started from; None if it had none.

        Raises:
            ModelError: If the URDF is gone or has changed so that the chain is not in it.
        """
        source = model.robot
        if not source:
            return None
        arm = cls.from_urdf(
            source["urdf"],
            source.get("base_link"),
            source.get("tip_link"),
            source.get("held"),
            source.get("points"),
        )
        arm.check_joints(model.joints)
        return arm

    @property
    def source(self) -> dict[str, Any]:
        """What `SelfModel.robot` keeps, so that `of_model` finds the chain again."""
        return {
            "urdf": self.robot,
            "base_link": self.base_link,
            "tip_link": self.tip_link,
            "held": dict(self.held),
            "points": dict(self.points),
        }

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the chain's joints from the base outwards."""
        return self.chain.joints

    @property
    def markers(self) -> tuple[str, ...]:
        """Names of the tracked points."""
        return self.chain.markers

    def check_joints(self, joints: tuple[str, ...]) -> None:
        """Refuse joints that are not this chain's.

        Raises:
            ModelError: If names or order differ.
        """
        if joints != self.joints:
            raise ModelError(
                f"the self-model has the joints {listed(joints)}, and the chain from "
                f"{self.base_link} to {self.tip_link} of {self.urdf.name} has "
                f"{listed(self.joints)}: give a model of that chain"
            )


def _nominal_chain(
    tree: KinematicTree,
    held: Mapping[str, float],
    base: str,
    joints: list[RevoluteJoint],
    points: Mapping[str, str],
) -> Chain:
    frames = tree.poses(held, base, [joint.frame_on_parent() for joint in joints])
    hands = tree.poses(held, base, [tree.frame(name) for name in points.values()])
    axes = np.stack([joint.revolute_axis() for joint in joints])
    directions = np.einsum("nij,nj->ni", frames[:, :3, :3], axes)
    return Chain(
        tuple(joint.name() for joint in joints),
        directions / np.linalg.norm(directions, axis=1, keepdims=True),
        frames[:, :3, 3],
        tuple(points),
        hands[:, :3, 3],
    )


def _link_poses(
    tree: KinematicTree,
    held: Mapping[str, float],
    base: str,
    tip: str,
    joints: list[RevoluteJoint],
    points: Mapping[str, str],
) -> LinkPoses:
    root = tree.root_of(tip)
    parents = tuple(joint.parent_body().name() for joint in joints)
    children = tuple(joint.child_body().name() for joint in joints)

    def poses(*names: str) -> NDArray:
        return tree.poses(held, base, [tree.frame(name) for name in names])

    return LinkPoses(
        root,
        poses(root)[0],
        poses(*parents),
        children,
        poses(*children),
        poses(tip)[0],
        poses(*points.values()),
    )

"""Links that nothing moves against each other: what one shape is learned of."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.transform import inverse
from nico_selfmodel.geometry.voxel_grid import VoxelGrid
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import refuse_unknown
from nico_selfmodel.plant.kinematic_tree import KinematicTree
from nico_selfmodel.sessions.mirrors.learned_shape import Skeleton
from nico_selfmodel.sessions.mirrors.own_pictures import described
from nico_selfmodel.sessions.mirrors.recorded_shape import ends

PITCH = 3e-3
"""Of the voxels: a finger is 10 mm thick [m]."""
REACH = 0.045
"""How far a link's surface may be from the lines between its joints [m]."""


@dataclass(frozen=True, eq=False)
class RigidBody:
    """Links between joints that move, some of which a shape is learned of."""

    frame: str
    """Link whose frame F it is learned in."""
    links: frozenset[str]
    """All that move with that link."""
    wanted: tuple[str, ...]
    """Those whose shape is learned."""
    skeleton: Skeleton
    """Lines between their joints, in F."""

    @classmethod
    def of(
        cls,
        tree: KinematicTree,
        joints: Collection[str],
        wanted: Sequence[str],
        poses: Mapping[str, NDArray],
    ) -> "list[RigidBody]":
        """Return the bodies that some links belong to.

        What hangs on a link and does not move against it counts to it, unless its shape is learned
        for itself.

        Args:
            tree: Of the robot.
            joints: Those that move.
            wanted: Whose shape is learned.
            poses: Link -> its pose in W, at whatever posture. Shape (4, 4) each.
        """
        found: list[RigidBody] = []
        for link in wanted:
            if any(link in body.links for body in found):
                continue
            links = moving_with(tree, joints, link)
            own = tuple(other for other in wanted if other in links)
            near = {name for name in poses if name in links or _above(tree, name) in links}
            about = {name: inverse(poses[link]) @ poses[name] for name in near}
            skeleton = Skeleton.of(tree, about, ends(tree, own))
            found.append(cls(link, links, own, skeleton))
        return found

    @cached_property
    def grid(self) -> VoxelGrid:
        """Where its surface may be, in F."""
        return VoxelGrid.about(self._lines.reshape(-1, 3), REACH, PITCH)

    def near(self, p_FQ: NDArray) -> NDArray:
        """Return which points may belong to the wanted links. Shape (N, 3) -> (N,)."""
        return self.skeleton.within(p_FQ, self.wanted, REACH)

    @cached_property
    def places(self) -> NDArray:
        """All points of the grid that may belong to the wanted links, in F. Shape (N, 3)."""
        points = self.grid.points
        return points[self.near(points)]

    @property
    def _lines(self) -> NDArray:
        return self.skeleton.lines[np.isin(self.skeleton.links, self.wanted)]


def moving_with(tree: KinematicTree, joints: Collection[str], link: str) -> frozenset[str]:
    """Return the links that stand still against one, it among them."""
    top = link
    while top in tree.joint_above and tree.joint_above[top].name() not in joints:
        top = tree.joint_above[top].parent_body().name()
    found, grown = set(), {top}
    while grown:
        found |= grown
        grown = {
            below
            for below, joint in tree.joint_above.items()
            if joint.parent_body().name() in grown and joint.name() not in joints
        }
    return frozenset(found)


def all_move(model: SelfModel, links: Sequence[str]) -> bool:
    """Return whether links move with the arm, or stand still.

    Raises:
        ModelError: If the model names no robot, or one that cannot be read.
        ValueError: If a link does not exist, or some move and others stand still.
    """
    robot = described(model)
    tree, first = KinematicTree.from_urdf(robot.urdf), robot.joints[0]
    for link in links:
        refuse_unknown("link", link, tree.links)
    moving = [link for link in links if first in _carrying(tree, link)]
    if moving and len(moving) < len(links):
        standing = [link for link in links if link not in moving]
        raise ValueError(
            f"--link {moving[0]} moves with the arm and {standing[0]} stands still, which is seen "
            "in mirrors: learn them one after the other"
        )
    return bool(moving)


def _carrying(tree: KinematicTree, link: str) -> list[str]:
    """Return the joints between a link and the root."""
    found = []
    while link in tree.joint_above:
        joint = tree.joint_above[link]
        found.append(joint.name())
        link = joint.parent_body().name()
    return found


def _above(tree: KinematicTree, link: str) -> str | None:
    """Return the link that one hangs on."""
    joint = tree.joint_above.get(link)
    return None if joint is None else joint.parent_body().name()

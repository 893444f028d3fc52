"""A body as its URDF describes it: which of its joints are commanded, and its nominal geometry."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint

from nico_selfmodel.dataset.body.link_joint import LinkJoint, parents_of
from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.tree.body_tree import REVOLUTE, WORLD, WORLD_NAME, Attached, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.names import listed
from nico_selfmodel.plant.described_body import described_body
from nico_selfmodel.plant.described_structure import carrier
from nico_selfmodel.plant.frames import JointFrames, add_frame, add_robot, place_root
from nico_selfmodel.plant.kinematic_tree import KinematicTree
from nico_selfmodel.plant.model_in_plant import ModelInPlant
from nico_selfmodel.plant.robots import find_robot


@dataclass(frozen=True, eq=False)
class BodyDescription:
    """A tree of joints of a robot with its nominal geometry, in the frame of its root link."""

    urdf: Path
    """The file, absolute."""
    tree: BodyTree
    """The nominal body: all joints that are not fixed for good, markers and cameras."""
    limits: NDArray
    """Lower and upper limits of all its joints [rad]. Shape (2, n)."""
    joints: tuple[str, ...]
    """The joints that are commanded, in the order of the tree. Length k."""
    held: Mapping[str, float]
    """Where the others stand still [rad]."""

    @classmethod
    def from_urdf(
        cls,
        urdf: str | Path,
        joints: Sequence[str],
        markers: Mapping[str, bool],
        cameras: Mapping[str, Camera],
        *,
        commanded: Sequence[str] | None = None,
        held: Mapping[str, float] | None = None,
    ) -> "BodyDescription":
        """Read a tree of joints from a URDF.

        Args:
            urdf: A robot's name or a URDF file.
            joints: All revolute joints of the body, a parent before its children; all others of the
                robot stand at zero.
            markers: Links or frames whose origins are tracked, and whether they are flat cards that
                face along z.
            cameras: Link or frame -> optics of the camera there.
            commanded: Which joints are commanded; all of them if omitted.
            held: Where the others stand still; at zero if omitted [rad].

        Raises:
            ModelError: If the file cannot be read, or a name is not in it.
        """
        described = KinematicTree.from_urdf(find_robot(urdf))
        wanted = tuple(joints if commanded is None else commanded)
        unknown = [name for name in wanted if name not in joints]
        if unknown or not wanted:
            raise ModelError(
                f"the joints that are commanded must be some of {listed(joints)}, got "
                f"{listed(unknown) or 'none'}"
            )
        links = _link_joints(described, joints)
        blank = _blank(described, links, markers, cameras)
        limited = [_revolute(described, name) for name in joints]
        still = {name: (held or {}).get(name, 0.0) for name in joints if name not in wanted}
        return cls(
            described.urdf,
            described_body(described.urdf, links, blank),
            np.array(
                [
                    [joint.position_lower_limit() for joint in limited],
                    [joint.position_upper_limit() for joint in limited],
                ]
            ),
            tuple(name for name in joints if name in wanted),
            MappingProxyType(still),
        )

    @property
    def markers(self) -> tuple[str, ...]:
        """Names of the tracked points."""
        return tuple(marker.name for marker in self.tree.markers)

    @property
    def root(self) -> str:
        """Name of the link whose frame everything is in."""
        return KinematicTree.from_urdf(self.urdf).roots[0]

    @property
    def lower(self) -> NDArray:
        """Lower limits of the commanded joints [rad]. Shape (k,)."""
        return np.asarray(self.limits[0, self.columns])

    @property
    def upper(self) -> NDArray:
        """Upper limits of the commanded joints [rad]. Shape (k,)."""
        return np.asarray(self.limits[1, self.columns])

    @property
    def columns(self) -> NDArray:
        """Where the commanded joints stand in the tree. Shape (k,)."""
        return np.array([self.tree.joints.index(name) for name in self.joints])

    def built(self, tree: BodyTree, scene_graph: SceneGraph | None = None) -> ModelInPlant:
        """Return the robot in a plant whose joints and markers stand where a tree has them.

        Every marker has a frame of its name with `_built` behind it. The tree's joints are at q = 0
        where the description has them at zero.

        Args:
            tree: A body of the same joints and markers.
            scene_graph: What the plant's geometry goes into; none if omitted.
        """
        plant = MultibodyPlant(0.0)
        if scene_graph is not None:
            plant.RegisterAsSourceForSceneGraph(scene_graph)
        described = KinematicTree.from_urdf(self.urdf)
        frames = _joint_frames(described, self.tree, tree)
        root, world = described.roots[0], plant.world_frame()
        instance, _ = add_robot(plant, described, described.name, frames, world, np.eye(4))
        place_root(plant, instance, root, world, np.eye(4))
        for nominal, marker in zip(self.tree.markers, tree.markers, strict=True):
            mount = plant.GetFrameByName(nominal.name, instance)
            offset = inverse(nominal.X_LA) @ marker.X_LA
            add_frame(plant, instance, built_frame_name(marker.name), mount, offset)
        plant.Finalize()
        return ModelInPlant(plant, instance)


def built_frame_name(marker: str) -> str:
    """Return the name of the frame where a tracked point really is."""
    return f"{marker}_built"


def _link_joints(described: KinematicTree, joints: Sequence[str]) -> tuple[LinkJoint, ...]:
    """Return revolute joints, parents before children, with the one among them that carries each.

    Raises:
        ModelError: If a joint is not there, or is not revolute.
    """
    above = {name: _revolute(described, name).parent_body().name() for name in joints}
    return tuple(LinkJoint(name, _carrier(described, joints, above[name])) for name in joints)


def _revolute(described: KinematicTree, name: str) -> RevoluteJoint:
    joint = described.joint(name)
    if not isinstance(joint, RevoluteJoint):
        raise ModelError(f"joint {name!r} is {joint.type_name()}: only revolute joints are driven")
    return joint


def _carrier(described: KinematicTree, joints: Sequence[str], link: str) -> str:
    """Return the last of some joints on the way down to a link."""
    return carrier([joint.name() for joint in described.joints_down_to(link)], set(joints))


def _blank(
    described: KinematicTree,
    links: Sequence[LinkJoint],
    markers: Mapping[str, bool],
    cameras: Mapping[str, Camera],
) -> BodyTree:
    """Return the body with all its frames the identity."""
    names = tuple(joint.name for joint in links)
    n = len(names)

    def attached(frame: str, *, oriented: bool) -> Attached:
        on = _carrier(described, names, described.frame(frame).body().name())
        return Attached(frame, WORLD if on == WORLD_NAME else names.index(on), oriented=oriented)

    return BodyTree(
        names,
        (REVOLUTE,) * n,
        parents_of(tuple(links)),
        np.broadcast_to(np.eye(4), (n, 4, 4)),
        np.ones(n),
        np.eye(n),
        tuple(attached(frame, oriented=card) for frame, card in markers.items()),
        tuple(attached(frame, oriented=True) for frame in cameras),
        dict(cameras),
    )


def _joint_frames(
    described: KinematicTree, nominal: BodyTree, tree: BodyTree
) -> dict[str, JointFrames]:
    """Return where both frames of every joint go.

    `X_PF = X_PL X_LJ` with L the link of the tree that carries the joint, which stands still
    against the robot's link P, and `X_CM = X_CL`, both of the description at zero.
    """
    root = described.roots[0]
    still = TreeMotion.at(nominal, np.zeros((1, len(nominal.joints))))
    X_WL = transform(still.R_WL[..., 0], still.p_WL[..., 0])
    frames = {}
    for i, name in enumerate(nominal.joints):
        joint = described.joint(name)
        bodies = [joint.parent_body().body_frame(), joint.child_body().body_frame()]
        X_WP, X_WC = described.poses({}, root, bodies)
        X_PL = inverse(X_WP) @ X_WL[nominal.parent[i]]
        frames[name] = JointFrames(X_PL @ tree.X_PJ[i], inverse(X_WC) @ X_WL[i])
    return frames

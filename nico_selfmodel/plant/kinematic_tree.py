"""A URDF as Drake reads it: links, the joint each hangs on, and the way between two links."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, Joint, ModelInstanceIndex

from nico_selfmodel.errors import ModelError
from nico_selfmodel.files.reading import real_path
from nico_selfmodel.names import listed
from nico_selfmodel.plant.urdf_checks import WORLD, check_urdf
from nico_selfmodel.plant.urdf_document import child, children, read_document, robot_element

_LITERAL = re.compile(r"<literal-string>\.urdf:\d*:?\s*")
"""How Drake names the place in what it read from a text."""


def rigid(matrix: NDArray) -> RigidTransform:
    """Return Drake's form of a rigid transform. Shape (4, 4)."""
    return RigidTransform(pose=matrix)


def parse(plant: MultibodyPlant, urdf: Path, text: str | None = None) -> ModelInstanceIndex:
    """Add the robot of a URDF to a plant.

    Packages (`package://`) are looked for in the folders above the file and on ROS_PACKAGE_PATH.
    Meshes are only looked for if the plant has a scene graph.

    Args:
        plant: A plant that is not finalized.
        text: What to read in its place, as if it stood there.

    Returns:
        The robot's model instance.

    Raises:
        ModelError: If Drake cannot read it; the message is then Drake's.
    """
    parser = Parser(plant)
    packages = parser.package_map()
    try:
        for folder in real_path(urdf).parents:
            if (folder / "package.xml").is_file():
                packages.AddPackageXml(str(folder / "package.xml"))
        packages.PopulateFromRosPackagePath()
        if text is None:
            instances = parser.AddModels(str(urdf))
        else:
            instances = parser.AddModelsFromString(text, "urdf")
    except (RuntimeError, ValueError) as error:
        reason = _LITERAL.sub("", " ".join(str(error).split())).removeprefix(f"{urdf}:")
        raise ModelError(f"{urdf} is not a URDF that Drake can read: {reason}") from error
    return instances[0]


def _robot_joints(plant: MultibodyPlant, instance: ModelInstanceIndex) -> list[Joint]:
    """Return the joints that a robot's file names, before or after `Finalize()`."""
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(instance)]
    return [joint for joint in joints if not joint.is_ephemeral()]


@dataclass(frozen=True, eq=False)
class KinematicTree:
    """The links and joints of one robot, in a finalized plant of its own."""

    urdf: Path
    """Where it came from, for messages."""
    plant: MultibodyPlant
    """The robot, as parsed."""
    instance: ModelInstanceIndex
    """The robot's model instance."""
    joint_above: Mapping[str, Joint]
    """Link -> the joint that it hangs on; roots have none."""
    mimics: Mapping[str, tuple[str, float]]
    """Joint -> the one that it follows and the ratio, which Drake's joints do not tell."""

    @classmethod
    def from_urdf(cls, urdf: Path) -> "KinematicTree":
        """Read a URDF; its meshes need not be there.

        Raises:
            ModelError: If the file cannot be read or holds no link.
        """
        if urdf.suffix.lower() != ".urdf":
            raise ModelError(f"{urdf} is not a URDF: its name must end with .urdf")
        document = read_document(urdf)
        check_urdf(document, urdf)
        elements = children(robot_element(document), "joint")
        mimics = {
            element.getAttribute("name"): (
                mimic.getAttribute("joint"),
                float(mimic.getAttribute("multiplier") or 1.0),
            )
            for element in elements
            if (mimic := child(element, "mimic")) is not None
        }
        plant = MultibodyPlant(0.0)
        instance = parse(plant, urdf)
        joint_above = {joint.child_body().name(): joint for joint in _robot_joints(plant, instance)}
        tree = cls(urdf, plant, instance, joint_above, mimics)
        if not tree.links:
            raise ModelError(f"{urdf} describes a robot without links")
        try:
            plant.Finalize()
        except RuntimeError as error:
            reason = " ".join(str(error).split())
            raise ModelError(f"{urdf} is not a robot that Drake can move: {reason}") from error
        return tree

    @property
    def name(self) -> str:
        """The robot's name in its file."""
        return self.plant.GetModelInstanceName(self.instance)

    @property
    def links(self) -> list[str]:
        """Names of all links; `world` if joints hang on it."""
        bodies = self.plant.GetBodyIndices(self.instance)
        names = [self.plant.get_body(index).name() for index in bodies]
        above = {joint.parent_body().name() for joint in self.joint_above.values()}
        return [WORLD, *names] if WORLD in above and WORLD not in names else names

    @property
    def frames(self) -> list[Frame]:
        """All frames of the robot, those of its links too."""
        indices = self.plant.GetFrameIndices(self.instance)
        return [self.plant.get_frame(index) for index in indices]

    @property
    def roots(self) -> list[str]:
        """Names of the links that hang on no joint."""
        return [link for link in self.links if link not in self.joint_above]

    @property
    def leaves(self) -> list[str]:
        """Names of the links that nothing hangs on."""
        above = {joint.parent_body().name() for joint in self.joint_above.values()}
        return [link for link in self.links if link not in above]

    def joint(self, name: str) -> Joint:
        """Return a joint by name.

        Raises:
            ModelError: If there is none; the message lists those there are.
        """
        joints = {joint.name(): joint for joint in self.joint_above.values()}
        if name not in joints:
            raise ModelError(
                f"{self.urdf} has no joint {name!r}; it has {listed(sorted(joints), name)}"
            )
        return joints[name]

    def check_link(self, name: str) -> None:
        """Refuse a link that is not there.

        Raises:
            ModelError: If there is none of this name; the message lists those there are.
        """
        if name not in self.links:
            raise ModelError(
                f"{self.urdf} has no link {name!r}; it has {listed(sorted(self.links), name)}"
            )

    def frame(self, name: str) -> Frame:
        """Return the frame of a link, or a frame of its own, by name.

        Raises:
            ModelError: If there is none; the message lists the links.
        """
        if self.plant.HasFrameNamed(name, self.instance):
            return self.plant.GetFrameByName(name, self.instance)
        if name == WORLD and WORLD in self.links:
            return self.plant.world_frame()
        raise ModelError(
            f"{self.urdf} has no link or frame {name!r}; it has {listed(sorted(self.links), name)}"
        )

    def joints_down_to(self, link: str) -> list[Joint]:
        """Return the joints from the link's root down to it."""
        joints: list[Joint] = []
        while link in self.joint_above:
            joints.append(self.joint_above[link])
            link = joints[-1].parent_body().name()
        return joints[::-1]

    def root_of(self, link: str) -> str:
        """Return the link that a link hangs on in the end."""
        joints = self.joints_down_to(link)
        return joints[0].parent_body().name() if joints else link

    def joints_between(self, base: str, tip: str) -> tuple[list[Joint], list[Joint]]:
        """Return the way from one link to another.

        Args:
            base: Where it starts.

        Returns:
            Joints that are passed upwards from `base`, then those passed downwards to `tip`.

        Raises:
            ModelError: If the links hang on different roots.
        """
        if self.root_of(base) != self.root_of(tip):
            raise ModelError(
                f"{self.urdf} has no path from {base!r} to {tip!r}: the one hangs on "
                f"{self.root_of(base)!r}, the other on {self.root_of(tip)!r}"
            )
        up, down = self.joints_down_to(base), self.joints_down_to(tip)
        while up and down and up[0].name() == down[0].name():
            up, down = up[1:], down[1:]
        return up[::-1], down

    def poses(self, held: Mapping[str, float], link: str, frames: Sequence[Frame]) -> NDArray:
        """Return poses of frames in a link, held joints at their values and all others at zero.

        Args:
            held: Joint -> position [rad or m].
            frames: Frames of this robot. Length k.

        Returns:
            Shape (k, 4, 4).
        """
        q = self.plant.GetDefaultPositions()
        for joint in self.joint_above.values():
            if joint.num_positions() == 1:
                q[joint.position_start()] = held.get(joint.name(), 0.0)
        context = self.plant.CreateDefaultContext()
        self.plant.SetPositions(context, q)
        reference = self.frame(link)
        poses = [self.plant.CalcRelativeTransform(context, reference, frame) for frame in frames]
        return np.stack([x.GetAsMatrix4() for x in poses])

"""A learned body, a tree of joints with markers and sensors, in a Drake plant."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.geometry import Cylinder, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    Frame,
    Joint,
    ModelInstanceIndex,
    PrismaticJoint,
    QuaternionFloatingJoint,
    RevoluteJoint,
    SpatialInertia,
)

from nico_selfmodel.errors import ModelError, check_kind
from nico_selfmodel.geometry.rotation import frame_along
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import FLANGE, REVOLUTE, WORLD, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.names import listed, refuse_unknown
from nico_selfmodel.plant.frames import add_frame, couple, frame_names
from nico_selfmodel.plant.kinematic_tree import rigid
from nico_selfmodel.plant.model_in_plant import (
    ModelInPlant,
    check_finite,
    check_open,
    parent_frame,
)

_Z = [0.0, 0.0, 1.0]
_GREY, _THICKNESS = [0.55, 0.62, 0.70, 1.0], 0.06
"""How links are drawn: their colour, and their radius as a share of the longest."""
_MASS, _RADIUS = 1.0, 0.05
"""Of every link [kg, m]: invented, since nothing tells them; a plant without masses cannot move."""


@dataclass(frozen=True, eq=False)
class BodyPlant(ModelInPlant):
    """A learned body in a plant: joints, markers and sensors stand where it has them.

    Joints keep their limits (`BodyModel.reach`), and what follows one other joint is coupled to it,
    where the plant's solver can: a discrete plant's with SAP, Drake's default.

    Links have the names of their joints. Where there is a scene graph they are drawn as balls, with
    rods to what they carry; the masses, 1 kg each, are invented, so that motion under forces means
    nothing. Markers and sensors are frames of their own names. A joint that is read as a flange's
    pose floats.
    """

    tree: BodyTree
    """The body that new contexts hold."""

    @classmethod
    def add_to(
        cls,
        plant: MultibodyPlant,
        model: BodyModel,
        *,
        name: str | None = None,
        frame: Frame | None = None,
    ) -> "BodyPlant":
        """Add a body to a plant of one's own, beside whatever is in it.

        Args:
            plant: It, before `Finalize()`.
            model: What new contexts hold.
            name: Of its model instance; the model's name if omitted.
            frame: The frame of the plant that is the body's world; the plant's world if omitted.

        Returns:
            The body, with which readings and other bodies are written into contexts.

        Raises:
            ModelError: If the plant is finalized, has a model of this name, or not this frame, or
                two frames of the body would have one name.
            TypeError: If it is no body.
        """
        check_kind(model, BodyModel, "give a body; a self-model is in a plant by SelfModelPlant")
        name, tree = name or model.name, model.tree
        check_open(plant, name)
        _check_names(tree)
        root = parent_frame(plant, frame)
        instance = plant.AddModelInstance(name)
        links: list[Frame] = []
        inertia = SpatialInertia.SolidSphereWithMass(_MASS, _RADIUS)
        for i, joint in enumerate(tree.joints):
            links.append(plant.AddRigidBody(joint, instance, inertia).body_frame())
            parent = root if tree.parent[i] == WORLD else links[tree.parent[i]]
            F = add_frame(plant, instance, frame_names(joint)[0], parent, tree.X_PJ[i])
            added = plant.AddJoint(_joint(joint, tree.motions[i], F, links[i]))
            if tree.motions[i] != FLANGE:
                added.set_position_limits(*model.reach[:, i : i + 1])
        _couple(plant, instance, tree)
        for item in (*tree.markers, *tree.sensors):
            on = root if item.on == WORLD else links[item.on]
            add_frame(plant, instance, item.name, on, item.X_LA)
        if plant.geometry_source_is_registered():
            _draw(plant, tree, links)
        return cls(plant, instance, tree)

    def write(self, context: Any, model: BodyModel) -> None:
        """Write a body into a context; other contexts stay as they are.

        Args:
            context: The plant's context, or the root context of its diagram.
            model: A body of the same joints, markers and sensors.

        Raises:
            ModelError: If it has others, or they hang on other links.
        """
        mine, other = _structure(self.tree), _structure(model.tree)
        if mine != other:
            strange = sorted(k for k in {*mine, *other} if mine.get(k) != other.get(k))
            raise ModelError(
                f"body {model.name!r} is not the one in the plant: they differ in {listed(strange)}"
            )
        tree = model.tree
        poses = dict(zip([frame_names(joint)[0] for joint in tree.joints], tree.X_PJ, strict=True))
        poses |= {item.name: item.X_LA for item in (*tree.markers, *tree.sensors)}
        self.write_poses(context, [(self.frame(name), X) for name, X in poses.items()])

    def set_readings(
        self,
        context: Any,
        readings: ArrayLike,
        flanges: NDArray | None = None,
        model: BodyModel | None = None,
    ) -> None:
        """Move all joints in a context to what was read: q = coupling (readings / gear).

        Of a body that bends the joints go to where its own weight turns them, and the joint frames
        to where its bearings give way: the plant is then right at these readings alone.

        Args:
            context: The plant's context, or the root context of its diagram.
            readings: Encoder angles [rad] or lengths [m] (`BodyModel.readings`), zero where a joint
                has no encoder. Shape (n,).
            flanges: Poses that controllers read, used where a joint is one. Shape (n, 4, 4).
            model: Whose gears and coupling to use, and what bends: the body that was written into
                the context. The one that the plant was built with if omitted.

        Raises:
            ValueError: If `readings` is not n finite numbers, or a flange's pose is missing.
        """
        tree, n = self.tree if model is None else model.tree, len(self.tree.joints)
        readings = np.asarray(readings)
        if readings.shape != (n,):
            raise ValueError(f"readings must have shape ({n},), got {readings.shape}")
        check_finite(tree.joints, readings)
        turning = [i for i in range(n) if tree.motions[i] != FLANGE]
        carried = sorted(set(range(n)) - set(turning))
        _check_flanges(tree, carried, flanges)
        q = tree.displacements(readings)
        if tree.bending is not None:
            motion = TreeMotion.at(tree, readings[None], None if flanges is None else flanges[None])
            q = motion.q[:, 0]
            self._give_way(context, tree, motion)
        self.move_joints(context, [tree.joints[i] for i in turning], q[turning])
        own = self.own_context(context)
        for i in carried:
            assert flanges is not None
            joint: Any = self.plant.GetJointByName(tree.joints[i], self.instance)
            joint.SetPose(own, self.rigid(flanges[i]))

    def _give_way(self, context: Any, tree: BodyTree, motion: TreeMotion) -> None:
        """Write joint frames where bearings have turned them."""
        if motion.load is None or motion.load.bearings is None:
            return
        frames = (self.plant.GetFrameByName(frame_names(j)[0], self.instance) for j in tree.joints)
        X_PJ = tree.X_PJ @ motion.load.bearings[:, 0]
        self.write_poses(context, zip(frames, X_PJ, strict=True))

    def frame(self, name: str) -> Any:
        """Return the frame of a marker or a sensor.

        Raises:
            ValueError: If there is none of this name; the message lists those there are.
        """
        if not self.plant.HasFrameNamed(name, self.instance):
            names = [item.name for item in (*self.tree.markers, *self.tree.sensors)]
            refuse_unknown("marker or sensor", name, names)
        return self.plant.GetFrameByName(name, self.instance)


def _check_names(tree: BodyTree) -> None:
    """Refuse a body of which two frames would have one name in a plant.

    Raises:
        ModelError: If there are such.
    """
    items = [item.name for item in (*tree.markers, *tree.sensors)]
    names = Counter([*tree.joints, *(frame_names(joint)[0] for joint in tree.joints), *items])
    if twice := [name for name, count in names.items() if count > 1]:
        raise ModelError(
            f"two frames of the body would be called {twice[0]!r} in a plant, where joints have "
            "one of their name and one with _F: rename the marker, sensor or joint"
        )


def _couple(plant: MultibodyPlant, instance: ModelInstanceIndex, tree: BodyTree) -> None:
    """Couple joints that follow one other, which follows none, to it."""
    plain = np.eye(len(tree.joints))
    for i, row in enumerate(np.asarray(tree.coupling)):
        leaders = np.flatnonzero(row).tolist()
        if len(leaders) != 1 or leaders == [i]:
            continue
        (j,) = leaders
        turning = FLANGE not in (tree.motions[i], tree.motions[j])
        if turning and np.array_equal(tree.coupling[j], plain[j]):
            ours, led_by = (plant.GetJointByName(tree.joints[k], instance) for k in (i, j))
            couple(plant, ours, led_by, float(row[j]))


def _check_flanges(tree: BodyTree, carried: Sequence[int], flanges: NDArray | None) -> None:
    """Refuse flanges, joints of these numbers, whose poses are not there, or not finite."""
    for i in carried:
        where = f"joint {tree.joints[i]!r} is a flange"
        if flanges is None or np.shape(flanges) != (len(tree.joints), 4, 4):
            raise ValueError(f"{where}: give flanges, (n, 4, 4)")
        if not np.isfinite(flanges[i]).all():
            raise ValueError(f"{where}: its pose must be finite")


def _joint(name: str, motion: str, F: Frame, link: Frame) -> Joint:
    if motion == FLANGE:
        return QuaternionFloatingJoint(name, F, link)
    kind = RevoluteJoint if motion == REVOLUTE else PrismaticJoint
    return kind(name, F, link, _Z)


def _draw(plant: MultibodyPlant, tree: BodyTree, links: list[Frame]) -> None:
    """Draw each link as a ball at its joint, with rods to the joints and markers it carries."""
    joints = zip(tree.parent.tolist(), tree.X_PJ[:, :3, 3], strict=True)
    rods = [(on, p) for on, p in joints if on != WORLD]
    rods += [(marker.on, marker.X_LA[:3, 3]) for marker in tree.markers if marker.on != WORLD]
    lengths = [float(np.linalg.norm(p)) for _, p in rods]
    radius = _THICKNESS * max(lengths, default=_RADIUS)
    for i, link in enumerate(links):
        ball = Sphere(radius)
        plant.RegisterVisualGeometry(link.body(), RigidTransform(), ball, f"ball{i}", _GREY)
    for k, ((on, p), length) in enumerate(zip(rods, lengths, strict=True)):
        if length > radius:
            z = p / length
            X = transform(frame_along(z), 0.5 * p)
            rod = Cylinder(0.6 * radius, length)
            plant.RegisterVisualGeometry(links[on].body(), rigid(X), rod, f"rod{k}", _GREY)


def _structure(tree: BodyTree) -> dict[str, Any]:
    """Return what a plant cannot change: what there is, and what it hangs on."""
    joints = zip(tree.joints, tree.motions, tree.parent.tolist(), strict=True)
    parts: dict[str, Any] = {name: (motion, parent) for name, motion, parent in joints}
    return parts | {item.name: item.on for item in (*tree.markers, *tree.sensors)}

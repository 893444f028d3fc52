"""An arm beside the body that carries it: where its finger ends, how far the rest stays away."""

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.geometry import (
    Capsule,
    CollisionFilterDeclaration,
    GeometryInstance,
    GeometrySet,
    ProximityProperties,
    Role,
    SceneGraph,
    Sphere,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import DiagramBuilder

from nico_selfmodel.arrays import read_only
from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.shape.link_shape import BodyShape
from nico_selfmodel.names import listed
from nico_selfmodel.plant.description import ArmDescription
from nico_selfmodel.plant.kinematic_tree import rigid
from nico_selfmodel.plant.link_surfaces import LinkSurface, link_surfaces
from nico_selfmodel.plant.self_model_plant import SelfModelPlant
from nico_selfmodel.plant.touching.learned_body import seen_balls

_FAR = 0.1
"""Distance from which on nobody asks how far it is [m]."""


@dataclass(frozen=True, eq=False)
class Finger:
    """A finger as a collision capsule: it ends with half a ball, which is what touches."""

    link: str
    """Link that it is."""
    p_FE: NDArray
    """Centre of the ball in the link's frame [m]. Shape (3,)."""
    radius: float
    """Of the ball [m]."""
    way: NDArray
    """Where it points, of unit length. Shape (3,)."""


class PosedArm:
    """A learned arm and the body that carries it, with the description's collision shapes.

    The arm stands as a self-model has it, in the model's world W; all else as the description has
    it, but for joints that are said to stand elsewhere. What was seen of the body counts beside
    that (`seen_balls`), where it was learned, and in `as_drawn` what is drawn of it. The finger and
    the link next to the body, which always touches it, do not count as near; nor does the arm to
    itself, whose joints' limits keep it apart.
    """

    def __init__(
        self,
        arm: ArmDescription,
        model: SelfModel,
        finger: str,
        held: Mapping[str, float] | None = None,
        shape: BodyShape | None = None,
        X_WB: NDArray | None = None,
    ) -> None:
        """Build it.

        Args:
            model: The arm as it is known.
            finger: Link beyond the arm whose collision shape is one capsule.
            held: Joint -> angle where one that nobody commands stands elsewhere [rad].
            shape: What the robot has learned of the surfaces of its links.
            X_WB: Where these stand, of where the learned arm has them. Shape (4, 4).

        Raises:
            ModelError: If the model has other joints, the link is no finger of that arm, or the
                shape is of other links.
        """
        builder = DiagramBuilder()
        self._built = SelfModelPlant.from_urdf(arm, model, builder=builder)
        scene = self._built.scene_graph
        assert scene is not None
        self._scene: SceneGraph = scene
        self.arm, self.model = arm, model
        self.moving = frozenset(self._moved())
        self.finger = _finger(self._built, scene, finger, self.moving)
        self.surfaces: dict[str, LinkSurface] = link_surfaces(scene, self._built)
        """Link -> its surface, where that is made of simple solids."""
        self._diagram = builder.Build()
        self._held = dict(held or {})
        self._shape, self._X_WB = shape, np.eye(4) if X_WB is None else X_WB
        self._stand(drawn=False)

    def as_drawn(self) -> "PosedArm":
        """Return the same arm, posed by itself, beside the body as it is drawn.

        Collision shapes lie up to 8 mm below what is drawn of a body, and leave out hair and cases.
        Distances of so many shapes take several times as long.
        """
        other = copy(self)
        other._stand(drawn=True)
        return other

    def _stand(self, *, drawn: bool) -> None:
        """Make a context in which held joints stand where they do, and collide what shall."""
        self._root = self._diagram.CreateDefaultContext()
        self._own = self._built.own_context(self._root)
        if self._held:
            self._built.move_joints(self._own, self._held, list(self._held.values()))
        bodies = [self.plant.get_body(k) for k in self.plant.GetBodyIndices(self._built.instance)]
        own: dict[str, list[Any]] = {}
        for body in bodies:
            own[body.name()] = self.plant.GetCollisionGeometriesForBody(body)
            if drawn and body.name() not in self.moving:
                own[body.name()] += self._drawn(body)
        if self._shape is not None:
            self._shape.check_links(own)
            for body in bodies:
                if body.name() in self._shape.links and body.name() not in self.moving:
                    own[body.name()] += self._seen(body, self._shape)
        self._filter(own)

    @property
    def plant(self) -> MultibodyPlant:
        """What the robot is in."""
        return self._built.plant

    @property
    def context(self) -> Any:
        """The plant's own context, in which the arm is posed."""
        return self._own

    @property
    def finger_frame(self) -> Frame:
        """Frame of the finger's link."""
        return self.plant.GetFrameByName(self.finger.link, self._built.instance)

    @property
    def columns(self) -> NDArray:
        """Where the arm's joints stand among the plant's positions. Shape (n,)."""
        return self._built.columns

    def pose(self, q: ArrayLike) -> None:
        """Turn the arm's joints to angles [rad]. Shape (n,)."""
        self._built.set_joint_angles(self._own, q)

    def read(self, readings: ArrayLike) -> NDArray:
        """Turn the arm's joints to where readings have them, and return these angles [rad].

        Args:
            readings: Of the encoders [encoder units]. Shape (n,).
        """
        self._built.set_positions(self._own, readings)
        return self.plant.GetPositions(self._own)[self.columns]

    def link_pose(self, link: str) -> NDArray:
        """Return where a link is as the robot stands. Shape (4, 4).

        Raises:
            ModelError: If there is no such link.
        """
        if not self.plant.HasBodyNamed(link, self._built.instance):
            raise ModelError(f"the robot has no link {link!r}: give one of its description")
        body = self.plant.GetBodyByName(link, self._built.instance)
        return np.asarray(self.plant.EvalBodyPoseInWorld(self._own, body).GetAsMatrix4())

    def finger_end(self) -> tuple[NDArray, NDArray]:
        """Return the centre of the ball it ends with [m], and where it points. Shapes (3,)."""
        X_WF = self.link_pose(self.finger.link)
        return apply(X_WF, self.finger.p_FE[None])[0], X_WF[:3, :3] @ self.finger.way

    def clearance(self) -> tuple[float, str]:
        """Return how far the arm is from the body, at most 0.1 m, and which links are so near."""
        query: Any = self._scene.get_query_output_port().Eval(
            self._scene.GetMyContextFromRoot(self._root)
        )
        try:
            pairs = query.ComputeSignedDistancePairwiseClosestPoints(_FAR)
            distances = [float(pair.distance) for pair in pairs]
        except RuntimeError:
            # Of some shapes that lie one inside the other FCL tells how deep, and no distance.
            pairs = query.ComputePointPairPenetration()
            distances = [-float(pair.depth) for pair in pairs]
            if not pairs:  # they do by next to nothing
                return 0.0, "links that touch"
        if not pairs:
            return _FAR, "nothing"
        least = int(np.argmin(distances))
        nearest = pairs[least]
        inspector = query.inspector()
        frames = [inspector.GetFrameId(one) for one in (nearest.id_A, nearest.id_B)]
        links = [self.plant.GetBodyFromFrameId(frame).name() for frame in frames]
        return distances[least], " and ".join(sorted(links))

    def clearance_on(self, readings: NDArray) -> tuple[float, str]:
        """Return the least `clearance` of postures, and between which links.

        Args:
            readings: Of the encoders in each [encoder units]. Shape (N, n).
        """
        near = []
        for one in readings:
            self.read(one)
            near.append(self.clearance())
        return min(near)

    def _moved(self) -> list[str]:
        """Return the names of the links that the arm moves."""
        joint = self.plant.GetJointByName(self.arm.joints[0], self._built.instance)
        found = self.plant.GetBodiesKinematicallyAffectedBy([joint.index()])
        return [self.plant.get_body(index).name() for index in found]

    def _seen(self, body: Any, shape: BodyShape) -> list[Any]:
        """Let collide what was seen of a link, and return the ids of these shapes."""
        balls = [(ball.X_FS, Sphere(ball.size[0])) for ball in seen_balls(shape.links[body.name()])]
        return self._add(body, "seen", balls)

    def _drawn(self, body: Any) -> list[Any]:
        """Let collide what is drawn of a link, if that is simple; return the ids of its shapes."""
        if body.name() not in self.surfaces:
            return []
        inspector = self._scene.model_inspector()
        ids = inspector.GetGeometries(self.surfaces[body.name()].frame, Role.kPerception)
        shapes = [
            (inspector.GetPoseInFrame(one).GetAsMatrix4(), inspector.GetShape(one)) for one in ids
        ]
        return self._add(body, "drawn", shapes)

    def _add(self, body: Any, name: str, shapes: list[tuple[NDArray, Any]]) -> list[Any]:
        """Let shapes collide as parts of a link, in this context only; return their ids.

        They stand where the robot found that its body stands, of where the arm has it.
        """
        frame, source = self.plant.GetBodyFrameIdOrThrow(body.index()), self.plant.get_source_id()
        context = self._scene.GetMyMutableContextFromRoot(self._root)
        X_WF = self.link_pose(body.name())
        X_FG = inverse(X_WF) @ self._X_WB @ X_WF
        found = []
        for k, (X_GS, shape) in enumerate(shapes):
            one = GeometryInstance(rigid(X_FG @ X_GS), shape, f"{name}_{k}")
            one.set_proximity_properties(ProximityProperties())
            found.append(self._scene.RegisterGeometry(context, source, frame, one))
        return found

    def _filter(self, own: dict[str, list[Any]]) -> None:
        """Let distances between arm and body be measured, and no others.

        Args:
            own: Link -> ids of all its shapes.
        """
        instance = self._built.instance
        first = self.plant.GetJointByName(self.arm.joints[0], instance).child_body().name()
        near = {first, self.finger.link}
        moving = GeometrySet([g for k in sorted(self.moving - near) for g in own[k]])
        still = GeometrySet([g for k, v in own.items() if k not in self.moving for g in v])
        left_out = GeometrySet([g for k in sorted(near) for g in own[k]])
        manager = self._scene.collision_filter_manager(
            self._scene.GetMyMutableContextFromRoot(self._root)
        )
        manager.Apply(
            CollisionFilterDeclaration()
            .ExcludeWithin(moving)
            .ExcludeWithin(still)
            .ExcludeWithin(left_out)
            .ExcludeBetween(left_out, still)
            .ExcludeBetween(left_out, moving)
        )


def _finger(built: SelfModelPlant, scene: SceneGraph, link: str, moving: frozenset[str]) -> Finger:
    """Return a finger by the capsule of its link.

    Raises:
        ModelError: If it is none.
    """
    if link not in moving:
        raise ModelError(f"{link!r} is no link that the arm moves: give one of {listed(moving)}")
    inspector = scene.model_inspector()
    body = built.plant.GetBodyByName(link, built.instance)
    frame = built.plant.GetBodyFrameIdOrThrow(body.index())
    drawn = inspector.GetGeometries(frame, Role.kProximity)
    shapes = [(inspector.GetShape(one), inspector.GetPoseInFrame(one)) for one in drawn]
    if len(shapes) != 1 or not isinstance(shapes[0][0], Capsule):
        raise ModelError(
            f"{link!r} touches nothing: a finger's collision shape must be one capsule"
        )
    capsule, X_FS = shapes[0][0], shapes[0][1].GetAsMatrix4()
    half = 0.5 * capsule.length() * X_FS[:3, 2]
    ends = X_FS[:3, 3] + np.stack([half, -half])
    k = int(np.argmax(np.linalg.norm(ends, axis=1)))
    way = (half if k == 0 else -half) / np.linalg.norm(half)
    return Finger(link, read_only(ends[k]), float(capsule.radius()), read_only(way))

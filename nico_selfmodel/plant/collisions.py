"""A robot's collision shapes: whether a pose touches the body, whether it covers a point."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import SceneGraph
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.plant import ArmDescription, SelfModelPlant
from nico_selfmodel.plant.body_description import BodyDescription
from nico_selfmodel.plant.model_in_plant import ModelInPlant

_STEP, _CASE = 0.008, 0.08
"""From place to place on a line of sight, and about a camera, where nothing counts [m]."""


class CollisionShapes:
    """A robot's collision shapes, posed by some of its joints; the other joints are held."""

    def __init__(self, arm: ArmDescription | BodyDescription) -> None:
        """Build the shapes.

        Args:
            arm: The robot and the arm that moves, or the body whose commanded joints do.
        """
        builder = DiagramBuilder()
        self._built, scene, self._base = _built(arm, builder)
        self._joints = arm.joints
        self._diagram: Diagram = builder.Build()
        self._root: Context = self._diagram.CreateDefaultContext()
        self._own = self._built.own_context(self._root)
        if isinstance(arm, BodyDescription) and arm.held:
            self._built.move_joints(self._own, arm.held, list(arm.held.values()))
        self._query = scene.get_query_output_port()
        self._scene = scene.GetMyContextFromRoot(self._root)
        self._moving = set[Any]().union(*map(self._geometries_beyond, arm.joints))
        # Neighbours touch where a joint joins them; that is no collision.
        self._touching = self._pairs(0.5 * (arm.lower + arm.upper)) & self._pairs(arm.upper)

    def pose(self, link: str) -> NDArray:
        """Return a link's pose in the arm's base, which must not depend on the arm. (4, 4)."""
        plant = self._built.plant
        base = plant.GetFrameByName(self._base, self._built.instance)
        frame = plant.GetFrameByName(link, self._built.instance)
        return np.asarray(plant.CalcRelativeTransform(self._own, base, frame).GetAsMatrix4())

    def collides(self, q: NDArray) -> bool:
        """Return whether the arm touches the body or itself.

        Args:
            q: Joint angles of the description [rad]. Shape (n,).
        """
        return bool(self._pairs(q) - self._touching)

    def covers(self, q: NDArray, p_BQ: NDArray, room: float) -> bool:
        """Return whether a point is inside the robot or nearer to it than some room.

        Args:
            q: Joint angles of the description [rad]. Shape (n,).
            p_BQ: Points in the arm's base [m]. Shape (k, 3).
            room: Least distance that leaves a point uncovered [m].
        """
        query = self._posed(q)
        plant = self._built.plant
        base = plant.GetFrameByName(self._base, self._built.instance)
        X_WB = base.CalcPoseInWorld(self._own).GetAsMatrix4()
        return any(query.ComputeSignedDistanceToPoint(p, room) for p in apply(X_WB, p_BQ))

    def hides(self, q: NDArray, card: str, p_BQ: NDArray, p_BC: NDArray, room: float) -> bool:
        """Return whether the robot stands between a card on it and a camera.

        Args:
            q: Joint angles of the description [rad]. Shape (n,).
            card: Frame of the card; the link that carries it does not count.
            p_BQ: Points of the card in the arm's base [m]. Shape (k, 3).
            p_BC: The camera there, whose own case does not count [m]. Shape (3,).
            room: Least distance from a line of sight [m]; shapes are thinner than what is drawn.
        """
        query, plant = self._posed(q), self._built.plant
        carrier = plant.GetFrameByName(card, self._built.instance).body()
        own = {
            geometry
            for body in plant.GetBodiesWeldedTo(carrier)
            for geometry in plant.GetCollisionGeometriesForBody(body)
        }
        base = plant.GetFrameByName(self._base, self._built.instance)
        X_WB = base.CalcPoseInWorld(self._own).GetAsMatrix4()
        for p in p_BQ:
            way = p_BC - p
            length = float(np.linalg.norm(way))
            steps = np.arange(0.0, length - _CASE, _STEP)[:, None] * way / length
            near = (query.ComputeSignedDistanceToPoint(at, room) for at in apply(X_WB, p + steps))
            if any(shape.id_G not in own for shapes in near for shape in shapes):
                return True
        return False

    def _posed(self, q: NDArray) -> Any:
        """Return the scene graph's query object with the arm at a pose."""
        self._built.move_joints(self._own, self._joints, q)
        return self._query.Eval(self._scene)

    def _pairs(self, q: NDArray) -> set[frozenset[Any]]:
        return {
            frozenset((pair.id_A, pair.id_B))
            for pair in self._posed(q).ComputePointPairPenetration()
            if pair.id_A in self._moving or pair.id_B in self._moving
        }

    def _geometries_beyond(self, joint: str) -> set[Any]:
        """Return the collision shapes that the arm's joints move."""
        plant = self._built.plant
        first = plant.GetJointByName(joint, self._built.instance).child_body()
        moved, grown = {first.index()}, True
        joints = [plant.get_joint(index) for index in plant.GetJointIndices(self._built.instance)]
        while grown:
            beyond = {j.child_body().index() for j in joints if j.parent_body().index() in moved}
            grown = not beyond <= moved
            moved |= beyond
        return {
            geometry
            for index in moved
            for geometry in plant.GetCollisionGeometriesForBody(plant.get_body(index))
        }


def _built(
    arm: ArmDescription | BodyDescription, builder: DiagramBuilder
) -> tuple[ModelInPlant, SceneGraph, str]:
    """Add a robot as described; return it, what holds its shapes, and the name of its base."""
    if isinstance(arm, BodyDescription):
        scene = SceneGraph()
        builder.AddNamedSystem("scene", scene)
        built = arm.built(arm.tree, scene)
        plant = built.plant
        builder.AddNamedSystem("plant", plant)
        poses = plant.get_geometry_pose_output_port()
        builder.Connect(poses, scene.get_source_pose_port(plant.get_source_id()))
        return built, scene, arm.root
    robot = SelfModelPlant.from_urdf(arm, builder=builder)
    assert robot.scene_graph is not None
    return robot, robot.scene_graph, arm.base_link

"""A robot's collision shapes: whether a pose touches the body, whether it covers a point."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.plant import ArmDescription, SelfModelPlant


class CollisionShapes:
    """A robot's collision shapes, posed by the joints of one arm; the other joints are held."""

    def __init__(self, arm: ArmDescription) -> None:
        """Build the shapes.

        Args:
            arm: The robot and the arm that moves.
        """
        builder = DiagramBuilder()
        self._built = SelfModelPlant.from_urdf(arm, builder=builder)
        self._diagram: Diagram = builder.Build()
        self._root: Context = self._diagram.CreateDefaultContext()
        self._own = self._built.own_context(self._root)
        scene = self._built.scene_graph
        assert scene is not None
        self._query = scene.get_query_output_port()
        self._scene = scene.GetMyContextFromRoot(self._root)
        self._moving = self._geometries_beyond(arm.joints[0])
        # Neighbours touch where a joint joins them; that is no collision.
        self._touching = self._pairs(0.5 * (arm.lower + arm.upper)) & self._pairs(arm.upper)

    def pose(self, link: str) -> NDArray:
        """Return a link's pose in the arm's base, which must not depend on the arm. (4, 4)."""
        plant = self._built.plant
        base = plant.GetFrameByName(self._built.arm.base_link, self._built.instance)
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
        base = plant.GetFrameByName(self._built.arm.base_link, self._built.instance)
        X_WB = base.CalcPoseInWorld(self._own).GetAsMatrix4()
        return any(query.ComputeSignedDistanceToPoint(p, room) for p in apply(X_WB, p_BQ))

    def _posed(self, q: NDArray) -> Any:
        """Return the scene graph's query object with the arm at a pose."""
        self._built.set_joint_angles(self._own, q)
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

"""What is learned, in a plant: its contexts, whatever their numbers, and what they are told."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.autodiffutils import AutoDiffXd
from pydrake.math import RigidTransform_, RotationMatrix_
from pydrake.multibody.plant import MultibodyPlant, MultibodyPlant_
from pydrake.multibody.tree import Frame, ModelInstanceIndex
from pydrake.symbolic import Expression

from nico_selfmodel.errors import ModelError
from nico_selfmodel.plant.frames import movable_pose
from nico_selfmodel.plant.kinematic_tree import rigid

_SCALARS = (float, AutoDiffXd, Expression)


@dataclass(frozen=True, eq=False)
class ModelInPlant:
    """A model instance of a plant, and how to reach it in contexts."""

    plant: MultibodyPlant
    """What the model is in."""
    instance: ModelInstanceIndex
    """Its model instance."""

    @property
    def name(self) -> str:
        """Name of the model instance."""
        return self.plant.GetModelInstanceName(self.instance)

    def in_plant(self, plant: Any) -> Self:
        """Return the same model in a converted plant: `ToAutoDiffXd`, `ToSymbolic`, or a clone.

        Held joints start at their values there too: Drake (1.51) forgets them in contexts of a
        plant that was converted, so their defaults are set anew. Make contexts after this.

        Raises:
            ModelError: If the model is not in that plant.
        """
        if not plant.HasModelInstanceNamed(self.name):
            raise ModelError(
                f"the plant has no model {self.name!r}: give a conversion of its own plant"
            )
        if self.scalar is float:
            plant.SetDefaultPositions(self.plant.GetDefaultPositions())
        return replace(self, plant=plant, instance=plant.GetModelInstanceByName(self.name))

    def own_context(self, context: Any) -> Any:
        """Return the plant's part of a root context; the plant's own context as it is.

        Raises:
            ValueError: If the context belongs neither to the plant nor to its diagram.
        """
        if context is not None and self._is_own(context):
            return context
        try:
            # Drake (1.51) ends the process over a root context that is None.
            own = context and self.plant.GetMyMutableContextFromRoot(context)
        except (RuntimeError, TypeError):  # a context of other scalars is a TypeError
            own = None
        if own is None or not self._is_own(own):
            raise ValueError(
                "context belongs to another plant or diagram; for one that was converted or "
                "cloned, take the robot by in_plant(plant)"
            )
        return own

    def _is_own(self, context: Any) -> bool:
        """Return whether a context is the plant's own."""
        try:
            self.plant.ValidateContext(context)
        except (RuntimeError, TypeError):
            return False
        return True

    def move_joints(self, context: Any, joints: Iterable[str], positions: ArrayLike) -> None:
        """Move joints of one degree of freedom in a context; all others stay.

        Args:
            context: The plant's context, or the root context of its diagram.
            joints: Their names. Length k.
            positions: [rad or m], of the plant's scalars or floats. Shape (k,).

        Raises:
            ValueError: If a position is not finite.
        """
        own, T = self.own_context(context), self.scalar
        joints, positions = list(joints), np.asarray(positions)
        check_finite(joints, positions)
        values = self.plant.GetPositions(own).copy()
        values[self.columns_of(joints)] = [x if isinstance(x, T) else T(x) for x in positions]
        self.plant.SetPositions(own, values)

    def columns_of(self, joints: Iterable[str]) -> NDArray:
        """Return where joints stand among the plant's positions. Shape (k,).

        Raises:
            ModelError: If the plant is not finalized.
        """
        if not self.plant.is_finalized():
            raise ModelError("positions are dealt out by Finalize(): call it on the plant first")
        found = [self.plant.GetJointByName(name, self.instance) for name in joints]
        return np.array([joint.position_start() for joint in found])

    def write_poses(self, context: Any, poses: Iterable[tuple[Any, NDArray]]) -> None:
        """Write frames and their poses in their parents, shape (4, 4), into a context."""
        own = self.own_context(context)
        for frame, pose in poses:
            frame.SetPoseInParentFrame(own, self.rigid(movable_pose(pose)))

    @property
    def scalar(self) -> Any:
        """The numbers that the plant is made of: `float`, `AutoDiffXd` or `Expression`."""
        return next(T for T in _SCALARS if isinstance(self.plant, MultibodyPlant_[T]))

    def rigid(self, pose: NDArray) -> Any:
        """Return a pose, of the plant's numbers or of floats, in the plant's. Shape (4, 4)."""
        T = self.scalar
        if pose.dtype == object:
            return RigidTransform_[T](RotationMatrix_[T](pose[:3, :3]), pose[:3, 3])
        return rigid(pose) if T is float else RigidTransform_[float](pose).cast[T]()


def check_finite(joints: Sequence[str], positions: NDArray) -> None:
    """Refuse positions, or readings, over which Drake (1.51) would end the process.

    Raises:
        ValueError: If one is nan or infinite.
    """
    for name, x in zip(joints, positions, strict=True):
        value = x.value() if isinstance(x, AutoDiffXd) else x
        if not isinstance(value, Expression) and not np.isfinite(value):
            raise ValueError(f"joint {name!r} must go to a finite position, got {value}")


def parent_frame(plant: MultibodyPlant, frame: Frame | None) -> Frame:
    """Return what a model shall hang on, the world if nothing is said.

    Raises:
        ModelError: If the frame belongs to another plant.
    """
    if frame is None:
        return plant.world_frame()
    if frame.GetParentPlant() is not plant:
        raise ModelError(f"frame {frame.name()!r} belongs to another plant")
    return frame


def check_open(plant: MultibodyPlant, *names: str) -> None:
    """Refuse a plant that takes no more models, or has one of these names.

    Raises:
        ModelError: In these cases.
    """
    if plant.is_finalized():
        raise ModelError("the plant is finalized already: add the self-model before Finalize()")
    if taken := [name for name in names if plant.HasModelInstanceNamed(name)]:
        raise ModelError(f"the plant has a model {taken[0]!r} already: give this one another name")

"""An arm and two cameras with boards, as the ladder asks them what bends."""

from dataclasses import dataclass

from numpy.typing import NDArray

from nico_selfmodel.estimation.body.arm_parameters import ArmParameters
from nico_selfmodel.estimation.tree.bending_tree import BendingTree
from nico_selfmodel.estimation.tree.weighed_tree import TreePosture
from nico_selfmodel.model.arm.bending import Bending
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.arm.uniform_rods import load_sigmas, uniform_rods


@dataclass(frozen=True, eq=False)
class BendingBody(BendingTree):
    """Arm and cameras at their rigid solution: a tree whose arm is told by rows."""

    @property
    def _table(self) -> DhTable:
        posture = self.posture
        assert isinstance(posture.parameters, ArmParameters)
        return posture.parameters.arm_of(posture.values).table

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the arm's, boards left out."""
        return self._table.joints

    def rods(self) -> tuple[NDArray, NDArray]:
        """Return loads and pivots of uniform rods."""
        return uniform_rods(self._table)

    def load_sigmas(self) -> NDArray:
        """Return how far loads may be from those of rods."""
        return load_sigmas(self._table)

    def names_of(self, bending: Bending, effect: str) -> tuple[str, ...]:
        """Return an effect's numbers: an arm may have all."""
        return bending.names_of(effect)

    def moments(self, posture: TreePosture) -> NDArray:
        """Return `Bending.moments` of the arm's joints. Shape (n, N, 3)."""
        return super().moments(posture)[: len(self.joints)]

"""Where joints are once the arm bends under its own weight, as a system."""

from typing import Any

from pydrake.systems.framework import (
    BasicVector_,  # pyright: ignore[reportAttributeAccessIssue]
    LeafSystem_,  # pyright: ignore[reportAttributeAccessIssue]
)
from pydrake.systems.scalar_conversion import TemplateSystem

from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.systems.scalars import of_scalars, quiet


@TemplateSystem.define("LoadedAngles_")
def LoadedAngles_(T: Any) -> Any:
    """Return `LoadedAngles` for floats, `AutoDiffXd` or `Expression`."""

    class LoadedAngles(LeafSystem_[T]):
        """Angles to which the joints turn, sag, ripple and coupling included; quasi-static.

        What a plant's positions are at encoder readings. Bearings that give way move the joints'
        frames besides: those are written by `SelfModelPlant.set_positions`.

        | port | | carries |
        |---|---|---|
        | `encoders` | in | encoder readings, in the encoders' units |
        | `q_loaded` | out | angles of the joints [rad] |
        """

        def _construct(self, model: SelfModel, *, converter: Any = None) -> None:
            """Take a self-model; one that does not bend gives its servo map's angles."""
            LeafSystem_[T].__init__(self, converter)
            self.model = model
            n = len(model.joints)
            self._readings = self.DeclareVectorInputPort("encoders", n)
            needs = {self._readings.ticket()}
            self.DeclareVectorOutputPort("q_loaded", BasicVector_[T](n), self._load, needs)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            self._construct(other.model, converter=converter)

        @quiet
        def _load(self, context: Any, vector: Any) -> None:
            q = self.model.servos.to_joint(self._readings.Eval(context))
            vector.SetFromVector(of_scalars(T, self.model.posture(q).q))

    return LoadedAngles


LoadedAngles: Any = LoadedAngles_[None]
"""The system of floats."""

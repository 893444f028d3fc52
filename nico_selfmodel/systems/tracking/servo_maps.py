"""The servo map as systems: what encoders read, and the angles of the joints, both ways."""

from typing import Any

from pydrake.systems.framework import (
    BasicVector_,  # pyright: ignore[reportAttributeAccessIssue]
    LeafSystem_,  # pyright: ignore[reportAttributeAccessIssue]
)
from pydrake.systems.scalar_conversion import TemplateSystem

from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.systems.scalars import of_scalars, quiet


@TemplateSystem.define("EncodersToAngles_")
def EncodersToAngles_(T: Any) -> Any:
    """Return `EncodersToAngles` for floats, `AutoDiffXd` or `Expression`."""

    class EncodersToAngles(LeafSystem_[T]):
        """Angles of the joints at encoder readings, q = (sign * radians - offset) / gear.

        | port | | carries |
        |---|---|---|
        | `encoders` | in | encoder readings, in the encoders' units |
        | `q_measured` | out | angles of the joints [rad] |
        """

        def _construct(self, servos: ServoMap, *, converter: Any = None) -> None:
            """Take the servo map of a self-model, `model.servos`."""
            LeafSystem_[T].__init__(self, converter)
            self.servos = servos
            n = len(servos.joints)
            self._readings = self.DeclareVectorInputPort("encoders", n)
            needs = {self._readings.ticket()}
            self.DeclareVectorOutputPort("q_measured", BasicVector_[T](n), self._map, needs)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            self._construct(other.servos, converter=converter)

        @quiet
        def _map(self, context: Any, vector: Any) -> None:
            q = self.servos.to_joint(self._readings.Eval(context))
            vector.SetFromVector(of_scalars(T, q))

    return EncodersToAngles


@TemplateSystem.define("AnglesToEncoders_")
def AnglesToEncoders_(T: Any) -> Any:
    """Return `AnglesToEncoders` for floats, `AutoDiffXd` or `Expression`."""

    class AnglesToEncoders(LeafSystem_[T]):
        """What encoders will read where joints shall go: commands for any station or driver.

        | port | | carries |
        |---|---|---|
        | `q_commanded` | in | where the joints shall go [rad]; nan is passed on |
        | `encoders_commanded` | out | the same, in the encoders' units |
        """

        def _construct(self, servos: ServoMap, *, converter: Any = None) -> None:
            """Take the servo map of a self-model, `model.servos`."""
            LeafSystem_[T].__init__(self, converter)
            self.servos = servos
            n = len(servos.joints)
            self._q = self.DeclareVectorInputPort("q_commanded", n)
            needs = {self._q.ticket()}
            self.DeclareVectorOutputPort("encoders_commanded", BasicVector_[T](n), self._map, needs)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            self._construct(other.servos, converter=converter)

        @quiet
        def _map(self, context: Any, vector: Any) -> None:
            readings = self.servos.to_encoder(self._q.Eval(context))
            vector.SetFromVector(of_scalars(T, readings))

    return AnglesToEncoders


EncodersToAngles: Any = EncodersToAngles_[None]
"""The system of floats."""
AnglesToEncoders: Any = AnglesToEncoders_[None]
"""The system of floats."""

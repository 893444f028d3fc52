"""Encoder readings and angles of joints as systems: the servo map both ways, and under load."""

from typing import Any

from numpy.typing import NDArray
from pydrake.systems.framework import (
    BasicVector_,  # pyright: ignore[reportAttributeAccessIssue]
    LeafSystem_,  # pyright: ignore[reportAttributeAccessIssue]
)
from pydrake.systems.scalar_conversion import TemplateSystem

from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.systems.scalars import of_scalars, quiet


def _joint_map(T: Any) -> Any:
    """Return what all maps of the joints' numbers are, for one kind of scalars."""

    class JointMap(LeafSystem_[T]):
        """One number a joint in, one a joint out, by `_mapped` of a subclass."""

        def _declare(self, known: Any, ports: tuple[str, str], converter: Any) -> None:
            """Declare both ports for what is known of joints: a servo map or a self-model."""
            LeafSystem_[T].__init__(self, converter)
            self.known = known
            n = len(known.joints)
            self._given = self.DeclareVectorInputPort(ports[0], n)
            needs = {self._given.ticket()}
            self.DeclareVectorOutputPort(ports[1], BasicVector_[T](n), self._map, needs)

        @quiet
        def _map(self, context: Any, vector: Any) -> None:
            vector.SetFromVector(of_scalars(T, self._mapped(self._given.Eval(context))))

        def _mapped(self, given: NDArray) -> NDArray:
            raise NotImplementedError

    return JointMap


@TemplateSystem.define("EncodersToAngles_")
def EncodersToAngles_(T: Any) -> Any:
    """Return `EncodersToAngles` for floats, `AutoDiffXd` or `Expression`."""

    class EncodersToAngles(_joint_map(T)):
        """Angles of the joints at encoder readings, q = (sign * radians - offset) / gear.

        | port | | carries |
        |---|---|---|
        | `encoders` | in | encoder readings, in the encoders' units |
        | `q_measured` | out | angles of the joints [rad] |
        """

        def _construct(self, servos: ServoMap, *, converter: Any = None) -> None:
            """Take the servo map of a self-model, `model.servos`."""
            self._declare(servos, ("encoders", "q_measured"), converter)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            self._construct(other.known, converter=converter)

        def _mapped(self, given: NDArray) -> NDArray:
            return self.known.to_joint(given)

    return EncodersToAngles


@TemplateSystem.define("AnglesToEncoders_")
def AnglesToEncoders_(T: Any) -> Any:
    """Return `AnglesToEncoders` for floats, `AutoDiffXd` or `Expression`."""

    class AnglesToEncoders(_joint_map(T)):
        """What encoders will read where joints shall go: commands for any station or driver.

        | port | | carries |
        |---|---|---|
        | `q_commanded` | in | where the joints shall go [rad]; nan is passed on |
        | `encoders_commanded` | out | the same, in the encoders' units |
        """

        def _construct(self, servos: ServoMap, *, converter: Any = None) -> None:
            """Take the servo map of a self-model, `model.servos`."""
            self._declare(servos, ("q_commanded", "encoders_commanded"), converter)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            self._construct(other.known, converter=converter)

        def _mapped(self, given: NDArray) -> NDArray:
            return self.known.to_encoder(given)

    return AnglesToEncoders


@TemplateSystem.define("LoadedAngles_")
def LoadedAngles_(T: Any) -> Any:
    """Return `LoadedAngles` for floats, `AutoDiffXd` or `Expression`."""

    class LoadedAngles(_joint_map(T)):
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
            self._declare(model, ("encoders", "q_loaded"), converter)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            self._construct(other.known, converter=converter)

        def _mapped(self, given: NDArray) -> NDArray:
            return self.known.posture(self.known.servos.to_joint(given)).q

    return LoadedAngles


EncodersToAngles: Any = EncodersToAngles_[None]
"""The system of floats."""
AnglesToEncoders: Any = AnglesToEncoders_[None]
"""The system of floats."""
LoadedAngles: Any = LoadedAngles_[None]
"""The system of floats."""

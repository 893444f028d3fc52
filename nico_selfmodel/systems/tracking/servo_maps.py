"""Encoder readings and angles of joints as systems: the servo map both ways, and under load."""

from collections.abc import Callable
from typing import Any

from numpy.typing import NDArray
from pydrake.systems.framework import (
    BasicVector_,  # pyright: ignore[reportAttributeAccessIssue]
    LeafSystem_,  # pyright: ignore[reportAttributeAccessIssue]
)
from pydrake.systems.scalar_conversion import TemplateSystem

from nico_selfmodel.errors import check_kind
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.systems.scalars import of_scalars, quiet


def _joint_map(
    name: str,
    ports: tuple[str, str],
    kind: tuple[type, str],
    mapped: Callable[[Any, NDArray], NDArray],
    about: str,
) -> Any:
    """Return the template of a system with one number a joint in, and one a joint out.

    Args:
        kind: Of what is known of the joints, and what to say of anything else.
        mapped: Returns what goes out, of what is known of the joints and what comes in.
        about: What the system is.
    """

    @TemplateSystem.define(f"{name}_")
    def template(T: Any) -> Any:
        class JointMap(LeafSystem_[T]):
            def _construct(self, known: Any, *, converter: Any = None) -> None:
                """Take a servo map, or a self-model where the arm's load counts."""
                LeafSystem_[T].__init__(self, converter)
                check_kind(known, *kind)
                self.known = known
                n = len(known.joints)
                self._given = self.DeclareVectorInputPort(ports[0], n)
                needs = {self._given.ticket()}
                self.DeclareVectorOutputPort(ports[1], BasicVector_[T](n), self._map, needs)

            def _construct_copy(self, other: Any, converter: Any = None) -> None:
                self._construct(other.known, converter=converter)

            @quiet
            def _map(self, context: Any, vector: Any) -> None:
                found = mapped(self.known, self._given.Eval(context))
                vector.SetFromVector(of_scalars(T, found))

        JointMap.__name__ = JointMap.__qualname__ = name
        JointMap.__doc__ = about
        return JointMap

    return template


EncodersToAngles_ = _joint_map(
    "EncodersToAngles",
    ("encoders", "q_measured"),
    (ServoMap, "give the servo map of a self-model, model.servos"),
    lambda servos, readings: servos.to_joint(readings),
    """Angles of the joints at encoder readings, q = (sign * radians - offset) / gear.

    Of the servo map of a self-model, `model.servos`.

    | port | | carries |
    |---|---|---|
    | `encoders` | in | encoder readings, in the encoders' units |
    | `q_measured` | out | angles of the joints [rad] |
    """,
)
AnglesToEncoders_ = _joint_map(
    "AnglesToEncoders",
    ("q_commanded", "encoders_commanded"),
    (ServoMap, "give the servo map of a self-model, model.servos"),
    lambda servos, angles: servos.to_encoder(angles),
    """What encoders will read where joints shall go: commands for any station or driver.

    Of the servo map of a self-model, `model.servos`.

    | port | | carries |
    |---|---|---|
    | `q_commanded` | in | where the joints shall go [rad]; nan is passed on |
    | `encoders_commanded` | out | the same, in the encoders' units |
    """,
)
LoadedAngles_ = _joint_map(
    "LoadedAngles",
    ("encoders", "q_loaded"),
    (SelfModel, "give the self-model, which knows what bends"),
    lambda model, readings: model.posture(model.servos.to_joint(readings)).q,
    """Angles to which the joints turn, sag, ripple and coupling included; quasi-static.

    Of a self-model: what a plant's positions are at encoder readings; one that does not bend gives
    its servo map's angles. Bearings that give way move the joints' frames besides: those are
    written by `SelfModelPlant.set_positions`.

    | port | | carries |
    |---|---|---|
    | `encoders` | in | encoder readings, in the encoders' units |
    | `q_loaded` | out | angles of the joints [rad] |
    """,
)
EncodersToAngles: Any = EncodersToAngles_[None]
"""The system of floats."""
AnglesToEncoders: Any = AnglesToEncoders_[None]
"""The system of floats."""
LoadedAngles: Any = LoadedAngles_[None]
"""The system of floats."""

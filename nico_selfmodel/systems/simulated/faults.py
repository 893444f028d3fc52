"""What can happen to a simulated robot after it has learned itself."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.names import refuse_unknown
from nico_selfmodel.systems.simulated.instance import RobotInstance
from nico_selfmodel.systems.simulated.mechanics import Mechanics

Change = Callable[[RobotInstance], RobotInstance]
"""From a robot as it is to what becomes of it."""


class FaultInjector:
    """Changes a robot behind its own back."""

    def __init__(self, apply: Callable[[Change], None]) -> None:
        """Take a robot.

        Args:
            apply: Applies a change to it.
        """
        self._apply = apply

    def slip(self, joint: str, angle: float) -> None:
        """Let a joint slip against its encoder; its stops are then read elsewhere.

        Args:
            angle: How far, in the joint's own direction [rad].

        Raises:
            ValueError: If there is no such joint.
        """
        self._arm(lambda arm: _slipped(arm, _index(arm, joint), angle))

    def change_gear(self, joint: str, factor: float) -> None:
        """Multiply a gear, about the middle of the joint's range.

        Args:
            factor: New gear over old.

        Raises:
            ValueError: If there is no such joint.
        """
        self._arm(lambda arm: _regeared(arm, _index(arm, joint), factor))

    def restart(self, seed: int, spread: float = np.radians(10.0)) -> None:
        """Switch off and on again: every encoder has another zero, the joints stay.

        Args:
            seed: Of the zeros.
            spread: Their standard deviation about the old ones [rad].
        """

        def lose_zeros(arm: Mechanics) -> Mechanics:
            n = len(arm.servos.joints)
            for i, angle in enumerate(np.random.default_rng((seed, 11)).normal(0.0, spread, n)):
                arm = _slipped(arm, i, float(angle))
            return arm

        self._arm(lose_zeros)

    def take_tool(self, shift: ArrayLike) -> None:
        """Take a tool, on whose tip the markers are from now on.

        Args:
            shift: From the hand's marker to the tip, along the base's axes at q = 0 [m].
                Shape (3,).
        """
        way = np.asarray(shift, dtype=float)
        self._arm(
            lambda arm: replace(arm, chain=replace(arm.chain, p_WH_zero=arm.chain.p_WH_zero + way))
        )

    def bump_camera(self, turn: ArrayLike) -> None:
        """Turn the right camera by a rotation vector in its own frame [rad]. Shape (3,)."""

        def bumped(robot: RobotInstance) -> RobotInstance:
            assert robot.rig is not None
            right = robot.rig.right
            turned = right.X_WC @ transform(rotation_from_vector(turn), np.zeros(3))
            return replace(robot, rig=replace(robot.rig, right=right.at(turned)))

        self._apply(bumped)

    def _arm(self, change: Callable[[Mechanics], Mechanics]) -> None:
        self._apply(lambda robot: replace(robot, mechanics=change(robot.arm)))


def _slipped(arm: Mechanics, i: int, angle: float) -> Mechanics:
    offset = arm.servos.offset.copy()
    offset[i] -= arm.servos.gear[i] * angle
    servos = replace(arm.servos, offset=offset)
    lower, upper = (
        np.round(servos.to_encoder(arm.servos.to_joint(end))) for end in (arm.lower, arm.upper)
    )
    return replace(arm, servos=servos, lower=lower, upper=upper)


def _regeared(arm: Mechanics, i: int, factor: float) -> Mechanics:
    gear, offset = arm.servos.gear.copy(), arm.servos.offset.copy()
    middle = arm.servos.to_joint(np.mean([arm.lower, arm.upper], axis=0))[i]
    offset[i] += gear[i] * middle * (1.0 - factor)
    gear[i] *= factor
    return replace(arm, servos=replace(arm.servos, gear=gear, offset=offset))


def _index(arm: Mechanics, joint: str) -> int:
    refuse_unknown("joint", joint, arm.servos.joints)
    return arm.servos.joints.index(joint)

"""One individual of a robot: how it was really built, which only the simulation knows."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model import DhTable, SelfModel, StereoRig
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.systems import simulated_arm, simulated_eyes
from nico_selfmodel.systems.encoder_model import Mechanics
from nico_selfmodel.systems.worlds import Imperfections

_HEAD_SIGMA = np.radians(1.0)
"""How far the joints of neck and eyes stand from where they should [rad]."""
_HEAD = ("neck", "eye")


@dataclass(frozen=True, eq=False)
class Individual:
    """The truth about a body."""

    mechanics: Mechanics
    """The arm, its servos and stops."""
    rig: StereoRig
    """The eyes; each `X_WC` is the camera's pose in the frame it is mounted on."""
    held: Mapping[str, float]
    """Joints that do not belong to the arm and are not at zero [rad]."""
    X_TB: NDArray
    """Pose of the arm's base in the motion tracker's frame. Shape (4, 4)."""

    @classmethod
    def build(
        cls, arm: ArmDescription, world: Imperfections, seed: int, eyes: StereoRig
    ) -> "Individual":
        """Build one.

        Args:
            arm: The robot as described.
            world: How far it may be from that.
            seed: Which one.
            eyes: The eyes as designed; where they are mounted is the description's business.

        Raises:
            ValueError: If a joint of the arm has no limits.
        """
        if not np.isfinite([arm.lower, arm.upper]).all():
            raise ValueError("a simulated arm needs finite limits of every joint")
        rng = np.random.default_rng((seed, 20))
        chain = simulated_arm._individual(arm.chain, world, rng)
        servos = simulated_arm._servos(arm.joints, world, rng)
        lower, upper = simulated_arm._stops(
            servos, arm.lower, arm.upper, world, np.random.default_rng((seed, 2))
        )
        torque = simulated_arm._largest_torque(chain, arm.lower, arm.upper, rng)
        lenses = np.random.default_rng((seed, 7))
        cameras = [simulated_eyes._individual(e.at(np.eye(4)), lenses) for e in eyes.eyes]
        held = {
            joint: value + (_HEAD_SIGMA * rng.normal() if _of_the_head(joint) else 0.0)
            for joint, value in arm.held.items()
        }
        turn = rng.uniform(-1.0, 1.0, 3) * [0.05, 0.05, 0.6]
        X_TB = transform(rotation_from_vector(turn), rng.uniform(-0.5, 0.5, 3))
        mechanics = Mechanics(chain, servos, lower, upper, torque)
        return cls(mechanics, StereoRig(*cameras), MappingProxyType(held), X_TB)

    @property
    def model(self) -> SelfModel:
        """The truth in the form that a plant is built from."""
        table = DhTable.from_chain(self.mechanics.chain)
        return SelfModel("truth", table, self.mechanics.servos)


def _of_the_head(joint: str) -> bool:
    return any(part in joint for part in _HEAD)

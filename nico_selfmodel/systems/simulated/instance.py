"""One robot as it was really built, which only the simulation knows."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model import Chain, StereoRig
from nico_selfmodel.systems.simulated.cameras import built_rig
from nico_selfmodel.systems.simulated.mechanics import Mechanics
from nico_selfmodel.systems.worlds import Imperfections

_NECK_TURN, _NECK_SHIFT = np.radians(2.0), 3e-3
"""How far the head stands from where the description has it [rad, m]."""


@dataclass(frozen=True, eq=False)
class RobotInstance:
    """The truth about a robot, and where what measures it stands."""

    mechanics: Mechanics
    """The arm, its servos and stops, in the frame B of its base."""
    rig: StereoRig | None = None
    """The cameras in the left one's frame L, if it has any."""
    X_BL: NDArray | None = None
    """Pose of the left camera in the arm's base. Shape (4, 4)."""
    X_TB: NDArray | None = None
    """Pose of the arm's base in the frame of motion capture, if there is any. Shape (4, 4)."""

    @classmethod
    def under_motion_capture(
        cls,
        nominal: Chain,
        lower: NDArray,
        upper: NDArray,
        imperfections: Imperfections,
        seed: int,
    ) -> "RobotInstance":
        """Build one; arguments as for `Mechanics.build`."""
        rng = np.random.default_rng(seed)
        mechanics = Mechanics.build(nominal, lower, upper, imperfections, seed, rng)
        X_TB = tracker_pose(rng)
        return cls(mechanics.weighed(lower, upper, rng), X_TB=X_TB)

    @classmethod
    def with_cameras(
        cls,
        nominal: Chain,
        lower: NDArray,
        upper: NDArray,
        imperfections: Imperfections,
        seed: int,
        X_BL: ArrayLike,
        cameras: StereoRig,
    ) -> "RobotInstance":
        """Build one; arguments as for `Mechanics.build`, and its cameras as designed.

        Args:
            nominal: The arm.
            lower: Lower joint limits [rad]. Shape (n,).
            upper: Upper joint limits [rad]. Shape (n,).
            imperfections: Of the arm.
            seed: Which one.
            X_BL: Pose of the left camera in the base as described. Shape (4, 4).
            cameras: The cameras as designed, the left one at the world.
        """
        rng = np.random.default_rng((seed, 9))
        mechanics = Mechanics.build(nominal, lower, upper, imperfections, seed, rng)
        if imperfections.sag:
            mechanics = mechanics.weighed(lower, upper, np.random.default_rng((seed, 15)))
        turn = rotation_from_vector(rng.normal(0.0, _NECK_TURN, 3))
        shift = rng.normal(0.0, _NECK_SHIFT, 3)
        rig = built_rig(cameras, np.random.default_rng((seed, 7)))
        # The rig stands only nearly at its own world: what counts is the true left camera.
        X_BE = np.asarray(X_BL, dtype=float) @ transform(turn, shift)
        return cls(mechanics, rig.moved(rig.left.X_WC), X_BE @ rig.left.X_WC)


def tracker_pose(rng: np.random.Generator) -> NDArray:
    """Return the pose of a base in the frame of motion capture. Shape (4, 4)."""
    # A tracker's z points up, but for a few degrees; where it stands is anybody's choice.
    turn = rng.uniform(-1.0, 1.0, 3) * [0.05, 0.05, 0.6]
    return transform(rotation_from_vector(turn), rng.uniform(-0.5, 0.5, 3))

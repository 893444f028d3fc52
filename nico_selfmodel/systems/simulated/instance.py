"""One robot as it was really built, which only the simulation knows."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.systems.simulated.joint_mechanics import JointMechanics
from nico_selfmodel.systems.simulated.mechanics import Mechanics


@dataclass(frozen=True, eq=False)
class RobotInstance:
    """The truth about a robot, and where what measures it stands."""

    mechanics: JointMechanics
    """The arm or the body, its servos and stops, in the frame B of its base."""
    rig: StereoRig | None = None
    """The cameras in the left one's frame L, if it has any that stand still."""
    X_BL: NDArray | None = None
    """Pose of the left camera in the base. Shape (4, 4)."""
    X_TB: NDArray | None = None
    """Pose of the base in the frame of motion capture, if there is any. Shape (4, 4)."""

    @property
    def arm(self) -> Mechanics:
        """The mechanics of a robot that is one arm."""
        assert isinstance(self.mechanics, Mechanics), "a whole body is not one arm"
        return self.mechanics

    def posed(self, q: NDArray) -> "RobotInstance":
        """Return the robot with its cameras where joint angles [rad] of shape (n,) carry them."""
        carried = self.mechanics.cameras(q)
        return self if carried is None else replace(self, X_BL=carried[0], rig=carried[1])


def tracker_pose(rng: np.random.Generator) -> NDArray:
    """Return the pose of a base in the frame of motion capture. Shape (4, 4)."""
    # A tracker's z points up, but for a few degrees; where it stands is anybody's choice.
    turn = rng.uniform(-1.0, 1.0, 3) * [0.05, 0.05, 0.6]
    return transform(rotation_from_vector(turn), rng.uniform(-0.5, 0.5, 3))

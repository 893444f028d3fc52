"""What only instruments beside a simulated robot could say: for judging, never for learning."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.arm.link_lengths import link_lengths
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.systems.simulated.instance import RobotInstance


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """The truth about one robot, as it is at this moment."""

    instance: RobotInstance
    """How it is built."""
    p_BH: NDArray = field(default_factory=lambda: np.zeros((0, 3)))
    """Where its markers were at the last pose, in the arm's base [m]. Shape (m, 3)."""
    mirrors: Mapping[str, Mirror] = field(default_factory=dict)
    """Where mirrors stand before the left camera."""
    held: Mapping[str, float] = field(default_factory=dict)
    """Joints that nobody commands, and where they really stand [rad]."""

    @property
    def rig(self) -> StereoRig:
        """The cameras, in the left one's frame."""
        assert self.instance.rig is not None, "a robot under motion capture has no cameras"
        return self.instance.rig

    @property
    def X_LB(self) -> NDArray:
        """Pose of the arm's base in the left camera's frame. Shape (4, 4)."""
        assert self.instance.X_BL is not None, "a robot under motion capture has no cameras"
        return inverse(self.instance.X_BL)

    @property
    def p_LH(self) -> NDArray:
        """Where its markers were at the last pose, in the left camera's frame. Shape (m, 3)."""
        return apply(self.X_LB, self.p_BH)

    def link_lengths(self, marker: str | None = None) -> tuple[float, float]:
        """Measure the two links: shoulder to elbow, and elbow to a point on the hand [m].

        Args:
            marker: The point; the first one if omitted.
        """
        chain = self.instance.arm.chain
        return link_lengths(chain, 0 if marker is None else chain.marker_index(marker))

    def expected(self, encoders: ArrayLike, marker: str | None = None) -> tuple[NDArray, NDArray]:
        """Say what a body that knew itself exactly would expect: all but what is left to chance.

        Args:
            encoders: Readings [counts]. Shape (N, n).
            marker: The tracked point; the first one if omitted.

        Returns:
            Pixels in both cameras, nan where out of view, shape (N, 4), and places in the left
            camera's frame [m], shape (N, 3).
        """
        chain = self.instance.arm.chain
        k = 0 if marker is None else chain.marker_index(marker)
        p_LH = apply(self.X_LB, chain.forward(self.instance.arm.expected_angles(encoders), k))
        return self.rig.project(p_LH), p_LH

    def locate(self, p_TH: NDArray) -> NDArray:
        """Return points of motion capture in the left camera's frame [m]. Shape (m, 3)."""
        assert self.instance.X_TB is not None, "no motion capture watches this robot"
        return apply(self.X_LB @ inverse(self.instance.X_TB), p_TH)

    def mirror(self, X_BM: NDArray) -> Mirror:
        """Say where a glass stands before the left camera.

        Args:
            X_BM: Pose of the glass in the frame of the arm's base, z into it. Shape (4, 4).
        """
        X_LM = self.X_LB @ X_BM
        normal = -X_LM[:3, 2]
        return Mirror.from_plane(Plane(normal, float(-normal @ X_LM[:3, 3])))

    def model(self, name: str = "truth", **about: Any) -> SelfModel:
        """Return the truth as a self-model in the left camera's frame.

        Args:
            **about: More fields of `SelfModel`.
        """
        mechanics = self.instance.arm
        table = DhTable.from_chain(mechanics.chain.moved(self.X_LB))
        cameras = {"left": self.rig.left, "right": self.rig.right}
        return SelfModel(name, table, mechanics.servos, cameras=cameras, **about)

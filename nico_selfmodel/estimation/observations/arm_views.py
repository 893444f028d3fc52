"""The arm as variables of a larger problem: as lines, or as Denavit-Hartenberg parameters."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.observations.arm_estimate import ArmEstimate
from nico_selfmodel.estimation.observations.hand_residuals import (
    DhResiduals,
    LineResiduals,
)
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.geometry.rotation import tangent_basis
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.model.arm.line_kinematics import hand_derivatives


class ArmView(Protocol):
    """How an arm is written down.

    Attributes:
        names: Its variables, P of them.
        start: Where they start. Shape (P,).
    """

    names: tuple[str, ...]

    @property
    def start(self) -> NDArray:
        """Where the variables start. Shape (P,)."""
        ...

    def evaluate(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return tracked points, shape (3, N), and their derivatives, shape (P, 3, N)."""
        ...

    def by_angle(self, x: NDArray) -> NDArray:
        """Return the derivatives of the points by the joint angles. Shape (3, n, N)."""
        ...


class AxesArm:
    """An arm as lines, gears and hand points: minimal, without gauge."""

    def __init__(self, observations: Observations, start: ArmEstimate) -> None:
        """Lay the chart at a start.

        Args:
            observations: Encoder angles; its positions must be zero, so that the residuals of
                positions are the positions themselves.
            start: The arm about which it is laid.
        """
        self._lines = LineResiduals(observations, start, 1.0)
        self._observations = observations
        self.names = self._lines.names

    @property
    def start(self) -> NDArray:
        """Where the variables start. Shape (5n + 3m,)."""
        return self._lines.start

    def hypothesis(self, x: NDArray) -> ArmEstimate:
        """Return the arm that variables describe."""
        return self._lines.hypothesis(x)

    def evaluate(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return tracked points, shape (3, N), and their derivatives, shape (5n + 3m, 3, N)."""
        return self._lines.evaluate(x)

    def by_angle(self, x: NDArray) -> NDArray:
        """Return the derivatives of the points by the joint angles. Shape (3, n, N)."""
        arm, observations = self.hypothesis(x), self._observations
        chain = arm.chain
        basis = tangent_basis(chain.directions)
        p_zero = chain.p_WH_zero[observations.marker].T
        q = arm.q_of(observations.angles).T
        slopes = hand_derivatives(chain.directions, chain.points, p_zero, q, basis, basis)
        return slopes.by_angle


class DhArm:
    """An arm as Denavit-Hartenberg parameters, for pins and covariance by name."""

    def __init__(self, observations: Observations, start: DhParameters) -> None:
        """Take the data.

        Args:
            observations: Encoder angles; its positions must be zero, as for `AxesArm`.
            start: Table and servos at the start.
        """
        self._rows = DhResiduals(observations, start, 1.0)
        self._start = start
        self.names = self._rows.names

    @property
    def start(self) -> NDArray:
        """Where the variables start. Shape (P,)."""
        return self._start.values

    def parameters(self, x: NDArray) -> DhParameters:
        """Return the arm that variables describe."""
        return self._start.with_values(x)

    def evaluate(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return tracked points, shape (3, N), and their derivatives, shape (P, 3, N)."""
        return self._rows.evaluate(x)

    def by_angle(self, x: NDArray) -> NDArray:
        """Return the derivatives of the points by the joint angles. Shape (3, n, N)."""
        joints = self._start.table.joints
        columns = [self.names.index(f"{joint}.theta_offset") for joint in joints]
        # theta = (encoder - theta_offset) / gear
        gear = self.parameters(x).servos.gear
        return -np.moveaxis(self.evaluate(x)[1][columns], 0, 1) * gear[:, None]

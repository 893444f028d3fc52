"""The arm as variables of a larger problem: as Denavit-Hartenberg parameters, or as points."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.observations.hand_residuals import DhResiduals
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.model.arm.dh_parameters import DhParameters


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


class DhArm:
    """An arm as Denavit-Hartenberg parameters, for covariance by name."""

    def __init__(self, observations: Observations, start: DhParameters) -> None:
        """Take the data.

        Args:
            observations: Encoder angles; its positions must be zero, so that the residuals of
                positions are the positions themselves.
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

"""Residuals of measured points of the hand by name, with the same face as `HandPixels`."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.observations.arm_views import ArmView, DhArm
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.model.arm.dh_parameters import DhParameters


class HandPoints:
    """W (predicted - measured) points of every row, over an arm.

    Attributes:
        names: Variables of the arm.
        measured: Points [m]. Shape (3, N).
        seen: Which coordinates were measured: all. Shape (N, 3).
    """

    def __init__(self, observations: Observations, start: DhParameters) -> None:
        """Take the data.

        Args:
            observations: Where the hand was measured.
            start: Table and servos at the start.
        """
        self.observations = observations
        self.measured = observations.p_WH.T
        at_origin = replace(observations, p_WH=np.zeros((len(observations), 3)))
        self.arm: ArmView = DhArm(at_origin, start)
        self.names = self.arm.names
        self.seen = np.ones((len(observations), 3), dtype=bool)
        self.whiten(np.tile(np.eye(3), (len(observations), 1, 1)))

    def whiten(self, whitening: NDArray) -> None:
        """Replace the whitening of the rows. Shape (N, 3, 3)."""
        self._whitening = whitening

    def evaluate(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return whitened residuals, shape (3, N), and derivatives, shape (P, 3, N)."""
        points, jacobian = self.project(x)
        both = np.concatenate([(points - self.measured)[None], jacobian]).transpose(2, 1, 0)
        whitened = (self._whitening @ both).transpose(2, 1, 0)
        return whitened[0], whitened[1:]

    def project(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return predicted points, shape (3, N), and their derivatives, shape (P, 3, N)."""
        return self.arm.evaluate(x)

    def by_angle(self, x: NDArray) -> NDArray:
        """Return the derivatives of each row's point by the joint angles. Shape (N, 3, n)."""
        return np.moveaxis(self.arm.by_angle(x), 2, 0)

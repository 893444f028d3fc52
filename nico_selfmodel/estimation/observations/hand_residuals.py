"""Residuals of measured hand points, in line parameters and in Denavit-Hartenberg parameters."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.observations.arm_estimate import ArmEstimate
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.geometry.rotation import move_on_sphere, tangent_basis
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.model.arm.line_kinematics import CarriedLines
from nico_selfmodel.optimization.residual_block import remembers_last

LINE_PARTS = ("direction_u", "direction_v", "point_u", "point_v", "gear")


class LineResiduals:
    """(predicted - measured) / sigma over lines, gears and hand points: the minimal problem.

    Directions move on the sphere about the start, points in the plane normal to the start's
    direction: a fixed chart, so that every solver sees one smooth function (thesis eq. 6.14 with
    5n + 3 instead of 6 + 5n unknowns).
    """

    def __init__(self, observations: Observations, start: ArmEstimate, sigma: float) -> None:
        """Prepare the chart at a start.

        Args:
            start: The arm about which the chart is laid.
            sigma: Standard deviation that whitens the residuals [m].
        """
        self._observations, self._start, self._sigma = observations, start, sigma
        self._bases = tangent_basis(start.chain.directions)
        self._moved = np.ascontiguousarray((observations.angles - start.zero).T)
        self._measured = np.ascontiguousarray(observations.p_WH.T)
        n, m = len(start.chain.joints), len(start.chain.markers)
        self._own = [observations.marker == k for k in range(m)]
        joints = [f"{joint}.{part}" for joint in start.chain.joints for part in LINE_PARTS]
        hands = [f"hand.{marker}.{axis}" for marker in start.chain.markers for axis in "xyz"]
        self.names = (*joints, *hands)
        self._out = np.zeros((5 * n + 3 * m, 3, len(observations)))

    @property
    def start(self) -> NDArray:
        """The chart coordinates of the start. Shape (5n + 3m,)."""
        chain = self._start.chain
        joints = np.zeros((len(chain.joints), 5))
        joints[:, 4] = self._start.gear
        return np.concatenate([joints.ravel(), chain.p_WH_zero.ravel()])

    def hypothesis(self, x: NDArray) -> ArmEstimate:
        """Return the arm at chart coordinates x; a negative gear turns its axis round instead."""
        directions, _, points, gear, hands = self._unpack(x)
        directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        directions, gear = directions * np.sign(gear)[:, None], np.abs(gear)
        chain = replace(self._start.chain, directions=directions, points=points, p_WH_zero=hands)
        return ArmEstimate(chain, gear, self._start.zero)

    @remembers_last
    def evaluate(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return residuals, shape (3, N), and derivatives, shape (5n + 3m, 3, N)."""
        directions, slopes, points, gear, hands = self._unpack(x)
        q = self._moved / gear[:, None]
        p_zero = hands[self._observations.marker].T
        d = CarriedLines.at(directions, q, slopes, self._bases).derivatives(points, p_zero)
        n, out = len(gear), self._out
        joints = out[: 5 * n].reshape(n, 5, 3, -1)
        joints[:, 0:2] = d.by_direction.transpose(1, 2, 0, 3)
        joints[:, 2:4] = d.by_point.transpose(1, 2, 0, 3)
        # q = (e - e_zero) / G, so dq/dG = -q / G
        joints[:, 4] = d.by_angle.swapaxes(0, 1) * (-q / gear[:, None])[:, None]
        by_hand = d.by_hand.swapaxes(0, 1)
        for k, own in enumerate(self._own):
            out[5 * n + 3 * k : 5 * n + 3 * k + 3] = by_hand if own.all() else by_hand * own
        return (d.p - self._measured) / self._sigma, out * (1.0 / self._sigma)

    def _unpack(self, x: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray]:
        """Return directions, their chart derivatives, points, gears and hand points."""
        chain, n = self._start.chain, len(self._start.gear)
        joints, hands = x[: 5 * n].reshape(n, 5), x[5 * n :].reshape(-1, 3)
        directions, slopes = move_on_sphere(chain.directions, joints[:, :2])
        points = chain.points + np.einsum("nij,nj->ni", self._bases, joints[:, 2:4])
        return directions, slopes, points, joints[:, 4], hands


class DhResiduals:
    """(predicted - measured) / sigma over Denavit-Hartenberg parameters, for pins by name.

    In coordinates in which the sensor errs alike, `Observations.alike`.
    """

    def __init__(self, observations: Observations, start: DhParameters, sigma: float) -> None:
        """Prepare the residuals.

        Args:
            start: Table and servos at the start.
            sigma: Standard deviation that whitens the residuals [m].
        """
        self._observations, self._start, self._sigma = observations, start, sigma
        self.names = start.names

    def evaluate(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return residuals, shape (3, N), and derivatives, shape (P, 3, N)."""
        p, jacobian = self._observations.predicted(self._start.with_values(x))
        missed = (p - self._observations.p_WH)[:, :, None]
        residuals = self._observations.alike(missed)[:, :, 0].T / self._sigma
        return residuals, np.transpose(self._observations.alike(jacobian), (2, 1, 0)) / self._sigma

"""Residuals of a body by what is free of it, as a program solves them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.pose_noise import PoseWhitening
from nico_selfmodel.estimation.tree.boards.poses_apart import PosesApart
from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.least_squares import NormalEquations
from nico_selfmodel.optimization.residual_block import SummedBlock


class TreeBlock(SummedBlock):
    """Residuals by the free parameters alone, whitened or weighed by sensor."""

    def __init__(
        self,
        observations: TreeObservations,
        free: tuple[tuple[str, ...], NDArray],
        linear: Callable[[NDArray], TreeLinear],
        scale: NDArray,
        whitening: PoseWhitening | None,
        pulled: NDArray | None = None,
    ) -> None:
        """Prepare.

        Args:
            free: Names of what is free, and its columns among all parameters. Shape (p,).
            linear: Maps what is free, shape (p,), to residuals and derivatives by all parameters.
            scale: Standard deviation of each scalar's sensor. Shape (R,).
            whitening: Of poses; each sensor is weighed by itself if None.
            pulled: `TreeLinear.pulled` where the weights are from. Shape (R,).
        """
        self.names, self._columns = free
        self._linear, self._scale = linear, scale
        self._whitening, self._pulled = whitening, pulled
        keep = np.ones(len(observations.row), dtype=bool)
        if whitening is not None:
            keep[:] = False
            keep[whitening.groups.rows] = True
        self._apart = PosesApart.of(observations, keep)

    def evaluate(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return residuals, shape (1, R), and derivatives, shape (p, 1, R)."""
        both = self._scaled(x)
        r, J = both[:1], both[1:, None]
        return (r, J) if self._whitening is None else self._whitening.whiten(r, J)

    def normal_equations(self, x: NDArray) -> NormalEquations:
        """Return cost, gradient and Gauss-Newton matrix from one product of all columns."""
        rows = self._scaled(x).T
        if self._whitening is not None:
            rows = self._whitening.white(rows[:, None])
        sums = rows.T @ rows
        return 0.5 * float(sums[0, 0]), sums[1:, 0], sums[1:, 1:]

    def _scaled(self, x: NDArray) -> NDArray:
        """Return residuals, then derivatives, in their sensors' sigmas. Shape (1 + p, R)."""
        linear = self._linear(x)
        r = linear.r
        if linear.pulled is not None and self._pulled is not None:
            # Frozen like the weights: what is left then has the derivatives J.
            r = r + linear.pulled - self._pulled
        both = np.empty((1 + len(self._columns), len(r)))
        both[0], J = r, both[1:]
        np.take(linear.J, self._columns, axis=0, out=J)
        left = self._apart.eliminated(replace(linear, r=both[0], J=J), self._scale)
        if left.J is not J:
            both[0], both[1:] = left.r, left.J
        both /= self._scale
        return both

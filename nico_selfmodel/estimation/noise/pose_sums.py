"""Sums over poses, piece by piece: what a million rows say takes no more memory than thousands.

With U = S^-1/2 J and u = S^-1/2 r of each pose, all that a Gauss-Newton step, its covariance and a
cross-validation need are U'U and U'u, fold by fold.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.arm_solution import (
    ArmSolution,
    Linearised,
    information_of,
    pull_of,
    without_levers,
)
from nico_selfmodel.estimation.noise.pose_noise import PoseNoise
from nico_selfmodel.estimation.noise.pose_refinement import conditional_distances, worst_of_visits
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.results.folds import FOLDS, fold_of
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.optimization.uncertainty import Uncertainty, covariance_told_by

_PIECE = 4000
"""Rows that are linearised at once; their derivatives then fit in a processor's cache."""
_STEPS, _SETTLED = 10, 1e-8
"""Limit of Gauss-Newton steps, and the square of a step in standard deviations that ends them."""
_TRIMS = 5
"""Rounds in which outliers are looked for again."""


def refine_on_all(
    observations: Observations, solved: ArmSolution, *, trim: bool
) -> tuple[ArmSolution, "PoseSums | None"]:
    """Refine an arm on all poses that was refined on a sample of them.

    The sample tells the noise, and is off by a few of its own standard deviations: what is left are
    Gauss-Newton steps, and rows that are outliers.

    Args:
        solved: The solution of the sample, with its noise.
        trim: Look for outliers.

    Returns:
        The solution of all, with outliers and uncertainty of all, and what all rows say at it; None
        where the turn of its base is written otherwise than they were summed by.
    """
    assert solved.noise is not None
    assert solved.uncertainty is not None
    refinement = _OnAll(observations, solved)
    outliers = np.zeros(len(observations), dtype=bool)
    if trim:
        outliers = refinement.outliers(outliers, solved.uncertainty.covariance)
    sums = refinement.solve(~outliers)
    for _ in range(_TRIMS if trim else 0):
        H = sums.H.sum(axis=0) + np.diag(refinement.information)
        again = refinement.outliers(outliers, covariance_told_by(H))
        if np.array_equal(again, outliers):
            break
        outliers = again
        sums = refinement.solve(~outliers)
    found = refinement.solution(outliers, sums)
    alike = np.allclose(found.parameters.base_turn, refinement.parameters.base_turn)
    return found, sums if alike else None


class _OnAll:
    """A refinement on all poses under way."""

    def __init__(self, observations: Observations, solved: ArmSolution) -> None:
        assert solved.noise is not None
        self.observations, self.sample, self.noise = observations, solved, solved.noise
        self.parameters, self.free = solved.parameters, solved.free
        self.chosen = [i for i, name in enumerate(self.parameters.names) if name in self.free]
        self.information = information_of(solved.parameters, self.chosen, solved.priors)
        self.history: list[float] = []
        self.converged = False

    def solve(self, keep: NDArray) -> "PoseSums":
        """Take steps until they are small; return the sums where they ended."""
        for _ in range(_STEPS):
            sums = PoseSums.of(self.observations, self.parameters, self.free, keep, self.noise)
            known = self.information
            pull = pull_of(self.parameters, self.chosen, self.sample.priors)
            H, g = sums.H.sum(axis=0) + np.diag(known), sums.g.sum(axis=0) + known * pull
            step = covariance_told_by(H) @ g
            self.history.append(0.5 * sums.squares)
            self.converged = bool(step @ H @ step < _SETTLED)
            if self.converged:
                return sums
            values = self.parameters.values
            values[self.chosen] += step
            self.parameters = self.parameters.with_values(values)
        return PoseSums.of(self.observations, self.parameters, self.free, keep, self.noise)

    def outliers(self, before: NDArray, covariance: NDArray) -> NDArray:
        """Return rows that neither model, nor noise, nor what else is seen of their pose explains.

        Args:
            before: Outlier rows so far. Boolean, shape (N,).
            covariance: Of the free parameters. Shape (k, k).
        """
        distances = np.zeros(len(before))
        for rows in pieces(self.observations):
            keep, part = ~before[rows], self.observations.select(rows)
            linear = Linearised.at(part, self.parameters, keep, self.noise)
            distances[rows] = conditional_distances(linear, self.free, keep, covariance)
        return worst_of_visits(distances, before, self.observations.visit)

    def solution(self, outliers: NDArray, sums: "PoseSums") -> ArmSolution:
        """Return what was found."""
        names = tuple(self.parameters.names[i] for i in self.chosen)
        scales = self.parameters.scales(self.observations.size)[self.chosen]
        count = 3 * int(np.sum(~outliers))
        found = Uncertainty.from_jacobian(
            names,
            _root(sums.H.sum(axis=0) + np.diag(self.information)),
            scales,
            float(count - len(names)),
            count,
        )
        sigma = float(np.sqrt(self.noise.sensor_sigma**2 + sums.moved))
        return replace(
            self.sample,
            parameters=replace(self.parameters, turn=None),
            outliers=outliers,
            uncertainty=without_levers(found, self.parameters, scales, sigma, sums.levers),
            noise_sigma=sigma,
            converged=self.sample.converged and self.converged,
            iterations=self.sample.iterations + len(self.history),
            history=tuple(self.history),
        )


def _root(H: NDArray) -> NDArray:
    """Return a matrix R with R'R = H."""
    size = np.sqrt(np.where(np.diag(H) > 0.0, np.diag(H), 1.0))
    values, vectors = np.linalg.eigh(H / np.outer(size, size))
    return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * size


@dataclass(frozen=True, eq=False)
class PoseSums:
    """What all rows that count say about an arm, fold by fold."""

    H: NDArray
    """U'U of the free parameters. Shape (folds, k, k)."""
    g: NDArray
    """U'u. Shape (folds, k)."""
    coordinates: NDArray
    """Length of u, with what poses that have fewer rows than others are filled up by. (folds,)."""
    squares: float
    """u'u."""
    levers: NDArray
    """Mean square distance of the tracked points from each axis, of all rows [m^2]. Shape (n,)."""
    moved: float
    """Mean variance that joint noise gives a coordinate, of the rows that count [m^2]."""
    fold: NDArray
    """Fold of each row that counts. Shape (K,)."""

    @classmethod
    def of(
        cls,
        observations: Observations,
        parameters: DhParameters,
        free: frozenset[str],
        keep: NDArray,
        noise: PoseNoise,
        folds: int = FOLDS,
    ) -> "PoseSums":
        """Linearise about an arm and add up.

        Args:
            keep: Rows that count. Boolean, shape (N,).
            folds: How many folds of whole poses there are.
        """
        n, k = len(observations.joints), len(free)
        fold = np.zeros(len(observations), dtype=int)
        fold[keep] = fold_of(observations.pose[keep], folds)
        H, g = np.zeros((folds, k, k)), np.zeros((folds, k))
        coordinates = np.zeros(folds)
        squares, levers, moved = 0.0, np.zeros(n), 0.0
        for rows in pieces(observations):
            linear = Linearised.at(observations.select(rows), parameters, keep[rows], noise)
            groups = linear.whitening.groups
            U = linear.weights * linear.columns(free)
            u = linear.weights[:, 0] * linear.whitened_residuals
            of_visit = np.zeros(groups.poses, dtype=int)
            of_visit[groups.pose] = fold[rows][groups.rows]
            of_coordinate = of_visit[groups.visit]
            for f in range(folds):
                part, own = U[of_coordinate == f], u[of_coordinate == f]
                H[f] += part.T @ part
                g[f] += part.T @ own
                coordinates[f] += len(own)
            squares += float(u @ u)
            by_angle, told = linear.by_angle_in_space, len(groups.rows)
            levers += np.sum(by_angle**2, axis=(0, 1))
            moved += float(np.sum((by_angle[groups.rows] * noise.joint_sigma) ** 2)) / 3.0
            moved += told * (linear.sensor_variance - noise.sensor_sigma**2)
        count = max(int(keep.sum()), 1)
        levers /= len(observations)
        return cls(H, g, coordinates, squares, levers, moved / count, fold[keep])


def pieces(observations: Observations) -> Iterator[NDArray]:
    """Yield the rows of whole poses, so many at once as are worked on together."""
    count = len(observations)
    if count <= _PIECE:
        yield np.arange(count)
        return
    order = np.argsort(observations.pose, kind="stable")
    ends = np.flatnonzero(np.diff(observations.pose[order])) + 1
    at = np.searchsorted(ends, np.arange(_PIECE, count, _PIECE))
    yield from np.split(order, np.unique(ends[at[at < len(ends)]]))

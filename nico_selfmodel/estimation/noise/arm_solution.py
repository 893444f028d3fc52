"""An arm at a solution: named parameters, what is known of them, and the noise about them."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.pose_groups import PoseGroups
from nico_selfmodel.estimation.noise.pose_noise import PoseNoise, PoseWhitening
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.model.arm.dh_parameters import DhParameters, slopes_by_angle
from nico_selfmodel.optimization.uncertainty import Uncertainty, scales_by_priors

Priors = Mapping[str, tuple[float, float]]
"""Mean and standard deviation, by name."""
_LEAST_LEVER = 6.0
"""Distance of tracked points from an axis, over the noise, below which it is unobservable."""


@dataclass(frozen=True, eq=False)
class ArmSolution:
    """Named parameters at a solution, with what is known of them."""

    parameters: DhParameters
    """Table and servos."""
    free: frozenset[str]
    """Names that were estimated."""
    outliers: NDArray
    """Outlier rows. Boolean, shape (N,)."""
    uncertainty: Uncertainty | None
    """Of the free parameters; None where nothing was refined."""
    noise: PoseNoise | None
    """Of the sensor and of the joints; None where nothing was refined."""
    noise_sigma: float | None
    """Standard deviation of a measured coordinate about the model, rms over the poses [m]."""
    converged: bool
    iterations: int
    history: tuple[float, ...]
    priors: Priors = field(default_factory=dict)
    """What is known beforehand of some parameters."""

    @classmethod
    def unrefined(cls, observations: Observations, parameters: DhParameters) -> "ArmSolution":
        """Wrap parameters that were not refined, so that nothing is known of their errors."""
        residuals = observations.predicted(parameters)[0] - observations.p_WH
        free = frozenset(parameters.names) - parameters.gauge
        sigma = float(np.sqrt(np.mean(residuals**2)))
        nothing = np.zeros(len(observations), dtype=bool)
        return cls(parameters, free, nothing, None, None, sigma, True, 0, ())


@dataclass(frozen=True, eq=False)
class Linearised:
    """Residuals and derivatives of all rows at a solution, and their whitening by pose."""

    names: tuple[str, ...]
    """All parameters, P of them."""
    residuals: NDArray
    """Measured minus predicted [m], as all below in coordinates in which the sensor errs alike
    (`Observations.alike`). Shape (N, 3)."""
    jacobian: NDArray
    """Derivatives of the predictions by all parameters. Shape (N, 3, P)."""
    by_angle: NDArray
    """Derivatives of the predictions by the joint angles. Shape (N, 3, n)."""
    noise: PoseNoise
    """What disturbs the rows."""
    whitening: PoseWhitening
    """of the inlier rows."""
    stretch: NDArray | None = field(default=None, kw_only=True)
    """`Observations.stretch`, which leads back into space."""

    @classmethod
    def at(
        cls,
        observations: Observations,
        parameters: DhParameters,
        keep: NDArray,
        noise: PoseNoise,
    ) -> "Linearised":
        """Linearise about an arm.

        Args:
            keep: Rows that count. Boolean, shape (N,).
        """
        groups = PoseGroups(observations.visit, keep, 3, observations.pose)
        return cls.of(observations, parameters, groups, noise)

    @classmethod
    def of(
        cls,
        observations: Observations,
        parameters: DhParameters,
        groups: PoseGroups,
        noise: PoseNoise,
        predicted: tuple[NDArray, NDArray] | None = None,
    ) -> "Linearised":
        """Linearise as `at` does, of rows that were grouped, and perhaps predicted, before."""
        p, jacobian = predicted or observations.predicted(parameters)
        jacobian = observations.alike(jacobian)
        by_angle = slopes_by_angle(parameters, jacobian)
        return cls(
            parameters.names,
            observations.alike((observations.p_WH - p)[:, :, None])[:, :, 0],
            jacobian,
            by_angle,
            noise,
            PoseWhitening(groups, by_angle, noise),
            stretch=observations.stretch,
        )

    @property
    def by_angle_in_space(self) -> NDArray:
        """Derivatives of the points by the joint angles [m/rad]. Shape (N, 3, n)."""
        return self.by_angle if self.stretch is None else self.stretch @ self.by_angle

    @property
    def sensor_variance(self) -> float:
        """Variance of a measured coordinate by the sensor, mean over the rows that count [m^2]."""
        alone = self.noise.sensor_sigma**2
        if self.stretch is None:
            return alone
        return alone * float(np.mean(np.sum(self.stretch[self.rows] ** 2, axis=(1, 2)))) / 3.0

    def with_noise(self, noise: PoseNoise) -> "Linearised":
        """Return the same with other noise."""
        whitening = PoseWhitening(self.whitening.groups, self.by_angle, noise)
        return replace(self, noise=noise, whitening=whitening)

    def columns(self, free: frozenset[str]) -> NDArray:
        """Return the whitened derivatives by some parameters, in their order. Shape (m, k)."""
        chosen = [i for i, name in enumerate(self.names) if name in free]
        return self.whitened(self.jacobian[:, :, chosen])

    def whitened(self, columns: NDArray) -> NDArray:
        """Whiten columns of the rows that count. Shape (N, 3, m) -> (coordinates, m)."""
        return self.whitening.root(self.whitening.groups.gather(columns))

    @property
    def rows(self) -> NDArray:
        """Rows that count. Shape (K,)."""
        return self.whitening.groups.rows

    @property
    def whitened_residuals(self) -> NDArray:
        """Whitened residuals of the rows that count. Shape (coordinates,)."""
        return self.whitened(self.residuals[:, :, None])[:, 0]

    @property
    def weights(self) -> NDArray:
        """Roots of what each whitened coordinate counts in a fit. Shape (coordinates, 1)."""
        groups = self.whitening.groups
        return np.sqrt(groups.weight)[groups.visit, None]


def information_of(parameters: DhParameters, chosen: list[int], priors: Priors) -> NDArray:
    """Return the inverse variances that priors give some parameters, by column. Shape (k,)."""
    names = [parameters.names[i] for i in chosen]
    return np.array([priors[name][1] ** -2.0 if name in priors else 0.0 for name in names])


def pull_of(parameters: DhParameters, chosen: list[int], priors: Priors) -> NDArray:
    """Return how far each prior's mean is from its parameter; 0 without one. Shape (k,)."""
    values = parameters.values[chosen]
    names = [parameters.names[i] for i in chosen]
    means = [
        priors[name][0] if name in priors else v for name, v in zip(names, values, strict=True)
    ]
    return np.array(means) - values


def uncertainty_of(
    linear: Linearised,
    free: frozenset[str],
    observations: Observations,
    parameters: DhParameters,
    *,
    variances_known: bool,
    priors: Priors,
) -> Uncertainty:
    """Analyse the rows that count at a solution.

    Args:
        variances_known: Whether the noise is that of the data; else one factor is estimated.
    """
    names = tuple(name for name in linear.names if name in free)
    own = [linear.names.index(name) for name in names]
    U, u = linear.weights * linear.columns(free), linear.weights[:, 0] * linear.whitened_residuals
    scales = scales_by_priors(names, parameters.scales(observations.size)[own], priors)
    known = information_of(parameters, own, priors)
    count = 3 * len(linear.whitening.groups.rows) + int((known > 0.0).sum())
    pulled = float(known @ pull_of(parameters, own, priors) ** 2)
    squares = float(count - len(names)) if variances_known else float(u @ u) + pulled
    if known.any():
        U = np.vstack([U, np.diag(np.sqrt(known))[known > 0.0]])
    found = Uncertainty.from_jacobian(names, U, scales, squares, count)
    levers = np.mean(np.sum(linear.by_angle_in_space**2, axis=1), axis=0)
    return without_levers(found, parameters, scales, coordinate_sigma(linear), levers)


def without_levers(
    found: Uncertainty,
    parameters: DhParameters,
    natural: NDArray,
    sigma: float,
    levers: NDArray,
) -> Uncertainty:
    """Return an uncertainty that knows which joints turn no tracked point beyond the noise.

    Args:
        found: By the derivatives alone.
        natural: Natural scale of each parameter that was estimated. Shape (k,).
        sigma: Standard deviation of a coordinate, before its variance factor [m].
        levers: Mean square distance of the tracked points from each axis [m^2]. Shape (n,).
    """
    noise = sigma * (
        float(np.sqrt(found.variance_factor)) if np.isfinite(found.variance_factor) else 1.0
    )
    free = frozenset(found.names)
    for unobservable in _levers_of_noise(np.sqrt(levers), parameters, free, noise):
        found = found.with_unobservable(unobservable, natural)
    return found


def coordinate_sigma(linear: Linearised) -> float:
    """Return the standard deviation of a coordinate, rms over the rows that count [m]."""
    moved = linear.by_angle_in_space[linear.rows] * linear.noise.joint_sigma
    variance = linear.sensor_variance + np.mean(np.sum(moved**2, axis=(1, 2))) / 3.0
    return float(np.sqrt(variance))


def _levers_of_noise(
    levers: NDArray, parameters: DhParameters, free: frozenset[str], noise: float
) -> list[tuple[str, ...]]:
    """Return zero and gear of joints whose turning moves no tracked point beyond the noise.

    Such a point circles in its own noise: a gear fits it, with a sigma that means nothing.
    """
    found = []
    for joint, lever in zip(parameters.table.joints, levers.tolist(), strict=True):
        names = tuple(n for n in (f"{joint}.gear", f"{joint}.theta_offset") if n in free)
        if names and lever < _LEAST_LEVER * noise:
            found.append(names)
    return found

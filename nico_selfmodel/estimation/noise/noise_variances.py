"""Variances of sensor and joints by restricted likelihood: what no fit could take.

With P = S^-1 - S^-1 J C J' S^-1 and w = P r, the derivative of the log likelihood by log theta_i is
(w' V_i w - tr P V_i) / 2, V_i = dS / dlog theta_i, and its second derivative is about
-(V_i w)' P (V_j w) / 2 (average information; Gilmour, Thompson, Cullis 1995).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.pose_noise import PoseGroups, PoseNoise, PoseWhitening

_ROUNDS, _SETTLED = 40, 2e-3
_LARGEST_STEP = 1.0
"""Of a logarithm of a variance in one round."""
_LEAST_SHARE = 0.02
"""Part of the residuals below which a standard deviation counts as none."""
_INSEPARABLE = 60
"""Poses of a single point below which sensor and joints can hardly be told apart ..."""
_LEAST_SENSOR_SHARE = 0.1
"""... and the part of the residuals that the sensor then has at least."""


@dataclass(frozen=True, eq=False)
class LinearResiduals:
    """Residuals about a solution, by pose, with their derivatives."""

    groups: PoseGroups
    r: NDArray
    """Measured minus predicted. Shape (poses, K, 1)."""
    J: NDArray
    """Derivatives of the predictions by the free parameters. Shape (poses, K, P)."""
    by_angle: NDArray
    """Derivatives of the rows' coordinates by the joint angles. Shape (N, k, n)."""

    @property
    def rms(self) -> float:
        """Root mean square of a coordinate."""
        return float(np.sqrt(np.sum(self.r**2) / (len(self.groups.rows) * self.groups.k)))


def most_likely_noise(
    residuals: LinearResiduals,
    start: PoseNoise,
    known: NDArray,
    sensor_sigma: float | None = None,
    *,
    apart: bool = False,
) -> PoseNoise:
    """Estimate the standard deviations of the sensor and of the joints.

    Args:
        residuals: About a solution.
        start: Where the search begins.
        known: Variance of each joint angle that is known beforehand, as of counting [rad^2]. (n,).
        sensor_sigma: The sensor's, where it is not to be estimated.
        apart: Take one standard deviation for each joint where they are likelier than one for all
            by more than their number explains (BIC).

    Returns:
        The noise; the joints' standard deviations include what is known.
    """
    n = len(known)
    together = _Search(residuals, known, np.zeros(n, dtype=int), sensor_sigma).run(start)
    if n == 1 or not apart:
        return together.noise
    each = _Search(residuals, known, np.arange(n), sensor_sigma).run(together.noise)
    worth = (n - 1) * np.log(residuals.groups.poses)
    return each.noise if 2.0 * (each.likelihood - together.likelihood) > worth else together.noise


@dataclass(frozen=True)
class _Found:
    noise: PoseNoise
    likelihood: float


class _Search:
    """Average information steps of the logarithms of the variances."""

    def __init__(
        self,
        residuals: LinearResiduals,
        known: NDArray,
        group: NDArray,
        sensor_sigma: float | None,
    ) -> None:
        self.data, self.known, self.group = residuals, known, group
        self.member = (group[:, None] == np.arange(group.max() + 1)).astype(float)
        self.given = sensor_sigma
        lever = np.sqrt(np.mean(np.sum(residuals.by_angle[residuals.groups.rows] ** 2, axis=1)))
        groups = residuals.groups
        single = len(groups.rows) == groups.poses < _INSEPARABLE
        share = _LEAST_SENSOR_SHARE if single else _LEAST_SHARE
        floor = max(residuals.rms, 1e-12)
        joint = _LEAST_SHARE * floor / max(lever, 1e-12)
        self.floor = np.log([(share * floor) ** 2, *np.full(group.max() + 1, joint**2)])

    def noise_of(self, x: NDArray) -> PoseNoise:
        variances = np.exp(x)
        sensor = float(np.sqrt(variances[0])) if self.given is None else self.given
        return PoseNoise(sensor, np.sqrt(variances[1:][self.group] + self.known))

    def run(self, start: PoseNoise) -> _Found:
        joint = np.maximum(start.joint_sigma**2 - self.known, 1e-30)
        joint = np.bincount(self.group, joint) / np.bincount(self.group)
        x = np.maximum(np.log([start.sensor_sigma**2, *joint]), self.floor)
        likelihood = -np.inf
        for _ in range(_ROUNDS):
            likelihood, score, information = self.step(self.noise_of(x), np.exp(x))
            # A variance at its floor that wants to fall takes no part.
            free = (x > self.floor) | (score > 0.0)
            free[0] &= self.given is None
            step = np.zeros(len(x))
            inside = information[np.ix_(free, free)]
            ridge = 1e-6 * np.trace(inside) * np.eye(len(inside))
            step[free] = np.linalg.solve(inside + ridge, score[free])
            moved = np.maximum(x + np.clip(step, -_LARGEST_STEP, _LARGEST_STEP), self.floor)
            settled = np.abs(moved - x).max() < _SETTLED
            x = moved
            if settled:
                break
        return _Found(self.noise_of(x), likelihood)

    def step(self, noise: PoseNoise, variances: NDArray) -> tuple[float, NDArray, NDArray]:
        """Return log likelihood, score and average information."""
        data = self.data
        S = PoseWhitening(data.groups, data.by_angle, noise)
        SiJ, Sir, A = S.inverse(data.J), S.inverse(data.r), S.lever
        J = data.J.reshape(-1, data.J.shape[2])
        flat = SiJ.reshape(J.shape)
        C, determinant = _inverse(J.T @ flat)
        w = Sir - (flat @ (C @ (flat.T @ data.r.reshape(-1)))).reshape(Sir.shape)
        # Columns y_i = V_i w: the sensor, then the groups of joints.
        along = np.swapaxes(A, 1, 2) @ w
        moved = A * (along[:, :, 0][:, None] * variances[1:][self.group])
        y = np.concatenate([noise.sensor_sigma**2 * w, moved @ self.member], axis=2)
        quadratic = np.einsum("gki,gk->i", y, w[:, :, 0])
        y_flat = y.reshape(-1, y.shape[2])
        JSiy = flat.T @ y_flat
        information = 0.5 * (y_flat.T @ S.inverse(y).reshape(y_flat.shape) - JSiy.T @ C @ JSiy)
        sensor = S.inverse_trace - noise.sensor_sigma**2 * float(np.sum(C * (flat.T @ flat)))
        # tr P a_j a_j' of every joint
        ASiJ = np.swapaxes(A, 1, 2) @ SiJ
        own = np.sum(A * S.inverse(A), axis=(0, 1)) - np.sum((ASiJ @ C) * ASiJ, axis=(0, 2))
        joints = self.member.T @ (own * variances[1:][self.group])
        score = 0.5 * (quadratic - np.array([sensor, *joints]))
        rPr = float(np.sum(data.r * w))
        return -0.5 * (S.log_determinant + determinant + rPr), score, information


def _inverse(H: NDArray) -> tuple[NDArray, float]:
    """Return the inverse and the log determinant; directions that nothing tells are left out."""
    unit = np.sqrt(np.where(np.diag(H) > 0.0, np.diag(H), 1.0))
    values, vectors = np.linalg.eigh(H / np.outer(unit, unit))
    kept = values > 1e-12 * values[-1]
    inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T / np.outer(unit, unit)
    return inverse, float(2.0 * np.sum(np.log(unit)) + np.sum(np.log(values[kept])))

"""Variances of sensors and joints by restricted likelihood: what no fit could take.

With P = S^-1 - S^-1 J C J' S^-1, C^-1 = J' S^-1 J + what is known beforehand, and w = P r of the
residuals r about what is known, the derivative of the log likelihood by log theta_i is
(w' V_i w - tr P V_i) / 2, V_i = dS / dlog theta_i, and its second derivative is about
-(V_i w)' P (V_j w) / 2 (average information; Gilmour, Thompson, Cullis 1995).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.pose_groups import PoseGroups
from nico_selfmodel.estimation.noise.pose_noise import PoseNoise, PoseWhitening

_ROUNDS, _SETTLED = 40, 2e-3
_LARGEST_STEP = 1.0
"""Of a logarithm of a variance in one round."""
_UNTOLD, _WELL_TOLD = 1e-12, 1e-8
"""Parts of the largest eigenvalue, parameters taken in their own units, below which a direction is
told by nothing, and part of a parameter's own information, beside all others, above which all are
told for sure."""
_LITTLE = 0.5
"""Variance of a variance's logarithm that is counted at most: four freedoms tell it."""
LEAST_OF_ALL = 0.002
"""Part of the residuals about what is known beforehand that noise is at least."""


@dataclass(frozen=True, eq=False)
class LinearResiduals:
    """Residuals about a solution, by pose, with their derivatives."""

    groups: PoseGroups
    r: NDArray
    """Measured minus predicted, by visit. Shape (T,)."""
    J: NDArray
    """Derivatives of the predictions by the free parameters, by visit. Shape (T, P)."""
    by_angle: NDArray
    """Derivatives of the rows' coordinates by the joint angles. Shape (N, k, n)."""
    sensor: NDArray | None = None
    """Index of each coordinate's sensor; one for all if omitted. Shape (N, k)."""
    slipped: NDArray | None = None
    """Joints that jumped in a visit, of which their noise says nothing. Boolean, (visits, n)."""
    information: NDArray | None = None
    """Inverse variances of what is known of the parameters beforehand, where `r` is about their
    means; fitting takes less from the residuals then. Shape (P,)."""
    taken: NDArray | None = None
    """Freedoms of each sensor's coordinates that something took before. Shape (G,)."""

    @property
    def by_row(self) -> NDArray:
        """The residuals, zero for rows left out. Shape (N, k)."""
        return self.groups.scatter(self.r)

    def left(self, sensor: NDArray, joint: NDArray) -> NDArray:
        """Return what fitting leaves at some noise, r - J C J' S^-1 r, by row; `r` is about priors.

        An effect whose prior is about zero is still in `r`: its size is no noise.

        Args:
            sensor: Standard deviation of each sensor's coordinates. Shape (G,).
            joint: Of the joints. Shape (n,).

        Returns:
            Zero for rows left out. Shape (N, k).
        """
        if self.information is None:
            return self.by_row
        own = np.zeros(self.by_angle.shape[:2], dtype=int) if self.sensor is None else self.sensor
        scale = self.groups.gather(sensor[own])
        scale = np.where(scale > 0.0, scale, 1.0)
        by_angle = self.by_angle / sensor[own][:, :, None]
        S = PoseWhitening(self.groups, by_angle, PoseNoise(1.0, joint), self.slipped)
        r, J = self.r / scale, self.J / scale[:, None]
        solved = S.inverse(np.column_stack([r, J]))
        L = _root_of_inverse(J.T @ solved[:, 1:] + np.diag(self.information))[0]
        fitted = J @ (L @ (L.T @ (J.T @ solved[:, 0])))
        return self.groups.scatter((r - fitted) * scale)


@dataclass(frozen=True, eq=False)
class Variances:
    """Standard deviations, and how likely they are."""

    sensor: NDArray
    """Of each sensor's coordinates. Shape (G,)."""
    joint: NDArray
    """Of each joint, what is known beforehand included [rad]. Shape (n,)."""
    likelihood: float
    """Restricted log likelihood, but for a constant."""


class VarianceSearch:
    """Average information steps of the logarithms of the variances."""

    def __init__(
        self,
        residuals: LinearResiduals,
        known: NDArray,
        joint_group: NDArray,
        floor: NDArray,
        sensor_held: NDArray,
    ) -> None:
        """Prepare.

        Args:
            known: Variance of each joint that is known beforehand, as of counting. Shape (n,).
            joint_group: Which joints share a standard deviation. Shape (n,).
            floor: Least standard deviations, of sensors and of groups of joints. Shape (G + H,).
            sensor_held: Sensors whose standard deviation stays. Boolean, shape (G,).
        """
        self.data, self.known, self.group = residuals, known, joint_group
        self.member = (joint_group[:, None] == np.arange(joint_group.max(initial=-1) + 1)) * 1.0
        self.held, self.floor = sensor_held, 2.0 * np.log(floor)
        rows = residuals.by_angle.shape[:2]
        self._sensor = np.zeros(rows, dtype=int) if residuals.sensor is None else residuals.sensor
        self._grouped = residuals.groups.gather(self._sensor + 1) - 1
        """Sensor of each coordinate by visit, -1 where nothing stands. Shape (T,)."""
        self._own = self._grouped[:, None] == np.arange(len(sensor_held))
        self._counts = self._own.sum(axis=0)
        if residuals.taken is not None:
            self._counts = self._counts - residuals.taken
        self._given = np.ones(len(sensor_held))
        self._columns = np.column_stack([residuals.r, residuals.J])

    def run(self, sensor: NDArray, joint: NDArray) -> Variances:
        """Search.

        Args:
            sensor: Standard deviations where the search begins. Shape (G,).
            joint: Of the joints. Shape (n,).

        Returns:
            The likeliest.
        """
        x, held = self._start(sensor, joint)
        likelihood = -np.inf
        for _ in range(_ROUNDS):
            likelihood, score, information = self._step(x)
            step = self._solved(x, held, score, information)
            moved = x + np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
            moved = np.where(held, x, np.maximum(moved, self.floor))
            settled = np.abs(moved - x).max(initial=0.0) < _SETTLED
            x = moved
            if settled:
                break
        return Variances(*self._sigmas(x), likelihood)

    def promised(self, sensor: NDArray, joint: NDArray) -> float:
        """Return what one step promises of the log likelihood: half of what is found, or more.

        Of n numbers whose variance is rho times as large, n (rho - 1)^2 / (4 rho) of n (rho - 1 -
        log rho) / 2.

        Args:
            sensor: Standard deviations where the search would begin. Shape (G,).
            joint: Of the joints. Shape (n,).
        """
        x, held = self._start(sensor, joint)
        _, score, information = self._step(x)
        return 0.5 * float(score @ self._solved(x, held, score, information))

    def expected(self, found: Variances) -> Variances:
        """Return variances as they are in the mean, given residuals that tell little.

        A variance that nu freedoms tell is nu / (nu - 2) times the likeliest in the mean (inverse
        chi-square; Gelman et al. 2013, 3.2), and that of its logarithm is 2 / nu.

        Args:
            found: The likeliest.
        """
        x, held = self._start(found.sensor, found.joint)
        _, score, information = self._step(x)
        free = ((x > self.floor) | (score > 0.0)) & ~held
        spread = np.zeros(len(x))
        spread[free] = np.diag(np.linalg.pinv(information[np.ix_(free, free)]))
        sensor, joint = self._sigmas(x - np.log(1.0 - np.minimum(spread, _LITTLE)))
        return replace(found, sensor=sensor, joint=joint)

    def _start(self, sensor: NDArray, joint: NDArray) -> tuple[NDArray, NDArray]:
        """Return logarithms of all variances, and which of them stay."""
        free_part = np.maximum(joint**2 - self.known, 1e-30)
        shared = np.bincount(self.group, free_part) / np.bincount(self.group)
        x = np.log(np.concatenate([sensor**2, shared]))
        held = np.append(self.held, np.zeros(len(shared), dtype=bool))
        self._given = np.asarray(sensor, dtype=float)
        return np.where(held, x, np.maximum(x, self.floor)), held

    def _solved(self, x: NDArray, held: NDArray, score: NDArray, information: NDArray) -> NDArray:
        """Return a whole step."""
        # A variance at its floor that wants to fall takes no part.
        free = ((x > self.floor) | (score > 0.0)) & ~held
        step = np.zeros(len(x))
        inside = information[np.ix_(free, free)]
        # Exact data tell nothing of a variance but which way it goes.
        least = max(1e-6 * np.trace(inside), np.finfo(float).tiny)
        ridge = least * np.eye(len(inside))
        step[free] = np.linalg.solve(inside + ridge, score[free])
        return step

    def _sigmas(self, x: NDArray) -> tuple[NDArray, NDArray]:
        sensors = len(self.held)
        variances = np.exp(x)
        sensor = np.where(self.held, self._given, np.sqrt(variances[:sensors]))
        return sensor, np.sqrt(variances[sensors:][self.group] + self.known)

    def _step(self, x: NDArray) -> tuple[float, NDArray, NDArray]:
        """Return log likelihood, score and average information.

        Coordinates are taken in their sensors' standard deviations, so that V_g is the identity
        on the coordinates of sensor g, and whitened by W, W'W = S^-1, so that with C = L L'

            e = W r - W J C J' S^-1 r,  Z = W J L,  w = W' e,  W P W' = I - Z Z'

        and V_i w is y = W V_i w whitened.
        """
        data = self.data
        sensor, joint = self._sigmas(x)
        shared = np.exp(x[len(sensor) :])[self.group]
        scale = np.where(self._grouped < 0, 1.0, sensor[self._grouped])[:, None]
        by_angle = data.by_angle / sensor[self._sensor][:, :, None]
        S = PoseWhitening(data.groups, by_angle, PoseNoise(1.0, joint), data.slipped)
        found = S.root(np.column_stack([self._columns / scale, S.lever]))
        white, A = np.split(found, [self._columns.shape[1]], axis=1)
        sums = white.T @ white
        known = 0.0 if data.information is None else np.diag(data.information)
        L, determinant = _root_of_inverse(sums[1:, 1:] + known)
        fit = np.zeros((len(sums), 1 + L.shape[1]))
        fit[0, 0], fit[1:, 0], fit[1:, 1:] = 1.0, -L @ (L.T @ sums[1:, 0]), L
        both = white @ fit  # e, Z
        told = data.groups.products(A, both)
        along, fitted = told[:, :, 0], np.einsum("vjp,vjp->vj", told[:, :, 1:], told[:, :, 1:])
        own = np.einsum("vjj->vj", data.groups.products(A, A))
        # tr P a_j a_j' of every joint
        each = own - fitted
        back = S.transposed_root(both if len(sensor) > 1 else both[:, :1])
        steady = 1.0 if data.slipped is None else 1.0 - data.slipped
        # Columns y_i = W V_i w: the sensors, then the groups of joints.
        moved = A * (along * steady * shared)[data.groups.visit]
        y = np.column_stack([S.root(back[:, :1] * self._own), moved @ self.member])
        products = both.T @ y
        information = 0.5 * (y.T @ y - products[1:].T @ products[1:])
        joints = self.member.T @ (np.sum(each * steady, axis=0) * shared)
        sensors = self._counts - self._lost(S, L, back[:, 1:], each)
        score = 0.5 * (products[0] - np.concatenate([sensors, joints]))
        spread = S.log_determinant + 2.0 * float(self._counts @ np.log(sensor))
        squares = float(white[:, 0] @ both[:, 0])
        return -0.5 * (spread + determinant + squares), score, information

    def _lost(self, S: PoseWhitening, L: NDArray, back: NDArray, each: NDArray) -> NDArray:
        """Return what joints and fitting take of each sensor's coordinates. Shape (G,).

        Of one sensor it is what is left of tr P S, the coordinates less what was fitted.

        Args:
            S: Covariance of the visits.
            L: C = LL'. Shape (P, p).
            back: W' Z, of several sensors. Shape (T, p).
            each: a_j' P a_j of every joint. Shape (visits, n).
        """
        if len(self.held) > 1:
            lost = S.taken + np.einsum("tp,tp->t", back, back)
            return np.asarray(lost @ self._own)
        known = self.data.information
        fitted = L.shape[1] - (0.0 if known is None else float(known @ np.sum(L**2, axis=1)))
        return np.array([fitted + float(np.sum(each * S.joint_sigma**2))])


def _root_of_inverse(H: NDArray) -> tuple[NDArray, float]:
    """Return L with LL' = H^-1, and log|H|; directions that nothing tells are left out."""
    unit = np.sqrt(np.where(np.diag(H) > 0.0, np.diag(H), 1.0))
    alike = H / np.outer(unit, unit)
    scale = float(2.0 * np.sum(np.log(unit)))
    try:
        lower = np.linalg.cholesky(alike)
    except np.linalg.LinAlgError:
        lower = np.zeros_like(alike)
    pivots = np.diag(lower)
    if (pivots**2 > _WELL_TOLD).all():
        return np.linalg.inv(lower).T / unit[:, None], scale + 2.0 * float(np.sum(np.log(pivots)))
    values, vectors = np.linalg.eigh(alike)
    kept = values > _UNTOLD * values[-1]
    root = vectors[:, kept] / np.sqrt(values[kept]) / unit[:, None]
    return root, scale + float(np.sum(np.log(values[kept])))

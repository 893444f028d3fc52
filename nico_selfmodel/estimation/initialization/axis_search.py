"""Arms from nothing: joint axes found from random directions.

With the directions (and gears) given, the measured point is linear in all axis points and hand
points: p = c_1 + R_1 (c_2 - c_1) + ... + R_1 ... R_n (p_zero - c_n). They are eliminated (variable
projection, Golub and Pereyra 1973, in Kaufman's form), so that only 2 numbers a joint, and its gear
where unknown, are searched. Random starts then reach the best minimum often: one in five for the
seven joints of a Franka arm with 80 poses.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.observations.arm_estimate import ArmEstimate
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.geometry.rotation import move_on_sphere, tangent_basis
from nico_selfmodel.least_squares import NormalEquations, levenberg_marquardt
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.line_kinematics import carried_rotations, hand_derivatives
from nico_selfmodel.optimization.losses import Loss, robust_scale

_ROUNDS = 3
_SINGULAR = 1e-8
"""Ratio of pivots below which what is linear is not determined."""
_ITERATIONS = 25


def random_starts(
    observations: Observations,
    gear_known: NDArray,
    zero: NDArray,
    rng: np.random.Generator,
    *,
    directions: NDArray | None = None,
    gear: NDArray | None = None,
) -> Iterator[ArmEstimate]:
    """Yield arms, each the local optimum of one random start; endless.

    Args:
        observations: What was measured.
        gear_known: Joints whose gear is not searched. Shape (n,).
        zero: Encoder angles of the zero configuration [rad]. Shape (n,).
        rng: Source of the starts.
        directions: Directions to stay near, nan where unknown: every second start stays within
            about 25 deg of them, the others ignore them. Shape (n, 3).
        gear: Gears that go with them, nan where unknown. Shape (n,).

    Yields:
        Arms with all lines, gears and hand points.
    """
    n = len(observations.joints)
    span = np.maximum(np.ptp(observations.angles, axis=0), 1e-9)
    for count in range(10**9):
        drawn = rng.normal(size=(n, 3))
        # A joint with an unknown gear is taken to have turned by 20 to 200 degrees.
        gears = span / np.radians(20.0 * 10.0 ** rng.random(n))
        if directions is not None and gear is not None and count % 2 == 1:
            near = directions + 0.25 * rng.normal(size=(n, 3))
            drawn = np.where(np.isfinite(near), near, drawn)
            gears = np.where(np.isfinite(gear), gear, gears)
        start = drawn / np.linalg.norm(drawn, axis=1, keepdims=True)
        yield project_variables(
            observations, start, np.where(gear_known, 1.0, gears), gear_known, zero
        )


def project_variables(
    observations: Observations,
    directions: NDArray,
    gear: NDArray,
    gear_known: NDArray,
    zero: NDArray,
    *,
    rounds: int = _ROUNDS,
) -> ArmEstimate:
    """Refine directions and unknown gears, with everything linear eliminated.

    Args:
        observations: What was measured.
        directions: Start, unit length. Shape (n, 3).
        gear: Start. Shape (n,).
        gear_known: Joints whose gear stays. Shape (n,).
        zero: Encoder angles of the zero configuration [rad]. Shape (n,).
        rounds: Rounds of reweighting; after the first, large residuals lose their weight.

    Returns:
        The arm at the local optimum.
    """
    middle = observations.p_WH.mean(axis=0)
    problem = _Projection(observations, zero, middle)
    free = np.flatnonzero(~gear_known)
    weights = np.ones(len(observations))
    before = np.inf
    for _ in range(rounds):
        base, base_gear = directions, gear

        def evaluate(
            x: NDArray,
            base: NDArray = base,
            base_gear: NDArray = base_gear,
            weights: NDArray = weights,
        ) -> NormalEquations:
            d, slopes, g = _at(base, base_gear, free, x)
            return problem.normal_equations(d, slopes, g, free, weights)

        x = np.zeros(2 * len(gear) + len(free))
        fit = levenberg_marquardt(evaluate, x, max_iterations=_ITERATIONS, tolerance=1e-6)
        directions, _, gear = _at(base, base_gear, free, fit.x)
        norms = np.linalg.norm(problem.solve(directions, gear, weights)[1], axis=0)
        scale = robust_scale(norms, 3)
        if abs(before - scale) < 0.02 * before:
            break
        before = scale
        weights = Loss("cauchy", scale).rho_and_weight(norms**2, 3)[1]
    points, hands = problem.solve(directions, gear, weights)[0]
    chain = Chain(
        observations.joints, directions, points + middle, observations.markers, hands + middle
    )
    return ArmEstimate(chain, gear, zero)


def _at(
    directions: NDArray, gear: NDArray, free: NDArray, x: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    """Return directions, their chart derivatives and gears at x; gears move by their logarithm."""
    n = len(gear)
    moved, slopes = move_on_sphere(directions, x[: 2 * n].reshape(n, 2))
    moved = moved / np.linalg.norm(moved, axis=1, keepdims=True)
    scaled = gear.copy()
    scaled[free] *= np.exp(np.clip(x[2 * n :], -3.0, 3.0))
    return moved, slopes, scaled


class _Projection:
    """The linear part: axis points along two tangents each, and hand points."""

    def __init__(self, observations: Observations, zero: NDArray, middle: NDArray) -> None:
        self._observations = observations
        self._moved = np.ascontiguousarray((observations.angles - zero).T)
        self._measured = (observations.p_WH - middle).T
        self._own = np.stack(
            [observations.marker == k for k in range(len(observations.markers))]
        ).astype(float)

    def solve(
        self, directions: NDArray, gear: NDArray, weights: NDArray
    ) -> tuple[tuple[NDArray, NDArray], NDArray, NDArray, NDArray]:
        """Return axis points (n, 3) and hands (m, 3), residuals, basis of the design, rotations.

        Shapes (3, N), (3N, 2n + 3m) and (n + 1, 3, 3, N), the rotations those that are carried.
        """
        n, count, basis = len(gear), len(self._observations), tangent_basis(directions)
        carried = carried_rotations(directions, self._moved / gear[:, None])
        by_point = np.swapaxes(basis, 1, 2)[:, None] @ (carried[:-1] - carried[1:])
        hands = carried[-1][:, None] * self._own[None, :, None]
        design = np.concatenate(
            [by_point.swapaxes(0, 1).reshape(3, 2 * n, -1), hands.reshape(3, -1, count)], axis=1
        )
        root = np.sqrt(weights)
        weighted = (design * root).transpose(0, 2, 1).reshape(3 * count, -1)
        target = (self._measured * root).ravel()
        basis_of_all, triangle = np.linalg.qr(weighted)
        size = np.abs(np.diag(triangle))
        if size.min() > _SINGULAR * size.max():
            solution = np.linalg.solve(triangle, basis_of_all.T @ target)
        else:
            solution = np.linalg.lstsq(weighted, target, rcond=1e-10)[0]
        points = np.einsum("nij,nj->ni", basis, solution[: 2 * n].reshape(n, 2))
        residuals = solution @ design - self._measured
        return (points, solution[2 * n :].reshape(-1, 3)), residuals, basis_of_all, carried

    def normal_equations(
        self,
        directions: NDArray,
        slopes: NDArray,
        gear: NDArray,
        free: NDArray,
        weights: NDArray,
    ) -> NormalEquations:
        """Return the normal equations of directions and log gears, J = (I - Q Q') dr."""
        (points, hands), residuals, orthonormal, carried = self.solve(directions, gear, weights)
        n, count = len(gear), len(self._observations)
        q = self._moved / gear[:, None]
        p_zero = hands[self._observations.marker].T
        basis = tangent_basis(directions)
        d = hand_derivatives(directions, points, p_zero, q, slopes, basis, carried)
        # q = e / G, so dq / d log G = -q
        by_gear = -d.by_angle[:, free] * q[free]
        nonlinear = np.concatenate([d.by_direction.reshape(3, 2 * n, count), by_gear], axis=1)
        root = np.sqrt(weights)
        jacobian = (nonlinear * root).transpose(0, 2, 1).reshape(3 * count, -1)
        jacobian = jacobian - orthonormal @ (orthonormal.T @ jacobian)
        r = (residuals * root).ravel()
        return 0.5 * float(r @ r), jacobian.T @ r, jacobian.T @ jacobian

"""Arms from nothing: joint axes found from random directions.

With the directions (and gears) given, the measured point is linear in all axis points and hand
points: p = c_1 + R_1 (c_2 - c_1) + ... + R_1 ... R_n (p_zero - c_n). They are eliminated (variable
projection, Golub and Pereyra 1973, in Kaufman's form), so that only 2 numbers a joint, and its gear
where unknown, are searched. Random starts then reach the best minimum often: one in five for the
seven joints of a Franka arm with 80 poses. Joints that shift what is beyond them cost no search:
R_1 ... R_k s q is linear in the shift s, and where no joint turns everything is.
"""

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.observations.arm_estimate import ArmEstimate
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.geometry.rotation import move_on_sphere, tangent_basis
from nico_selfmodel.least_squares import levenberg_marquardt_each
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.line_kinematics import CarriedLines
from nico_selfmodel.optimization.losses import Loss, robust_scale

_ROUNDS = 3
_SINGULAR = 1e-13
"""Share of the largest eigenvalue of the normal equations below which what is linear is not
determined."""
_HOPELESS = 1.5
"""What outliers add to the scale of a first round at most, where they are few."""
_ITERATIONS, _TOLERANCE = 25, 1e-4
"""Of each round; the whole problem is refined from where it ends."""


def random_starts(
    observations: Observations,
    gear_known: NDArray,
    zero: NDArray,
    rng: np.random.Generator,
    *,
    directions: NDArray | None = None,
    gear: NDArray | None = None,
    at_once: int = 8,
    worst: float = np.inf,
    shifting: NDArray | None = None,
) -> Iterator[ArmEstimate]:
    """Yield arms, each the local optimum of one random start; endless.

    Args:
        gear_known: Joints whose gear is not searched. Shape (n,).
        zero: Encoder angles of the zero configuration [rad]. Shape (n,).
        directions: Directions to stay near, nan where unknown: every second start stays within
            about 25 deg of them, the others ignore them. Shape (n, 3).
        gear: Gears that go with them, nan where unknown. Shape (n,).
        at_once: How many are worked out together: eight take twice the time of one.
        worst: Standard deviation of an inlier coordinate above which an arm is of no use [m].
        shifting: Joints that shift along their line; none if omitted. Shape (n,).

    Yields:
        Arms with all lines, gears and hand points. Only lines that turn are those of `predict`.
    """
    n = len(observations.joints)
    drawn, gears = np.empty((at_once, n, 3)), np.empty((at_once, n))
    for first in range(0, 10**9, at_once):
        for k in range(at_once):
            drawn[k], gears[k] = _drawn(observations, rng)
            if directions is not None and gear is not None and (first + k) % 2 == 1:
                near = directions + 0.25 * rng.normal(size=(n, 3))
                drawn[k] = np.where(np.isfinite(near), near, drawn[k])
                gears[k] = np.where(np.isfinite(gear), gear, gears[k])
        starts = drawn / np.linalg.norm(drawn, axis=2, keepdims=True)
        chosen = np.where(gear_known, 1.0, gears)
        known = (gear_known, zero)
        yield from project_variables(
            observations, starts, chosen, *known, worst=worst, shifting=shifting
        )


def first_starts_of_each(
    readings: Sequence[Observations],
    gear_known: NDArray,
    zeros: Sequence[NDArray],
    seed: int,
    each: int,
    worst: float = np.inf,
) -> list[list[ArmEstimate]]:
    """Return the first `random_starts` of the same points with several readings, all at once.

    Args:
        readings: What was measured; of all of them but the angles are the first one's.
        gear_known: Joints whose gear is not searched. Shape (n,).
        zeros: Of each, encoder angles of the zero configuration [rad]. Shape (n,).
        seed: Of the starts of each.
        each: How many.
        worst: As of `random_starts`.
    """
    drawn = []
    for observations in readings:
        rng = np.random.default_rng(seed)
        drawn += [_drawn(observations, rng) for _ in range(each)]
    starts = np.stack([directions for directions, _ in drawn])
    starts = starts / np.linalg.norm(starts, axis=2, keepdims=True)
    gear = np.where(gear_known, 1.0, np.stack([gears for _, gears in drawn]))
    angles = np.repeat(np.stack([one.angles for one in readings]), each, axis=0)
    known = (gear_known, np.repeat(np.stack(zeros), each, axis=0))
    found = project_variables(readings[0], starts, gear, *known, worst=worst, angles=angles)
    return [found[k : k + each] for k in range(0, len(found), each)]


def _drawn(observations: Observations, rng: np.random.Generator) -> tuple[NDArray, NDArray]:
    """Return random directions, not of unit length, shape (n, 3), and gears, shape (n,)."""
    n = len(observations.joints)
    span = np.maximum(np.ptp(observations.angles, axis=0), 1e-9)
    # A joint with an unknown gear is taken to have turned by 20 to 200 degrees.
    return rng.normal(size=(n, 3)), span / np.radians(20.0 * 10.0 ** rng.random(n))


def project_variables(
    observations: Observations,
    directions: NDArray,
    gear: NDArray,
    gear_known: NDArray,
    zero: NDArray,
    *,
    rounds: int = _ROUNDS,
    worst: float = np.inf,
    shifting: NDArray | None = None,
    angles: NDArray | None = None,
) -> list[ArmEstimate]:
    """Refine directions and unknown gears of S starts, with everything linear eliminated.

    Args:
        directions: Starts, unit length. Shape (S, n, 3).
        gear: Starts. Shape (S, n).
        gear_known: Joints whose gear stays. Shape (n,).
        zero: Encoder angles of the zero configuration, of all or of each [rad]. (n,) or (S, n).
        rounds: Rounds of reweighting; after the first, large residuals lose their weight.
        worst: Standard deviation of an inlier coordinate above which an arm is of no use [m]: what
            leaves far more after a round is left as it is.
        shifting: Joints that shift along their line; none if omitted. Shape (n,).
        angles: Encoder angles of each start, where they are not all those that were measured [rad].
            Shape (S, N, n).

    Returns:
        The arms at the local optima. A joint that shifts has a line along its shift, and a gear
        that is found even where it is known: points may be told in any unit of length.
    """
    all_directions, all_gears = directions.copy(), gear.copy()
    shifts = np.zeros(gear.shape[1], dtype=bool) if shifting is None else shifting
    zero = np.broadcast_to(zero, gear.shape)
    read = (observations.angles if angles is None else angles) - zero[:, None]
    directions, gear = all_directions[:, ~shifts], all_gears[:, ~shifts]
    middle = observations.p_WH.mean(axis=0)
    free = np.flatnonzero(~gear_known[~shifts])
    problem = _Projection(observations, read, middle, free, shifts)
    weights = np.ones((len(gear), len(observations)))
    before = np.full(len(gear), np.inf)
    moving = np.arange(len(gear))
    for _ in range(rounds):
        part = problem.of(moving)
        found = part.descended(directions[moving], gear[moving], weights[moving])
        directions[moving], gear[moving] = found
        norms = np.linalg.norm(part.linear(*found, weights[moving]).residuals, axis=1)
        scale = np.array([robust_scale(one, 3) for one in norms])
        changed = ~(np.abs(before[moving] - scale) < 0.02 * before[moving])
        changed &= scale <= _HOPELESS * worst
        moving, norms, scale = moving[changed], norms[changed], scale[changed]
        before[moving] = scale
        for k, size, squared in zip(moving, scale, norms**2, strict=True):
            weights[k] = Loss("cauchy", size).rho_and_weight(squared, 3)[1]
        if not len(moving):
            break
    at = problem.linear(directions, gear, weights)
    size = np.linalg.norm(at.shifts, axis=2)
    all_directions[:, ~shifts], all_gears[:, ~shifts] = directions, gear
    all_directions[:, shifts] = at.shifts / np.maximum(size, 1e-12)[..., None]
    all_gears[:, shifts] = 1.0 / np.maximum(size, 1e-12)
    points = np.zeros_like(all_directions)
    points[:, ~shifts] = at.points
    points, hands = points + middle, at.hands + middle
    joints, markers = observations.joints, observations.markers
    return [
        ArmEstimate(Chain(joints, d, c, markers, hand), g, own)
        for d, c, hand, g, own in zip(all_directions, points, hands, all_gears, zero, strict=True)
    ]


@dataclass(frozen=True, eq=False)
class _Linear:
    """What is linear, at directions and gears of many starts."""

    points: NDArray
    """Axis points. Shape (S, n, 3)."""
    hands: NDArray
    """Hand points at q = 0. Shape (S, m, 3)."""
    shifts: NDArray
    """Shifts for a reading of 1. Shape (S, k, 3)."""
    residuals: NDArray
    """Shape (S, 3, N)."""
    design: NDArray
    """By coordinates of points, hands and shifts, weighted. Shape (S, 2n + 3m + 3k, 3N)."""
    root: NDArray
    """Square root of the inverse of its normal equations, (S, 2n + 3m + 3k, r)."""
    lines: CarriedLines
    q: NDArray
    """Joint displacements [rad]. Shape (S, n, N)."""


class _Projection:
    """Directions and gears of many starts, the axis points along two tangents each eliminated.

    n joints turn; k others shift what is beyond them.
    """

    def __init__(
        self,
        observations: Observations,
        read: NDArray,
        middle: NDArray,
        free: NDArray,
        shifts: NDArray,
    ) -> None:
        self._marker, self._free = observations.marker, free
        moved = np.ascontiguousarray(read.swapaxes(1, 2))
        self._moved, self._shifted = moved[:, ~shifts], moved[:, shifts]
        self._after = np.cumsum(~shifts)[shifts]  # joints that turn it
        self._measured = np.ascontiguousarray((observations.p_WH - middle).T)
        markers = np.arange(len(observations.markers))
        self._own = (observations.marker == markers[:, None]).astype(float)

    def of(self, starts: NDArray) -> "_Projection":
        """Return the problem of some of the starts. Shape (k,)."""
        out = copy(self)
        out._moved, out._shifted = self._moved[starts], self._shifted[starts]
        return out

    def descended(
        self, directions: NDArray, gear: NDArray, weights: NDArray
    ) -> tuple[NDArray, NDArray]:
        """Return directions and gears at the local optima, from starts of shape (S, n, ...)."""

        def evaluate(which: NDArray, x: NDArray) -> tuple[NDArray, NDArray, NDArray]:
            moved = _at(directions[which], gear[which], self._free, x)
            return self.of(which).normal_equations(*moved, weights[which])

        x = np.zeros((len(gear), 2 * gear.shape[1] + len(self._free)))
        if not x.size:
            return directions, gear
        limits = {"max_iterations": _ITERATIONS, "tolerance": _TOLERANCE}
        moved, _, scaled = _at(
            directions, gear, self._free, levenberg_marquardt_each(evaluate, x, **limits)[0]
        )
        return moved, scaled

    def linear(
        self,
        directions: NDArray,
        gear: NDArray,
        weights: NDArray,
        slopes: NDArray | None = None,
    ) -> _Linear:
        """Solve for axis points and hands, with weights of shape (S, N)."""
        many, n = gear.shape
        basis, q = tangent_basis(directions), self._moved / gear[..., None]
        lines = CarriedLines.at(directions, q, basis if slopes is None else slopes, basis)
        by_point = lines.by_point.swapaxes(2, 3).reshape(many, 2 * n, 3, q.shape[-1])
        by_hand = lines.carried[:, -1].swapaxes(1, 2)[:, None] * self._own[:, None, None]
        by_shift = lines.carried[:, self._after].swapaxes(2, 3) * self._shifted[:, :, None, None]
        flat = [part.reshape(many, -1, *by_point.shape[2:]) for part in (by_hand, by_shift)]
        design = np.concatenate([by_point, *flat], axis=1)
        weight = np.sqrt(weights)[:, None]
        weighted = (design * weight[:, None]).reshape(*design.shape[:2], -1)
        target = (self._measured * weight).reshape(many, -1, 1)
        root = _root_of_inverse(weighted @ weighted.swapaxes(1, 2))
        solution = root @ (root.swapaxes(1, 2) @ (weighted @ target))
        fitted = solution.swapaxes(1, 2) @ design.reshape(weighted.shape)
        residuals = fitted.reshape(many, 3, -1) - self._measured
        along = solution[:, : 2 * n].reshape(many, n, 2, 1)
        hands, shifts = np.split(
            solution[:, 2 * n :].reshape(many, -1, 3), [len(self._own)], axis=1
        )
        return _Linear((basis @ along)[..., 0], hands, shifts, residuals, weighted, root, lines, q)

    def normal_equations(
        self, directions: NDArray, slopes: NDArray, gear: NDArray, weights: NDArray
    ) -> tuple[NDArray, NDArray, NDArray]:
        """Return the normal equations of directions and log gears, J = (I - A A^+) dr."""
        at, (many, n) = self.linear(directions, gear, weights, slopes), gear.shape
        hands = at.hands[:, self._marker].swapaxes(1, 2)
        d = at.lines.derivatives(at.points, hands, self._beyond(at))
        weight = np.sqrt(weights)
        free, count = self._free, weights.shape[1]
        jacobian = np.empty((many, 2 * n + len(free), 3, count))
        by_direction = np.moveaxis(d.by_direction, 0, 3).reshape(many, 2 * n, 3, count)
        np.multiply(by_direction, weight[:, None, None], out=jacobian[:, : 2 * n])
        # q = e / G, so dq / d log G = -q
        turned = -(at.q[:, free] * weight[:, None])
        by_gear = np.moveaxis(d.by_angle[..., free, :], 0, 2)
        np.multiply(by_gear, turned[:, :, None], out=jacobian[:, 2 * n :])
        jacobian = jacobian.reshape(many, -1, 3 * count)
        r = (at.residuals * weight[:, None]).reshape(many, -1, 1)
        explained = jacobian @ at.design.swapaxes(1, 2) @ at.root
        hessian = jacobian @ jacobian.swapaxes(1, 2) - explained @ explained.swapaxes(1, 2)
        return 0.5 * np.sum(r * r, axis=(1, 2)), (jacobian @ r)[..., 0], hessian

    def _beyond(self, at: _Linear) -> NDArray | None:
        """Return what shifts beyond each turning joint add to its arm. Shape (S, n, 3, N)."""
        if not len(self._after):
            return None
        carried = at.lines.carried[:, self._after]
        moved = (at.shifts[:, :, None, None, :] @ carried)[..., 0, :] * self._shifted[:, :, None]
        many, k, *point = moved.shape
        turned = np.arange(at.q.shape[1])[:, None] < self._after
        return (turned @ moved.reshape(many, k, -1)).reshape(many, -1, *point)


def _at(
    directions: NDArray, gear: NDArray, free: NDArray, x: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    """Return directions, their chart derivatives and gears at x; gears move by their logarithm."""
    n = gear.shape[1]
    moved, slopes = move_on_sphere(directions, x[:, : 2 * n].reshape(-1, n, 2))
    moved = moved / np.linalg.norm(moved, axis=2, keepdims=True)
    scaled = gear.copy()
    scaled[:, free] *= np.exp(np.clip(x[:, 2 * n :], -3.0, 3.0))
    return moved, slopes, scaled


def _root_of_inverse(matrices: NDArray) -> NDArray:
    """Return L with L L' the pseudoinverse of each symmetric matrix. Shape (S, k, k)."""
    try:
        factor = np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        factor = np.zeros_like(matrices)
    size = np.einsum("skk->sk", factor)
    if (size.min(axis=1) ** 2 > _SINGULAR * size.max(axis=1) ** 2).all():
        return np.linalg.inv(factor).swapaxes(1, 2)
    values, vectors = np.linalg.eigh(matrices)
    known = values > _SINGULAR * values[:, -1:]
    return vectors * np.where(known, np.where(known, values, 1.0) ** -0.5, 0.0)[:, None]

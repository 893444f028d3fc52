"""The most likely core and tail of the noise of poses, by expectation and maximisation.

Each round gives every pose its chances of being of the core, of the tail, or none of the noise at
all (a false detection), and moves each variance v of a component by

    v <- v sqrt(sum_i g_i w_i' V_i w_i / sum_i g_i tr(S_i^-1 V_i)),  w_i = S_i^-1 r_i,  V = dS/dv

which never lowers the likelihood (Zhou, Hu, Zhou, Lange 2019, MM algorithms for variance
components). Near the top rounds hardly move any more: from where two of them lead it is guessed
where many would, x + 2 a r + a^2 v with r = x1 - x, v = x2 - x1 - r, a = |r| / |v| (Varadhan,
Roland 2008, Simple and globally convergent methods for accelerating the convergence of any EM
algorithm), which is kept where the likelihood is no lower there.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.hand_noise import HandNoise
from nico_selfmodel.estimation.noise.mixture_density import core_and_tail
from nico_selfmodel.geometry.small_matrices import invert_along
from nico_selfmodel.model.noise_mixture import LARGEST_JOINT, LARGEST_SHARE, NoiseMixture

_WIDER = 4.0
"""The tail's variances are at least this many times the core's: what is nearer is core."""
_PRIOR_TAIL, _PRIOR = 3.0, 20.0
"""So many poses are counted in, so many of them of the tail: few poses show no tail."""
_PRIOR_FALSE = 0.5
"""So many of one pose more are counted in as false: none seen does not say that there are none."""
_STARTS, _FIRST = (3.0, 10.0, 30.0), 15
"""How much wider the tail is taken to be at first, and rounds by which these starts are compared.
"""
_ROUNDS, _TOLERANCE = 300, 1e-4
"""Most rounds, and the change at which they end, of every number over its size."""


@dataclass(frozen=True, eq=False)
class _Poses:
    """What a mixture is fitted to, laid along the poses."""

    residuals: NDArray
    """Shape (K, N)."""
    levers: NDArray
    """A A', zero where not measured. Shape (K, K, N)."""
    fitted: NDArray
    """M, likewise. Shape (K, K, N)."""
    seen: NDArray
    """Shape (K, N)."""
    spread: float
    """Standard deviation of a coordinate that has nothing to do with the hand [m or px]."""

    @property
    def dof(self) -> NDArray:
        """How many coordinates of each pose were measured. Shape (N,)."""
        return self.seen.sum(axis=0)

    @cached_property
    def lever(self) -> float:
        """By how much a joint noise of one shows in a coordinate, root mean square [m or px]."""
        return float(np.sqrt(np.einsum("iin->", self.levers) / self.seen.sum()))

    def whole(self, parts: tuple[HandNoise, HandNoise]) -> NDArray:
        """Return S + M, the unit matrix where nothing was measured. Shape (K, K, 2, N)."""
        joint = np.array([[part.joint_sigma**2] for part in parts])
        sensor = np.array([[part.sensor_sigma**2] for part in parts])
        out = self.levers[:, :, None] * joint + self.fitted[:, :, None]
        for i, seen in enumerate(self.seen):
            out[i, i] += np.where(seen, sensor, 1.0)
        return out


def most_likely_mixture(
    residuals: NDArray,
    by_angle: NDArray,
    seen: NDArray,
    fitted: NDArray,
    limits: tuple[float, float],
    spread: float,
) -> NoiseMixture:
    """Estimate core and tail.

    Args:
        residuals: Of poses that their prediction was not fitted to. Shape (N, K).
        by_angle: Derivatives of the prediction by the joint angles. Shape (N, K, n).
        seen: Which coordinates were measured. Shape (N, K).
        fitted: M, what each prediction itself is uncertain by. Shape (N, K, K).
        limits: Least and most noise of a coordinate [m or px].
        spread: Standard deviation of where a false detection lies, which is anywhere [m or px].

    Returns:
        The mixture. Without any tail in the data its share is that of the prior.

    Raises:
        ValueError: If no coordinate was measured.
    """
    if not seen.any():
        raise ValueError("no pose, no noise: at least one coordinate must be measured")
    both = seen[:, :, None] & seen[:, None, :]
    levers = np.where(both, by_angle @ np.swapaxes(by_angle, 1, 2), 0.0)
    poses = _Poses(
        _along(np.where(seen, residuals, 0.0)),
        _along(levers),
        _along(np.where(both, fitted, 0.0)),
        _along(seen),
        spread,
    )
    found = [_climbed(poses, _start(poses, wider, limits), limits, _FIRST) for wider in _STARTS]
    _, best = max(found, key=lambda pair: pair[0])
    return _climbed(poses, best, limits, _ROUNDS)[1]


def _along(array: NDArray) -> NDArray:
    """Return an array whose first axis, the poses, is the last and contiguous."""
    return np.array(np.moveaxis(array, 0, -1), order="C")


def _climbed(
    poses: _Poses, noise: NoiseMixture, limits: tuple[float, float], rounds: int
) -> tuple[float, NoiseMixture]:
    """Return the mixture after rounds, and the logarithm of its likelihood before the last."""
    likelihood, longest = -np.inf, 1.0
    for _ in range(0, rounds, 3):
        likelihood, once = _round(poses, noise, limits)
        if _close(noise, once, poses.lever):
            return likelihood, once
        before, twice = _round(poses, once, limits)
        length, guess = _ahead((noise, once, twice), limits, poses.lever, longest)
        likelihood, ahead = _round(poses, guess, limits)
        better = likelihood >= before
        noise = ahead if better else twice
        if length == longest or not better:
            longest = max(longest * (4.0 if better else 0.25), 1.0)
        likelihood = max(likelihood, before)
    return likelihood, noise


def _ahead(
    ways: tuple[NoiseMixture, NoiseMixture, NoiseMixture],
    limits: tuple[float, float],
    lever: float,
    longest: float,
) -> tuple[float, NoiseMixture]:
    """Return a, and the mixture to which many rounds would lead, as two of them let guess."""
    x, x1, x2 = (_numbers(one) for one in ways)
    size = _sizes(x2, lever)
    r, v = x1 - x, (x2 - x1) - (x1 - x)
    length = np.linalg.norm(r / size) / max(np.linalg.norm(v / size), 1e-300)
    a = min(max(float(length), 1.0), longest)
    far = np.clip(x + 2.0 * a * r + a * a * v, 0.5 * x2, 2.0 * x2).tolist()
    parts = (HandNoise(*far[:2]), HandNoise(*far[2:4]))
    return a, _mixture(*parts, (far[4], far[5]), ways[0].poses, limits)


def _start(poses: _Poses, wider: float, limits: tuple[float, float]) -> NoiseMixture:
    """Lay half of the middle squares to the sensor and half to the joints."""
    squares = np.sum(poses.residuals**2, axis=0) / np.maximum(poses.dof, 1)
    half = 0.5 * float(np.median(squares))
    sensor, lever = np.clip(np.sqrt(half), *limits), poses.lever
    joint = min(np.sqrt(half) / lever if lever > 0.0 else 0.0, LARGEST_JOINT)
    core = HandNoise(float(sensor), float(joint))
    tail = HandNoise(wider * core.sensor_sigma, wider * core.joint_sigma)
    return _mixture(core, tail, (0.1, 0.01), len(squares), limits)


def _round(
    poses: _Poses, noise: NoiseMixture, limits: tuple[float, float]
) -> tuple[float, NoiseMixture]:
    """Return the logarithm of the likelihood, and the mixture after one round."""
    parts = core_and_tail(noise)
    inverse = poses.whole(parts)
    log = invert_along(inverse)
    w = np.einsum("ijcn,jn->icn", inverse, poses.residuals)
    squares = np.einsum("icn,in->cn", w, poses.residuals)
    likelihood, chances = _chances(poses, squares, log, noise)
    core, tail = _moved(poses, parts, w, inverse, chances)
    count, noisy = len(log[0]), float(chances.sum())
    share = (float(chances[1].sum()) + _PRIOR_TAIL) / (noisy + _PRIOR)
    false = (count - noisy + _PRIOR_FALSE) / (count + 1.0)
    return likelihood, _mixture(core, tail, (share, false), count, limits)


def _chances(
    poses: _Poses, squares: NDArray, log: NDArray, noise: NoiseMixture
) -> tuple[float, NDArray]:
    """Return the likelihood's logarithm, and each pose's chance of core and tail. Shape (2, N)."""
    r = poses.residuals
    false = -0.5 * np.sum(r * r, axis=0) / poses.spread**2 - poses.dof * np.log(poses.spread)
    false = false + np.log(noise.outlier_share)
    noisy = 1.0 - noise.outlier_share
    share = np.log([noisy * (1.0 - noise.tail_share), noisy * noise.tail_share])
    logs = np.stack([*(share[:, None] - 0.5 * log - 0.5 * squares), false])
    total = np.logaddexp.reduce(logs)
    return float(total.sum()), np.exp(logs - total)[:2]


def _moved(
    poses: _Poses, parts: tuple[HandNoise, HandNoise], w: NDArray, inverse: NDArray, chance: NDArray
) -> list[HandNoise]:
    """Return the components after one step of both variances.

    Args:
        parts: Core and tail.
        w: S^-1 r of both. Shape (K, 2, N).
        inverse: S^-1. Shape (K, K, 2, N).
        chance: Of each pose. Shape (2, N).
    """
    w = w * poses.seen[:, None]
    own = np.einsum("iicn,in->cn", inverse, poses.seen * 1.0)
    pulled = np.einsum("icn,icn->cn", np.einsum("ijn,jcn->icn", poses.levers, w), w)
    expected = np.einsum("ijcn,ijn->cn", inverse, poses.levers)
    sums = [
        np.sum(chance * each, axis=1) for each in (np.sum(w * w, axis=0), own, pulled, expected)
    ]
    return [
        HandNoise(_ratio(a, b) * part.sensor_sigma, _ratio(c, d) * part.joint_sigma)
        for part, a, b, c, d in zip(parts, *(each.tolist() for each in sums), strict=True)
    ]


def _ratio(found: float, expected: float) -> float:
    """Return the factor of a standard deviation: the fourth root of the ratio of its squares."""
    return float((found / expected) ** 0.25) if expected > 0.0 else 1.0


def _mixture(
    core: HandNoise,
    tail: HandNoise,
    shares: tuple[float, float],
    count: int,
    limits: tuple[float, float],
) -> NoiseMixture:
    """Return a mixture within its limits."""
    root = np.sqrt(_WIDER)
    sensor = float(np.clip(core.sensor_sigma, limits[0], limits[1] / root))
    joint = float(min(core.joint_sigma, LARGEST_JOINT / root))
    return NoiseMixture(
        sensor,
        joint,
        float(np.clip(tail.sensor_sigma, root * sensor, limits[1])),
        float(np.clip(tail.joint_sigma, root * joint, LARGEST_JOINT)),
        min(shares[0], LARGEST_SHARE),
        min(shares[1], LARGEST_SHARE),
        count,
    )


def _numbers(noise: NoiseMixture) -> NDArray:
    """Return what is estimated: both components, their share and that of false detections."""
    core, tail = core_and_tail(noise)
    parts = (core.sensor_sigma, core.joint_sigma, tail.sensor_sigma, tail.joint_sigma)
    return np.array([*parts, noise.tail_share, noise.outlier_share])


def _sizes(numbers: NDArray, lever: float) -> NDArray:
    """Return what counts as much of each number: of joint noise as far as a coordinate shows it."""
    size = numbers.copy()
    for part in (size[:2], size[2:4]):
        whole = float(np.hypot(part[0], lever * part[1]))
        part[:] = whole, whole / lever if lever > 0.0 else np.inf
    return size


def _close(before: NoiseMixture, after: NoiseMixture, lever: float) -> bool:
    """Return whether nothing moves any more: what shrinks counts as far as it shows.

    What grows may become large, however small it is.
    """
    a, b = _numbers(before), _numbers(after)
    size = np.where(b > a, b, _sizes(a, lever))
    return bool((np.abs(a - b) <= _TOLERANCE * size).all())

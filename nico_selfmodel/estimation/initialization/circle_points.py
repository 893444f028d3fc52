"""Circle point analysis: joint axes from sweeps, thesis section 6.2.1 in its exact form.

While one joint turns and all others hold still, a point on the hand draws a circle about that
joint's axis. The circle's plane and centre give the line, its angles against the encoder the gear.
Joints are taken from the base outwards: sweeps made at any posture of the joints before are carried
back to the zero configuration, so that several sweeps of one joint, at several homes and of several
markers, all count. Nothing needs common normals: the lines are the model.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.sweeps import Sweep
from nico_selfmodel.errors import NotIdentifiableError
from nico_selfmodel.estimation.observations.arm_estimate import ArmEstimate
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.geometry.circle import Circle
from nico_selfmodel.geometry.circle_variants import circle_with_angles, robust_circle
from nico_selfmodel.geometry.rotation import rotation_about, tangent_basis
from nico_selfmodel.model.arm.chain import Chain

LARGEST_AXIS_SIGMA = np.radians(15.0)
"""An axis known worse than this is not used: the joint counts as not analysed."""
TRUSTED_AXIS_SIGMA = np.radians(5.0)
"""Axes known better than this narrow the random starts."""
LEAST_RADIUS = 6.0
"""Radius over noise below which a circle is one of noise: a ball of noise alone makes it two."""
LEAST_SAGITTA = 2.0
"""Arc height over noise below which a plane is noise (see `Circle.sagitta`)."""
_STILL = 1e-6
"""Part of what another joint's readings move in a sweep below which its own stand still."""


@dataclass(frozen=True, eq=False)
class SweepCircle:
    """One circle drawn by one sweep."""

    joint: int
    """Index of the joint that turned."""
    rows: NDArray
    """Rows of the observations on the circle. Shape (k,)."""
    circle: Circle
    """The circle, carried back to the zero configuration; covariance for unit noise."""
    inliers: NDArray
    """Which rows are inliers. Shape (k,)."""
    slope: float
    """Joint radians per encoder radian about the circle's normal."""
    slope_weight: float
    """Information on the slope: squared radius times spread of the encoder."""


@dataclass(frozen=True, eq=False)
class CirclePointAnalysis:
    """What sweeps tell about an arm."""

    arm: ArmEstimate | None
    """The arm; None where some joint could not be analysed."""
    circles: tuple[SweepCircle, ...]
    """All fitted circles."""
    axis_sigma: NDArray
    """Standard deviation of each axis' direction [rad]; inf without a usable circle, nan where no
    redundant point tells the noise. Shape (n,)."""
    noise: float
    """Root mean square distance of the points to their circles, a coordinate [m]."""
    reasons: tuple[str, ...]
    """Why joints could not be analysed."""
    directions: NDArray
    """Axis directions found; nan where not. Shape (n, 3)."""
    gear: NDArray
    """Gears found; nan where not. Shape (n,)."""

    @property
    def trusted(self) -> NDArray:
        """Which joints are known well enough to start others from them. Shape (n,)."""
        return self.axis_sigma < TRUSTED_AXIS_SIGMA


def analyse_circle_points(
    observations: Observations,
    sweeps: list[Sweep],
    gear_known: NDArray,
    rng: np.random.Generator,
    zero: NDArray | None = None,
) -> CirclePointAnalysis:
    """Infer axes, gears and hand points from sweeps.

    Args:
        sweeps: Sweeps; their rows index `observations`.
        gear_known: Joints whose gear is 1: their angles help to fit short arcs. Shape (n,).
        rng: Source of the random triples that protect against outliers.
        zero: Encoder angles of the zero configuration [rad]; by default where most sweeps cross.

    Returns:
        The analysis. Its `arm` is None, with `reasons`, where a joint has no usable circle:
        the tracked point too near its axis, an arc too short for the noise, no sweep at all.
    """
    n = len(observations.joints)
    zero = crossing_of(observations.angles, sweeps) if zero is None else zero
    directions, points = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    gear, axis_sigma = np.full(n, np.nan), np.full(n, np.inf)
    circles: list[SweepCircle] = []
    reasons: list[str] = []
    carried = observations.p_WH
    for i in range(n):
        fits = _fit_sweeps(observations, carried, i, sweeps, bool(gear_known[i]), rng)
        circles += fits
        reason = _reason_against(fits, observations.joints[i])
        if reason is None:
            directions[i], points[i], axis_sigma[i] = _combine(fits)
            gear[i] = 1.0 if gear_known[i] else _gear_of(fits, directions[i])
            if axis_sigma[i] > LARGEST_AXIS_SIGMA:
                reason = f"the axis of {observations.joints[i]} is uncertain by "
                reason += f"{np.degrees(axis_sigma[i]):.0f} deg: sweep it further, with the point "
                reason += "further from its axis"
        if reason is not None:
            reasons.append(reason)
            break
        q = (observations.angles[:, i] - zero[i]) / gear[i]
        carried = _turn(carried, points[i], directions[i], -q)
    noise = _noise_of(circles)
    if reasons:
        return CirclePointAnalysis(
            None, tuple(circles), axis_sigma, noise, tuple(reasons), directions, gear
        )
    hands = _hand_points(observations, carried, sweeps)
    if np.isnan(hands).any():
        hands = _hand_points(observations, carried, [Sweep(0, np.arange(len(observations)))])
    chain = Chain(observations.joints, directions, points, observations.markers, hands)
    arm = ArmEstimate(chain, gear, zero)
    return CirclePointAnalysis(arm, tuple(circles), axis_sigma, noise, (), directions, gear)


def require_arm(analysis: CirclePointAnalysis) -> ArmEstimate:
    """Return the arm of an analysis.

    Raises:
        NotIdentifiableError: If a joint could not be analysed; the message says why.
    """
    if analysis.arm is None:
        raise NotIdentifiableError("; ".join(analysis.reasons), partial=analysis)
    return analysis.arm


def crossing_of(angles: NDArray, sweeps: list[Sweep]) -> NDArray:
    """Return the encoder angles of the pose nearest to all sweeps, the shared home. Shape (n,)."""
    rows = np.unique(np.concatenate([s.rows for s in sweeps])) if sweeps else np.arange(len(angles))
    middle = np.median(angles[rows], axis=0)
    spread = np.ptp(angles, axis=0)
    distance = np.abs(angles[rows] - middle) / np.where(spread > 0.0, spread, 1.0)
    return angles[rows[np.argmin(np.sum(distance, axis=1))]]


def _fit_sweeps(
    observations: Observations,
    carried: NDArray,
    joint: int,
    sweeps: list[Sweep],
    gear_known: bool,
    rng: np.random.Generator,
) -> list[SweepCircle]:
    """Fit a circle to each sweep of a joint; those without three points or readings are skipped."""
    fits = []
    for sweep in sweeps:
        if sweep.joint != joint or len(sweep.rows) < 3:
            continue
        rows = sweep.rows
        angles, points = observations.angles[rows, joint], carried[rows]
        if np.ptp(angles) <= _STILL * np.ptp(observations.angles[rows], axis=0).max():
            continue  # the readings of another joint move: columns or labels are exchanged
        try:
            circle, inliers = robust_circle(points, rng, sigma=1.0)
            if gear_known:
                circle = circle_with_angles(points[inliers], angles[inliers], sigma=1.0)
        except ValueError:
            continue
        if np.ptp(angles[inliers]) == 0.0:
            continue  # only outliers were read elsewhere: nothing tells how far the joint turned
        slope, weight = _slope(circle, points[inliers], angles[inliers])
        fits.append(SweepCircle(joint, rows, circle, inliers, slope, weight))
    return fits


def _slope(circle: Circle, points: NDArray, angles: NDArray) -> tuple[float, float]:
    """Regress the circle's angle on the encoder, unwrapped in the encoder's order (eq. 6.8)."""
    order = np.argsort(angles, kind="stable")
    phi = np.unwrap(circle.angles_of(points[order]))
    centred = angles[order] - angles.mean()
    spread = float(centred @ centred)
    return float(centred @ phi) / spread, circle.radius**2 * spread


def _reason_against(fits: list[SweepCircle], joint: str) -> str | None:
    """Say why the circles of a joint cannot be used, or None if one can."""
    if not fits:
        return (
            f"{joint} has no sweep with three different points and readings: sweep it, give a "
            "robot, or see whether columns are exchanged"
        )
    noise = _noise_of(fits)
    widest = max(fit.circle.radius for fit in fits)
    if widest < LEAST_RADIUS * noise:
        return (
            f"the circle of {joint} is degenerate: the tracked point is {widest * 1e3:.2f} mm from "
            f"its axis in a noise of {noise * 1e3:.2f} mm: track a point further from its axis"
        )
    best = max(fits, key=lambda fit: fit.circle.sagitta)
    if best.circle.sagitta < LEAST_SAGITTA * noise:
        return (
            f"the circle of {joint} is degenerate: its arc is {best.circle.sagitta * 1e3:.2f} mm "
            f"high in a noise of {noise * 1e3:.2f} mm (radius {best.circle.radius * 1e3:.0f} mm, "
            f"arc {np.degrees(best.circle.arc):.0f} deg): sweep it further, or track a point "
            "further from its axis"
        )
    return None


def _noise_of(fits: list[SweepCircle]) -> float:
    """Pool the residuals of circles, with their redundancy [m]."""
    squared = sum(fit.circle.rms**2 * fit.inliers.sum() for fit in fits)
    redundancy = sum(max(2 * int(fit.inliers.sum()) - 6, 0) for fit in fits)
    return float(np.sqrt(squared / redundancy)) if redundancy else 0.0


def _combine(fits: list[SweepCircle]) -> tuple[NDArray, NDArray, float]:
    """Combine circles about one axis into a line, weighted by their covariances.

    Unknowns: tilt t and shift s of the best circle's axis, each along its u and v. A circle at
    height h above measures t, and s + h t.
    """
    best = max(fits, key=lambda fit: fit.slope_weight)
    d0 = best.circle.normal * (np.sign(best.slope) or 1.0)
    c0 = best.circle.center
    basis = tangent_basis(d0)
    information, right = np.zeros((4, 4)), np.zeros(4)
    for fit in fits:
        circle = fit.circle
        d = circle.normal * (np.sign(fit.slope) or 1.0)
        if d @ d0 < 0.5 or circle.covariance is None:
            continue
        height = (circle.center - c0) @ d0
        measured = np.concatenate([basis.T @ (d / (d @ d0)), basis.T @ (circle.center - c0)])
        design = np.block([[np.eye(2), np.zeros((2, 2))], [height * np.eye(2), np.eye(2)]])
        to_basis = np.zeros((4, 6))
        own = np.column_stack([tangent_basis(circle.normal), circle.normal])
        to_basis[:2, 3:5] = basis.T @ own[:, :2]
        to_basis[2:, :3] = basis.T @ own
        weight = np.linalg.pinv(to_basis @ circle.covariance @ to_basis.T, hermitian=True)
        information += design.T @ weight @ design
        right += design.T @ weight @ measured
    covariance = np.linalg.inv(information)
    t1, t2, s1, s2 = covariance @ right
    direction = d0 + basis @ np.array([t1, t2])
    noise = _noise_of(fits) if any(len(fit.rows) > 3 for fit in fits) else np.nan
    sigma = noise * np.sqrt(np.linalg.eigvalsh(covariance[:2, :2])[-1])
    point = c0 + basis @ np.array([s1, s2])
    return direction / np.linalg.norm(direction), point, float(sigma)


def _gear_of(fits: list[SweepCircle], direction: NDArray) -> float:
    """Average the slopes about the common direction; the gear is the encoder's share (G > 0)."""
    slopes = np.array([fit.slope * np.sign(fit.circle.normal @ direction) for fit in fits])
    weights = np.array([fit.slope_weight for fit in fits])
    return float(weights.sum() / (weights @ slopes))


def _turn(points: NDArray, c: NDArray, d: NDArray, angle: NDArray) -> NDArray:
    """Turn points about the line (c, d), each by its own angle. (N, 3) -> (N, 3)."""
    return c + np.einsum("nij,nj->ni", rotation_about(d, angle), points - c)


def _hand_points(observations: Observations, carried: NDArray, sweeps: list[Sweep]) -> NDArray:
    """Average the sweeps' points, carried back through the whole arm, without outliers. (m, 3)."""
    rows = np.unique(np.concatenate([sweep.rows for sweep in sweeps]))
    hands = np.full((len(observations.markers), 3), np.nan)
    for k in range(len(hands)):
        points = carried[rows[observations.marker[rows] == k]]
        if len(points):
            distance = np.linalg.norm(points - np.median(points, axis=0), axis=1)
            near = distance <= 3.0 * np.median(distance) + 1e-12
            hands[k] = points[near].mean(axis=0)
    return hands

"""Arm poses to learn a mirror by: both cameras see the reflection, the hand keeps off the glass."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.errors import EstimationError
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.line_kinematics import hand_points
from nico_selfmodel.model.cameras.mirror import Mirror, plane_of_values
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig, reflected_projection
from nico_selfmodel.model.self_model import SelfModel

_STOPS_ON_THE_WAY = 25
"""Points of a straight way between two poses at which it must be clear."""
_CERTAIN = 3.0
"""Standard deviations of the plane that are kept beside the clearance."""


@dataclass(frozen=True, eq=False)
class MirrorPoses:
    """Poses to visit, in this order."""

    encoders: NDArray
    """Readings to command. Shape (K, n)."""
    pixels: NDArray
    """Where both cameras should see the reflection [px]. Shape (K, 4)."""
    clearance: NDArray
    """How far the nearest point of the arm keeps from the glass, at the pose and on the way to it
    in a straight line of joint angles from the one before [m]. Shape (K,)."""
    sigma: NDArray
    """What the first k poses would tell of tilt_x, tilt_y [rad] and distance [m]. Shape (K, 3)."""


def plan_mirror_poses(
    model: SelfModel,
    mirror: Mirror,
    limits: tuple[ArrayLike, ArrayLike],
    count: int,
    rng: np.random.Generator,
    *,
    marker: str | None = None,
    clearance: float = 0.05,
    margin: float = 20.0,
    pool: int = 2000,
    candidates: ArrayLike | None = None,
) -> MirrorPoses:
    """Choose poses that tell most of where a mirror stands, without touching it.

    Of random poses those are kept that qualify; each next one is that which, seen, would shrink the
    plane's covariance most (greedy D-optimal), among those with a clear way from the last. Joint
    axes and tracked points are kept clear; the clearance must cover what sticks out of the arm.

    Args:
        mirror: Where the mirror stands, at least roughly; its covariance widens the clearance.
        limits: Lowest and highest readings of the joints. Shape (n,) each.
        marker: The tracked point; the first if omitted.
        clearance: How far every point of the arm keeps from the glass [m].
        margin: How far pixels keep from the images' edges [px].
        pool: Random poses to choose from.
        candidates: Readings to choose from instead, as where a marker faces the glass. (P, n).

    Raises:
        EstimationError: If too few poses qualify; says what they fail.
        ModelError: If the model has no arm or no cameras.
        ValueError: If limits are missing or crossed, or there is no such marker.
    """
    low, high = (np.asarray(limit, dtype=float) for limit in limits)
    if not (np.isfinite(low) & np.isfinite(high) & (low < high)).all() or count < 1:
        raise ValueError("limits must be finite, lower < upper, and count at least one")
    rig = MirrorRig(model.rig, mirror)
    index = 0 if marker is None else model.chain.marker_index(marker)
    if candidates is None:
        readings = rng.uniform(low, high, (pool, len(model.joints)))
    else:
        readings = np.clip(np.asarray(candidates, dtype=float), low, high)
    q = model.servos.to_joint(readings)
    p_WH = model.points(q, index)
    pixels = rig.project(p_WH)
    visible = rig.rig.inside(pixels, margin)
    clear = free_space(model.chain, rig, q) >= clearance
    fit = np.flatnonzero(visible & clear)
    if not fit.size:
        raise EstimationError(_why_none(visible, clear, clearance))
    information = _information(model, rig, p_WH[fit])
    chosen, ways, sigma = _choose(model.chain, rig, q[fit], information, count, clearance)
    if len(chosen) < count:
        raise EstimationError(
            f"only {len(chosen)} of {count} poses can be reached one from the other with "
            f"{1e3 * clearance:.0f} mm to the glass: move the mirror away, or ask for fewer",
            partial=MirrorPoses(readings[fit][chosen], pixels[fit][chosen], ways, sigma),
        )
    return MirrorPoses(readings[fit][chosen], pixels[fit][chosen], ways, sigma)


def free_space(chain: Chain, rig: MirrorRig, q: NDArray) -> NDArray:
    """Return how far the arm keeps from the glass.

    Of each joint the point of its axis next to the first tracked point counts, and every tracked
    point: straight links between points in front of a plane are in front of it. What is not known
    of the plane counts against the arm.

    Args:
        q: Joint displacements [rad]. Shape (N, n).

    Returns:
        Signed distance of the nearest point, less three sigmas of the plane there [m]. Shape (N,).
    """
    along = np.sum(chain.directions * (chain.p_WH_zero[0] - chain.points), axis=1)
    feet = chain.points + along[:, None] * chain.directions
    points = [chain.forward(q, k) for k in range(len(chain.markers))]
    for i, foot in enumerate(feet):
        start = np.repeat(foot[:, None], len(q), axis=1)
        points.append(hand_points(chain.directions[:i], chain.points[:i], start, q.T[:i]).T)
    p_LQ = apply(rig.rig.left.X_CW, np.array(points))
    room = rig.mirror.in_front_by(p_LQ)
    if rig.mirror.covariance is not None:
        by_values = plane_of_values(rig.mirror.values)[1]
        slopes = p_LQ @ by_values[:3] + by_values[3]
        variance = np.einsum("...i,ij,...j->...", slopes, rig.mirror.covariance, slopes)
        room = room - _CERTAIN * np.sqrt(variance)
    return room.min(axis=0)


def _choose(
    chain: Chain, rig: MirrorRig, q: NDArray, information: NDArray, count: int, clearance: float
) -> tuple[list[int], NDArray, NDArray]:
    """Pick poses one after the other; return them, the room on the way, and sigmas."""
    chosen: list[int] = []
    ways, sigmas = [], []
    # The first pose alone is nearly enough; this only keeps the determinant from being zero.
    known = 1e-9 * np.diag(np.diag(information.mean(axis=0)))
    open_to = np.ones(len(q), dtype=bool)
    room = free_space(chain, rig, q)
    while len(chosen) < count and open_to.any():
        gain = np.where(open_to, np.linalg.slogdet(known + information)[1], -np.inf)
        for k in np.argsort(-gain)[: int(open_to.sum())]:
            way = room[k] if not chosen else _room_on_the_way(chain, rig, q[chosen[-1]], q[k])
            if way >= clearance:
                break
        else:
            break
        chosen.append(int(k))
        open_to[k] = False
        known = known + information[k]
        ways.append(float(way))
        sigmas.append(np.sqrt(np.diag(np.linalg.inv(known))))
    return chosen, np.array(ways), np.reshape(sigmas, (-1, 3))


def _room_on_the_way(chain: Chain, rig: MirrorRig, start: NDArray, end: NDArray) -> float:
    share = np.linspace(0.0, 1.0, _STOPS_ON_THE_WAY)[:, None]
    return float(free_space(chain, rig, start + share * (end - start)).min())


def _information(model: SelfModel, rig: MirrorRig, p_WH: NDArray) -> NDArray:
    """Return what each pose would tell of the plane, J' S^-1 J. Shape (N, 3, 3)."""
    shown = reflected_projection(rig.rig.cameras, rig.mirror.values, p_WH)
    hand = (model.noise_sigma or 0.0) ** 2
    covariance = (model.pixel_sigma or 1.0) ** 2 * np.eye(4)
    covariance = covariance + hand * shown.by_point @ np.swapaxes(shown.by_point, 1, 2)
    return np.swapaxes(shown.by_mirror, 1, 2) @ np.linalg.solve(covariance, shown.by_mirror)


def _why_none(visible: NDArray, clear: NDArray, clearance: float) -> str:
    """Say which condition no pose meets."""
    if not clear.any():
        return (
            f"no pose keeps {1e3 * clearance:.0f} mm from the glass: move the mirror away, or ask "
            "for less"
        )
    if not visible.any():
        return (
            "no pose shows the hand's reflection to both cameras: turn the mirror towards the "
            "cameras, or move it nearer"
        )
    return "no pose both shows the hand's reflection to both cameras and keeps off the glass"

"""What disturbs a recording, by what an adjustment leaves of it."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.pose_groups import PoseGroups
from nico_selfmodel.estimation.noise.variance_components import (
    LEAST_OF_ALL,
    LinearResiduals,
    VarianceSearch,
)
from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise
from nico_selfmodel.model.tree.body_tree import WHOLE_POSES
from nico_selfmodel.optimization.losses import Loss, robust_scale

_FAR = 8.0
"""Robust standard deviations of three coordinates beyond which nothing counts at first."""
_LEAST_SHARE = 0.02
"""Part of the residuals below which a standard deviation counts as none."""


def robust_weights(data: TreeObservations, r: NDArray) -> tuple[NDArray, float]:
    """Return Cauchy's weights, by the median of each sensor, and a cost by which starts compare.

    Args:
        data: What was measured.
        r: What a start leaves, in the sensors' standard deviations. Shape (R,).

    Returns:
        Of each scalar, shape (R,), and the sum of k log(scale) and rho.
    """
    squared = data.per_row(r * r)
    weight, cost = np.ones(len(squared)), 0.0
    for rows in data.sensors:
        k = rows.measured.shape[1]
        own = squared[rows.rows]
        held = bool(data.sigma_held[data.noise_group[rows.first]])
        scale = 1.0 if held else robust_scale(np.sqrt(own), k)
        rho, w = Loss("cauchy", max(scale, 1e-9)).rho_and_weight(own, k)
        weight[rows.rows] = w / scale**2
        cost += float(rho.sum()) / scale**2 + 2.0 * k * len(own) * np.log(scale)
    return weight[data.row], cost


def standing_out(data: TreeObservations, r: NDArray) -> NDArray:
    """Return observations that are far out at a start, by the median of their sensor.

    Args:
        data: What was measured.
        r: What the start leaves, in the sensors' standard deviations. Shape (R,).

    Returns:
        Boolean, by row of the table. Shape (N,).
    """
    norms = np.sqrt(data.per_row(r * r))
    out = np.zeros(len(norms), dtype=bool)
    for rows in data.sensors:
        k, own = rows.measured.shape[1], norms[rows.rows]
        if not data.sigma_held[data.noise_group[rows.first]]:
            out[rows.rows] = own > _FAR * np.sqrt(k / 3.0) * robust_scale(own, k)
    return out


def likeliest_noise(
    data: TreeObservations,
    linear: TreeLinear,
    groups: PoseGroups,
    slipped: NDArray | None,
    start: TreeNoise,
    information: NDArray,
) -> TreeNoise:
    """Return the noise that residuals ask for, with what fitting took from them.

    Args:
        data: What was measured.
        linear: Residuals about what is known beforehand, and their derivatives by what is
            estimated.
        groups: What belongs to one pose.
        slipped: Joints that were read wrongly in a pose, if any. Boolean, (poses, m).
        start: Where the search begins.
        information: Inverse variances of what is known beforehand. Shape (P,).
    """
    residuals = LinearResiduals(
        groups,
        groups.gather(linear.r[:, None]),
        groups.gather(linear.J.T[:, None]),
        linear.by_joint[:, None],
        data.noise_group[:, None],
        slipped,
        information,
        linear.taken,
    )
    group, counts = _joint_groups(data)
    kept = groups.rows
    left = _rms_by_group(residuals.left(start.sensor, start.joint)[:, 0], data, kept)
    rms = np.maximum(left, LEAST_OF_ALL / _LEAST_SHARE * _rms_by_group(linear.r, data, kept))
    by_joint = linear.by_joint[kept][:, ~data.unread] / rms[data.noise_group[kept], None]
    lever = float(np.sqrt(np.mean(by_joint**2))) if by_joint.size else 1.0
    floor = np.append(_LEAST_SHARE * rms, np.full(counts, _LEAST_SHARE / max(lever, 1e-12)))
    known = np.zeros(len(group))
    search = VarianceSearch(residuals, known, group, np.maximum(floor, 1e-12), data.sigma_held)
    found = search.run(start.sensor, start.joint)
    return TreeNoise(found.sensor, found.joint)


def _rms_by_group(r: NDArray, data: TreeObservations, kept: NDArray) -> NDArray:
    """Return the root mean square of the scalars that count of each noise group. Shape (G,)."""
    group = data.noise_group[kept]
    squares = np.bincount(group, r[kept] ** 2, minlength=len(data.noise_groups))
    return np.sqrt(squares / np.bincount(group, minlength=len(squares)))


def _joint_groups(observations: TreeObservations) -> tuple[NDArray, int]:
    """Return which noisy parts share a sigma: joints alike, a flange's turns and shifts."""
    names = []
    for i, part in observations.noisy_joints:
        joint = observations.data.joints[i]
        own = f"{joint.name} {part // 3}" if joint.motion in WHOLE_POSES else joint.motion
        names.append(own)
    _, first, group = np.unique(names, return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))
    return order[group], len(first)

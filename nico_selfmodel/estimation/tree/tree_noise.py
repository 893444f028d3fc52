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

_LEAST_SHARE = 0.02
"""Part of the residuals below which a standard deviation counts as none."""


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

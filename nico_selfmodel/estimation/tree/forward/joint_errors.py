"""Where a pose shows that its joints are, beside their readings.

What joint errors e of standard deviations D do to what is seen is linear only near e. Of residuals
r(x, e), linear about some e0 with A = dr/de, the expected errors are those at which

    |r(x, e0) + A (e - e0)|^2 / s^2 + |D^-1 e|^2

is least: -D B' S^-1 (r(x, e0) - A e0) with B = A D / s, S = 1 + B B' (see `noise.pose_noise`). Then
r(x, e) - A e, of covariance s^2 S, stands for the pose at its readings, and x is found there as if
e had been estimated beside it (Lindstrom, Bates 1990). About e0 = 0, what joint noise of 0.35 deg
leaves of second order is as large as the noise of a good corner, 0.08 px: axes were five of their
sigmas off.
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.pose_noise import FREE_SIGMA, PoseWhitening
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.model.tree.body_tree import WHOLE_POSES, BodyTree

_LARGEST = 0.02
"""Standard deviation to which a pose must tell a joint [rad or m]: where little tells of one that
is read wrongly, where it is put is no better a place to be linear about than the reading."""
MOST_SLIPS = 0.35
"""Share of the visits in which a joint is read wrongly from which on it does not slip: what it is
read to says nothing, and whatever it is put to would fit."""


def joint_errors(
    observations: TreeObservations, whitening: PoseWhitening, r: NDArray, loose: NDArray | None
) -> NDArray:
    """Return how far each sample's joints are expected to be from their readings.

    Args:
        r: Residuals at readings that do not err, in their sensors' sigmas. Shape (R,).
        loose: What says nothing in a visit, if any. Boolean, shape (visits, m).

    Returns:
        Of `TreeObservations.noisy_joints` [rad or m]; nothing where nothing was seen, and of whole
        poses, which stay as they are read or fit best. Shape (samples, m).
    """
    shown = shown_errors(observations, whitening, r, loose)
    if loose is not None and len(loose):
        shown[:, loose.mean(axis=0) > MOST_SLIPS] = 0.0
    return shown


def shown_errors(
    observations: TreeObservations, whitening: PoseWhitening, r: NDArray, loose: NDArray | None
) -> NDArray:
    """Return the same of joints, too, whose readings say nothing in most visits."""
    numbers, known = whitening.groups.numbers, whitening.noise.joint_sigma
    sigma = np.tile(known, (len(numbers) + 1, 1))
    if loose is not None:
        sigma[:-1] = np.where(loose, FREE_SIGMA, known)
    mean, spread = whitening.joint_errors(-r[:, None])
    left = sigma * np.sqrt(np.maximum(np.einsum("vmm->vm", spread), 0.0))
    by_visit = np.where(left > _LARGEST, 0.0, mean * sigma)
    joints = observations.data.joints
    whole = [joints[i].motion in WHOLE_POSES for i, _ in observations.noisy_joints]
    by_visit[:, whole] = 0.0
    visit = observations.data.visit
    at = np.minimum(np.searchsorted(numbers, visit), len(numbers) - 1)
    return np.asarray(by_visit[np.where(numbers[at] == visit, at, len(numbers))])


def erring_readings(
    observations: TreeObservations, tree: BodyTree, errors: NDArray | None
) -> NDArray:
    """Return readings, off by the joints' errors: q = reading / gear + e. Shape (P, n).

    Args:
        errors: By `TreeObservations.noisy_joints` [rad or m]; none if None. Shape (P, m).
    """
    readings = observations.data.si_readings
    if errors is None:
        return readings
    off = np.zeros_like(readings)
    for m, (i, _) in enumerate(observations.noisy_joints):
        if tree.motions[i] not in WHOLE_POSES:
            off[:, i] = tree.gear[i] * errors[:, m]
    return readings + off

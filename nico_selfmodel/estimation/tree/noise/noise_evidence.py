"""What tells the noise of a recording: what an adjustment left, and what fitting took from it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.alike_errors import AlikeErrors, turn_groups
from nico_selfmodel.estimation.noise.pose_groups import PoseGroups
from nico_selfmodel.estimation.noise.pose_noise import PoseNoise, PoseWhitening
from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.tree_observations import (
    TreeObservations,
)
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise
from nico_selfmodel.optimization.uncertainty import covariance_told_by


@dataclass(frozen=True, eq=False)
class NoiseEvidence:
    """What an adjustment left, and what fitting took from it: what tells the noise."""

    data: TreeObservations
    """What was measured."""
    linear: TreeLinear
    """Residuals about what is known beforehand, and their derivatives by what is estimated."""
    groups: PoseGroups
    """What belongs to one pose."""
    slipped: NDArray | None
    """Joints that were read wrongly in a pose, if any. Boolean, shape (poses, m)."""
    information: NDArray
    """Inverse variances of what is known beforehand. Shape (P,)."""

    def whitening(self, noise: TreeNoise) -> PoseWhitening:
        """Return what whitens poses that are disturbed by some noise."""
        return tree_whitening(self.data, self.linear, self.groups, noise, self.slipped)

    def beside(self, alike: Sequence[AlikeErrors]) -> "NoiseEvidence":
        """Return it with errors that poses share as parameters, see `beside_shared`."""
        linear, known = beside_shared(self.data, self.linear, self.information, alike)
        return replace(self, linear=linear, information=known)


def tree_whitening(
    data: TreeObservations,
    linear: TreeLinear,
    groups: PoseGroups,
    noise: TreeNoise,
    slipped: NDArray | None = None,
    *,
    joined: bool = False,
) -> PoseWhitening:
    """Return what whitens poses, of rows in their sensors' standard deviations.

    Where it is joined these are those of `TreeNoise.own`.

    Args:
        linear: Derivatives by the joints' errors.
        slipped: Joints that were read wrongly in a pose, if any. Boolean, (poses, m).
        joined: Whiten also what poses share with each other; else all of it counts as their own.
    """
    at = noise.own if joined else noise
    scale = at.sensor[data.noise_group][:, None]
    loose, own = data.unread_in(groups.poses, slipped), PoseNoise(1.0, at.joint)
    whitening = PoseWhitening(groups, (linear.by_joint / scale)[:, None], own, loose)
    if not joined or not noise.alike:
        return whitening
    columns = np.hstack([_columns(data, linear, one) for one in noise.alike])
    return whitening.sharing((columns / scale)[:, None])


def beside_shared(
    data: TreeObservations, linear: TreeLinear, information: NDArray, alike: Sequence[AlikeErrors]
) -> tuple[TreeLinear, NDArray]:
    """Return what is linear, and what is known of it beforehand, with shared errors as parameters.

    Args:
        linear: Residuals, and their derivatives by what is estimated.
        information: Inverse variances of what is known beforehand. Shape (P,).
        alike: Errors that poses share; as parameters N(0, 1) they follow the others.
    """
    for one in alike:
        columns = _columns(data, linear, one)
        linear = replace(linear, J=np.vstack([linear.J, columns.T]))
        information = np.append(information, np.ones(columns.shape[1]))
    return linear, information


def _columns(data: TreeObservations, linear: TreeLinear, alike: AlikeErrors) -> NDArray:
    """Return what shared errors of N(0, 1) do to residuals. Shape (R, q)."""
    if alike.turns is None:
        return alike.columns(linear.by_joint, data.data.observations.pose[data.row])
    turns = np.flatnonzero(of_turns(data, alike.turns)).reshape(-1, 3)
    by_part, row = np.zeros((len(linear.r), 3)), np.zeros(len(linear.r), dtype=int)
    by_part[turns] = np.eye(3)
    row[turns] = np.arange(len(turns))[:, None]
    return alike.columns(by_part, row)


def of_turns(data: TreeObservations, group: int) -> NDArray:
    """Return which scalars are turns of a noise group. Boolean, shape (R,)."""
    return np.isin(data.noise_group, turn_groups(group))


def asked_for(evidence: NoiseEvidence, noise: TreeNoise) -> tuple[NDArray, NDArray]:
    """Return what residuals ask of parameters N(0, 1), and the variances of that. Shapes (P,)."""
    linear = evidence.linear
    both = np.vstack([linear.r, linear.J]) / noise.sensor[evidence.data.noise_group]
    white = evidence.whitening(noise).white(both.T[:, None])
    C = covariance_told_by(white[:, 1:].T @ white[:, 1:] + np.diag(evidence.information))
    return -C @ (white[:, 1:].T @ white[:, 0]), np.diag(C)

"""Errors that poses share with poses that are alike, where that is decisively likelier."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.sensors import POSES
from nico_selfmodel.estimation.noise.alike_errors import AlikeErrors, alike_basis, turn_groups
from nico_selfmodel.estimation.noise.pose_groups import PoseGroups
from nico_selfmodel.estimation.tree.noise.likeliest_noise import DECISIVE, likeliest_variances
from nico_selfmodel.estimation.tree.noise.noise_evidence import NoiseEvidence, asked_for, of_turns
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_tree import FLANGE

_FEWEST_ALIKE = 12
"""Poses of a flange below which nobody asks whether errors are alike in poses alike."""
_SIZES = (0.7, 1.4)
"""What `alike` may mean, in root mean squares of how far poses are apart."""
_ALIKE_ROUNDS = 3
_FIRST_SHARED, _FIRST_ALONE = 0.9, 0.3
"""Parts of the standard deviation without sharing at which the search begins."""


def likeliest_alike(evidence: NoiseEvidence, start: TreeNoise) -> TreeNoise | None:
    """Return the noise in which errors are shared by poses that are alike.

    Asked are the errors of a flange, and the turns that each sensor of poses measures.

    Args:
        start: The noise without.

    Returns:
        None where each pose's error is its own.
    """
    best: TreeNoise | None = None
    known = replace(start, alike=())
    for X, first in _asked(evidence.data, evidence.groups, known):
        found = _shared(evidence, known, X, first)
        if found is not None:
            best = known = found
    return best


def _asked(
    data: TreeObservations, groups: PoseGroups, start: TreeNoise
) -> Iterator[tuple[NDArray, AlikeErrors]]:
    """Yield poses, shape (N, 4, 4), and where the search for what they share begins."""
    flanges = np.array([data.data.joints[i].motion == FLANGE for i, _ in data.noisy_joints])
    joints = {data.noisy_joints[k][0] for k in np.flatnonzero(flanges).tolist()}
    nothing = np.zeros((0, 0))
    if len(joints) == 1 and groups.poses >= _FEWEST_ALIKE:
        sigma = np.where(flanges, _FIRST_SHARED * start.joint, 0.0)
        yield data.data.X_flange[:, joints.pop()], AlikeErrors(nothing, sigma, start.joint)
    for rows in data.sensors:
        group = int(data.noise_group[rows.scalars.stop - 3]) if rows.kind == POSES else 0
        alone = of_turns(data, group).sum() == 3 * len(rows.rows)
        enough = len(np.unique(rows.pose)) >= _FEWEST_ALIKE
        if rows.kind == POSES and alone and enough and not rows.apart:
            measured = rows.measured
            X = transform(rotation_from_vector(measured[:, 3:]), measured[:, :3])
            sigma = start.sensor[turn_groups(group)]
            yield X, AlikeErrors(nothing, _FIRST_SHARED * sigma, sigma, group)


def _shared(
    evidence: NoiseEvidence, start: TreeNoise, X: NDArray, first: AlikeErrors
) -> TreeNoise | None:
    """Return the noise in which poses X share errors besides; None where that is not likelier."""
    evidence, known = evidence.beside(start.alike), start.own
    best, most = None, likeliest_variances(evidence, known).likelihood + DECISIVE
    for size in _SIZES:
        alike, noise = replace(first, basis=alike_basis(X, size)), _first_own(known, first)
        for _ in range(_ALIKE_ROUNDS):
            wider = evidence.beside((alike,))
            found = likeliest_variances(wider, noise)
            noise = TreeNoise(found.sensor, found.joint, loud=known.loud)
            if found.likelihood > most:
                best, most = noise.sharing((*start.alike, alike)), found.likelihood
            told = asked_for(wider, noise)
            alike = replace(alike, sigma=_as_told(alike, told, evidence.data.noisy_joints))
    return best


def _first_own(noise: TreeNoise, alike: AlikeErrors) -> TreeNoise:
    """Return where the search for what is each pose's own begins."""
    sensor, joint = noise.sensor.copy(), noise.joint.copy()
    if alike.turns is None:
        joint[alike.sigma > 0.0] *= _FIRST_ALONE
    else:
        sensor[turn_groups(alike.turns)[1:]] *= _FIRST_ALONE
    return TreeNoise(sensor, joint, loud=noise.loud)


def _as_told(
    alike: AlikeErrors, told: tuple[NDArray, NDArray], noisy: Sequence[tuple[int, int]]
) -> NDArray:
    """Return standard deviations as w asks for them, those of turns and of places alike. (m,)."""
    own = np.flatnonzero(alike.sigma > 0.0)
    mean, variance = (one[-len(own) * alike.basis.shape[1] :].reshape(len(own), -1) for one in told)
    out = alike.sigma.copy()
    of_turns = alike.turns is not None
    turns = np.array([of_turns or noisy[k][1] < 3 for k in own.tolist()])
    for group in (turns, ~turns):
        if not group.any():
            continue
        # v <- |w|^2 / (n - tr C), in units of v (MacKay 1992).
        size = np.sum(mean[group] ** 2) / max(float(np.sum(1.0 - variance[group])), 1e-6)
        out[own[group]] *= float(np.sqrt(max(size, 1e-6)))
    return out

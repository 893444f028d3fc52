"""What disturbs a recording, by what an adjustment leaves of it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.sensors import POSES, TOUCHES
from nico_selfmodel.estimation.noise.alike_errors import AlikeErrors, alike_basis
from nico_selfmodel.estimation.noise.pose_groups import PoseGroups
from nico_selfmodel.estimation.noise.pose_noise import PoseNoise, PoseWhitening
from nico_selfmodel.estimation.noise.variance_components import (
    LEAST_OF_ALL,
    LinearResiduals,
    Variances,
    VarianceSearch,
)
from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.tree_observations import SensorRows, TreeObservations
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_tree import FLANGE, FREE
from nico_selfmodel.optimization.losses import Loss, robust_scale
from nico_selfmodel.optimization.uncertainty import covariance_told_by

_FAR = 8.0
"""Robust standard deviations of three coordinates beyond which nothing counts at first."""
_FEWEST_ALIKE = 12
"""Poses of a flange below which nobody asks whether errors are alike in poses alike."""
DECISIVE = 8.0
"""Gain of a log likelihood from which on they are: two standard deviations more, and a size."""
_SIZES = (0.7, 1.4)
"""What `alike` may mean, in root mean squares of how far poses are apart."""
_ALIKE_ROUNDS = 3
_FIRST_SHARED, _FIRST_ALONE = 0.9, 0.3
"""Parts of the standard deviation without sharing at which the search begins."""
_LEAST_SHARE = 0.02
"""Part of the residuals below which a standard deviation counts as none."""


def robust_weights(data: TreeObservations, r: NDArray) -> tuple[NDArray, float]:
    """Return Cauchy's weights, by the median of each sensor, and a cost by which starts compare.

    Args:
        r: What a start leaves, in the sensors' standard deviations. Shape (R,).

    Returns:
        Of each scalar, shape (R,), and the sum of k log(scale) and rho.
    """
    squared = data.per_row(r * r)
    weight, cost = np.ones(len(squared)), 0.0
    for rows in data.sensors:
        k = rows.measured.shape[1]
        own = squared[rows.rows]
        scale = _scale_at_first(data, rows, np.sqrt(own))
        rho, w = Loss("cauchy", max(scale, 1e-9)).rho_and_weight(own, k)
        weight[rows.rows] = w / scale**2
        cost += float(rho.sum()) / scale**2 + 2.0 * k * len(own) * np.log(scale)
    return weight[data.row], cost


def standing_out(data: TreeObservations, r: NDArray, told: int) -> NDArray:
    """Return observations that are far out at a start, by the median of their sensor.

    Args:
        r: What the start leaves, in the sensors' standard deviations. Shape (R,).
        told: How many numbers any body fits: that the rest fits contradicts nothing if it has no
            more.

    Returns:
        Boolean, by row of the table. Shape (N,).
    """
    norms = np.sqrt(data.per_row(r * r))
    out = np.zeros(len(norms), dtype=bool)
    for rows in data.sensors:
        k, own = rows.measured.shape[1], norms[rows.rows]
        if not data.sigma_held[data.noise_group[rows.first]]:
            out[rows.rows] = own > _FAR * np.sqrt(k / 3.0) * _scale_at_first(data, rows, own)
    return out & ((~out[data.row]).sum() > told)


def _scale_at_first(data: TreeObservations, rows: SensorRows, norms: NDArray) -> float:
    """Return how large the residuals of a sensor are at a start, in its standard deviation.

    Touches are few for what they tell: a start may explain most of them to the last digit, and
    nothing of the rest.
    """
    if data.sigma_held[data.noise_group[rows.first]]:
        return 1.0
    scale = robust_scale(norms, rows.measured.shape[1])
    return max(scale, 1.0) if rows.kind in TOUCHES else scale


def names_of_noise(noise: TreeNoise, seen: TreeObservations) -> dict[str, float]:
    """Return the standard deviations of sensors and joints, by name [m, rad or px]."""
    out = dict(zip(seen.noise_groups, noise.sensor.tolist(), strict=True))
    for (i, part), sigma in zip(seen.noisy_joints, noise.joint.tolist(), strict=True):
        joint = seen.data.joints[i]
        suffix = "" if joint.motion != FLANGE else (" turn" if part < 3 else " place")
        out |= {} if joint.motion == FREE else {f"{joint.name}{suffix}": sigma}
    return out


def noise_named(names: Mapping[str, float], seen: TreeObservations) -> TreeNoise | None:
    """Return noise that is known by name; None where not all that is needed is known.

    Args:
        names: Standard deviations, as `BodyModel.noise` has them.
        seen: What it is needed for.
    """
    joints = [seen.data.joints[i].name for i, _ in seen.noisy_joints]
    parts = ["" if name in names else " turn" if part < 3 else " place"
             for name, (_, part) in zip(joints, seen.noisy_joints, strict=True)]  # fmt: skip
    noisy = [f"{name}{part}" for name, part in zip(joints, parts, strict=True)]
    if not set(noisy) | set(seen.noise_groups) <= set(names):
        return None
    sensor, joint = (np.array([names[n] for n in of]) for of in (seen.noise_groups, noisy))
    return TreeNoise(sensor, joint)


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


def likeliest_noise(evidence: NoiseEvidence, start: TreeNoise) -> TreeNoise:
    """Return the noise that residuals ask for; the search begins at `start`."""
    found = _variances(evidence, start)
    return TreeNoise(found.sensor, found.joint, loud=start.loud)


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
        group = int(data.noise_group[rows.scalars][-1])
        alone = (data.noise_group == group).sum() == 3 * len(rows.rows)
        enough = len(np.unique(rows.pose)) >= _FEWEST_ALIKE
        if rows.kind == POSES and alone and enough and not rows.apart:
            measured = rows.measured
            X = transform(rotation_from_vector(measured[:, 3:]), measured[:, :3])
            sigma = np.full(3, start.sensor[group])
            yield X, AlikeErrors(nothing, _FIRST_SHARED * sigma, sigma, group)


def _columns(data: TreeObservations, linear: TreeLinear, alike: AlikeErrors) -> NDArray:
    """Return what shared errors of N(0, 1) do to residuals. Shape (R, q)."""
    if alike.turns is None:
        return alike.columns(linear.by_joint, data.data.observations.pose[data.row])
    turns = np.flatnonzero(data.noise_group == alike.turns).reshape(-1, 3)
    by_part, row = np.zeros((len(linear.r), 3)), np.zeros(len(linear.r), dtype=int)
    by_part[turns] = np.eye(3)
    row[turns] = np.arange(len(turns))[:, None]
    return alike.columns(by_part, row)


def _shared(
    evidence: NoiseEvidence, start: TreeNoise, X: NDArray, first: AlikeErrors
) -> TreeNoise | None:
    """Return the noise in which poses X share errors besides; None where that is not likelier."""
    evidence, known = evidence.beside(start.alike), start.own
    best, most = None, _variances(evidence, known).likelihood + DECISIVE
    for size in _SIZES:
        alike, noise = replace(first, basis=alike_basis(X, size)), _first_own(known, first)
        for _ in range(_ALIKE_ROUNDS):
            wider = evidence.beside((alike,))
            found = _variances(wider, noise)
            noise = TreeNoise(found.sensor, found.joint, loud=known.loud)
            if found.likelihood > most:
                best, most = noise.sharing((*start.alike, alike)), found.likelihood
            told = asked_for(wider, noise)
            alike = replace(alike, sigma=_as_told(alike, told, evidence.data.noisy_joints))
    return best


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


def _first_own(noise: TreeNoise, alike: AlikeErrors) -> TreeNoise:
    """Return where the search for what is each pose's own begins."""
    sensor, joint = noise.sensor.copy(), noise.joint.copy()
    if alike.turns is None:
        joint[alike.sigma > 0.0] *= _FIRST_ALONE
    else:
        sensor[alike.turns] *= _FIRST_ALONE
    return TreeNoise(sensor, joint, loud=noise.loud)


def asked_for(evidence: NoiseEvidence, noise: TreeNoise) -> tuple[NDArray, NDArray]:
    """Return what residuals ask of parameters N(0, 1), and the variances of that. Shapes (P,)."""
    linear = evidence.linear
    both = np.vstack([linear.r, linear.J]) / noise.sensor[evidence.data.noise_group]
    white = evidence.whitening(noise).white(both.T[:, None])
    C = covariance_told_by(white[:, 1:].T @ white[:, 1:] + np.diag(evidence.information))
    return -C @ (white[:, 1:].T @ white[:, 0]), np.diag(C)


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


def _variances(evidence: NoiseEvidence, start: TreeNoise) -> Variances:
    """Return the likeliest: joints of one kind alike, or each limb's where that is decisive."""
    data, linear, groups = evidence.data, evidence.linear, evidence.groups
    residuals = LinearResiduals(
        groups,
        groups.gather(linear.r[:, None]),
        groups.gather(linear.J.T[:, None]),
        linear.by_joint[:, None],
        data.noise_group[:, None],
        evidence.slipped,
        evidence.information,
        linear.taken,
    )
    kept = groups.rows
    left = _rms_by_group(residuals.left(start.sensor, start.joint)[:, 0], data, kept)
    rms = np.maximum(left, LEAST_OF_ALL / _LEAST_SHARE * _rms_by_group(linear.r, data, kept))
    by_joint = linear.by_joint[kept][:, ~data.unread] / rms[data.noise_group[kept], None]
    lever = float(np.sqrt(np.mean(by_joint**2))) if by_joint.size else 1.0

    def likeliest(group: NDArray, start: TreeNoise) -> Variances:
        counts = int(group.max(initial=-1)) + 1
        floor = np.append(_LEAST_SHARE * rms, np.full(counts, _LEAST_SHARE / max(lever, 1e-12)))
        known = np.zeros(len(group))
        search = VarianceSearch(residuals, known, group, np.maximum(floor, 1e-12), data.sigma_held)
        return search.run(start.sensor, start.joint)

    alike, by_limb = data.joint_groups(start.loud), data.joint_groups(start.loud, by_limb=True)
    found = likeliest(alike, start)
    if by_limb.max(initial=0) == alike.max(initial=0):
        return found
    apart = likeliest(by_limb, TreeNoise(found.sensor, found.joint))
    return apart if apart.likelihood > found.likelihood + DECISIVE else found


def _rms_by_group(r: NDArray, data: TreeObservations, kept: NDArray) -> NDArray:
    """Return the root mean square of what counts of each noise group, 0 of nothing. Shape (G,)."""
    group = data.noise_group[kept]
    squares = np.bincount(group, r[kept] ** 2, minlength=len(data.noise_groups))
    return np.sqrt(squares / np.maximum(np.bincount(group, minlength=len(squares)), 1))

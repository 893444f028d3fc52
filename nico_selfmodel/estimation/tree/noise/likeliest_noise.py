"""Noise that residuals ask for: finer where that is decisive, by limb or along lines of sight."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.variance_components import (
    LEAST_OF_ALL,
    LinearResiduals,
    Variances,
    VarianceSearch,
)
from nico_selfmodel.estimation.tree.noise.finer_noise import finer_noises, noise_ties
from nico_selfmodel.estimation.tree.noise.noise_evidence import NoiseEvidence
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise

DECISIVE = 8.0
"""Gain of a log likelihood from which on noise is finer, or shared by poses that are alike: two
standard deviations more, and a size."""
_LEAST_SHARE = 0.02
"""Part of the residuals below which a standard deviation counts as none."""


def likeliest_noise(evidence: NoiseEvidence, start: TreeNoise) -> TreeNoise:
    """Return the noise that residuals ask for; the search begins at `start`.

    Where it is finer along lines of sight, sizes are those in the mean (`VarianceSearch.expected`).
    """
    found = likeliest_variances(evidence, start)
    if apart := _apart(evidence.data, found.sensor):
        # Many variances are told by few freedoms each.
        alike = np.unique(found.joint, return_inverse=True)[1]
        found = _GroupedSearch.of(evidence, _noise_of(found), apart, alike).expected(found)
    return TreeNoise(found.sensor, found.joint, loud=start.loud)


def likeliest_variances(evidence: NoiseEvidence, start: TreeNoise) -> Variances:
    """Return the likeliest noise: finer where that is decisive, by limb or along lines of sight."""
    data, loud = evidence.data, start.loud
    # What was decisive is not asked again: less and less is left of what asked for it.
    known = _apart(data, start.sensor)
    joints, limbs = data.joint_groups(loud), data.joint_groups(loud, by_limb=True)
    found = _GroupedSearch.of(evidence, start, known, joints).run()
    if limbs.max(initial=0) > joints.max(initial=0):
        apart = _GroupedSearch.of(evidence, _noise_of(found), known, limbs).run()
        if apart.likelihood > found.likelihood + DECISIVE:
            found, joints = apart, limbs
    return _along_sight(evidence, found, known, joints)


def _along_sight(
    evidence: NoiseEvidence, found: Variances, known: frozenset[int], joints: NDArray
) -> Variances:
    """Return the same with depth and tilts less sure than the rest, where that is decisive."""
    data = evidence.data
    asked = frozenset(finer.group for finer in finer_noises(data.noise_groups))
    search = _GroupedSearch.of(evidence, _noise_of(found), asked, joints)
    if asked == known or search.promised <= 0.5 * DECISIVE:
        return found
    apart = search.run()
    told = _apart(data, apart.sensor)
    if told == known:
        return found
    if told != asked:
        apart = _GroupedSearch.of(evidence, _noise_of(apart), told, joints).run()
    return apart if apart.likelihood > found.likelihood + DECISIVE else found


def _apart(data: TreeObservations, sensor: NDArray) -> frozenset[int]:
    """Return finer noise groups that standard deviations tell from the others. Shape (G,)."""
    return frozenset(
        finer.group for finer in finer_noises(data.noise_groups) if finer.is_apart(sensor)
    )


def _noise_of(found: Variances) -> TreeNoise:
    return TreeNoise(found.sensor, found.joint)


@dataclass(frozen=True, eq=False)
class _GroupedSearch:
    """A search for variances that sensors, and joints, share with others."""

    search: VarianceSearch
    sensors: NDArray
    """Which noise groups share a variance. Shape (G,)."""
    sensor: NDArray
    """Standard deviations where it begins, of those that share none. Shape (H,)."""
    joint: NDArray
    """Of the joints. Shape (m,)."""

    @classmethod
    def of(
        cls, evidence: NoiseEvidence, start: TreeNoise, apart: frozenset[int], joints: NDArray
    ) -> "_GroupedSearch":
        """Prepare.

        Args:
            apart: Finer noise groups that have a variance of their own.
            joints: Which joints share a variance. Shape (m,).
        """
        data, linear, groups = evidence.data, evidence.linear, evidence.groups
        sensors = noise_ties(data.noise_groups, apart)
        first = np.unique(sensors, return_index=True)[1]
        sensor, taken = start.sensor[first], linear.taken
        residuals = LinearResiduals(
            groups,
            groups.gather(linear.r[:, None]),
            groups.gather(linear.J.T[:, None]),
            linear.by_joint[:, None],
            sensors[data.noise_group][:, None],
            evidence.slipped,
            evidence.information,
            None if taken is None else np.bincount(sensors, taken),
        )
        kept = groups.rows
        own = sensors[data.noise_group[kept]]
        left = _rms_by_group(residuals.left(sensor, start.joint)[kept, 0], own, len(first))
        whole = _rms_by_group(linear.r[kept], own, len(first))
        rms = np.maximum(left, LEAST_OF_ALL / _LEAST_SHARE * whole)
        by_joint = linear.by_joint[kept][:, ~data.unread] / rms[own, None]
        lever = float(np.sqrt(np.mean(by_joint**2))) if by_joint.size else 1.0
        counts = int(joints.max(initial=-1)) + 1
        floor = np.append(_LEAST_SHARE * rms, np.full(counts, _LEAST_SHARE / max(lever, 1e-12)))
        none = np.zeros(len(joints))
        held, floor = data.sigma_held[first], np.maximum(floor, 1e-12)
        search = VarianceSearch(residuals, none, joints, floor, held)
        return cls(search, sensors, sensor, start.joint)

    @property
    def promised(self) -> float:
        """See `VarianceSearch.promised`."""
        return self.search.promised(self.sensor, self.joint)

    def run(self) -> Variances:
        """Return the likeliest, of all noise groups."""
        found = self.search.run(self.sensor, self.joint)
        return replace(found, sensor=found.sensor[self.sensors])

    def expected(self, found: Variances) -> Variances:
        """Return variances as they are in the mean: see `VarianceSearch.expected`."""
        first = np.unique(self.sensors, return_index=True)[1]
        mean = self.search.expected(replace(found, sensor=found.sensor[first]))
        return replace(mean, sensor=mean.sensor[self.sensors])


def _rms_by_group(r: NDArray, group: NDArray, groups: int) -> NDArray:
    """Return the root mean square of each noise group, 0 of nothing. (K,) -> (G,)."""
    counts = np.bincount(group, minlength=groups)
    return np.sqrt(np.bincount(group, r**2, minlength=groups) / np.maximum(counts, 1))

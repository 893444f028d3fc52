"""Whether a body still fits what is known of it, pose by pose; how soon is in docs/health.md.

The noise that a training left (`training_noise`) says how likely each new pose is as the body was,
and had it changed (`monitored_changes`); the ratios add up to the statistic of Shiryaev and Roberts
(`monitor`), whose rate of false alarms is theory. No single pose raises the alarm: that is how a
false detection looks. Poses here and there that contradict raise none either; a body with more of
them than false detections explain does not pass (`contradictions`), nor one from which all are off
by more than louder noise explains, by whatever no change that is looked for does (`misfit`). Where
the readings were taken wrongly, that is told in place of a change (`misread`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.blas_threads import on_one_blas_thread
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.monitoring.diagnosis import (
    Diagnosis,
    Hypothesis,
    hypotheses,
    ranked_causes,
)
from nico_selfmodel.estimation.monitoring.encoder_jumps import slips_of_arm
from nico_selfmodel.estimation.monitoring.misfit import Misfit
from nico_selfmodel.estimation.monitoring.misread import ReadPoses, off_by_mended, some_of
from nico_selfmodel.estimation.monitoring.monitor import THRESHOLD, Monitor, chance_of_false_alarm
from nico_selfmodel.estimation.monitoring.monitored_changes import (
    MonitoredChanges,
    monitored_changes,
)
from nico_selfmodel.estimation.noise.contradictions import Contradictions
from nico_selfmodel.estimation.noise.hand_observations import covariance_of, hand_observations_of
from nico_selfmodel.estimation.noise.mixture_density import MixtureDensity
from nico_selfmodel.estimation.noise.pose_residuals import PoseResiduals
from nico_selfmodel.estimation.noise.training_noise import expected_noise
from nico_selfmodel.model.noise_mixture import NoiseMixture
from nico_selfmodel.model.self_model import SelfModel

ENOUGH = 10
"""Poses after a change by which its cause is told reliably."""
_LOOKS = 3
"""Times that cause and time of a change are sought in turn."""


@dataclass(frozen=True, eq=False)
class HealthReport:
    """New poses held against a body."""

    sample: NDArray
    """Number of each pose, the first where a standing robot was measured often. Shape (N,)."""
    nis: NDArray
    """Normalised innovations squared, by the second moment of the noise. Shape (N,)."""
    dof: NDArray
    """What each is to be expected to be: the coordinates measured there. Shape (N,)."""
    log_ratio: NDArray
    """ln R after each pose, as it was at the alarm from there on. Shape (N,)."""
    alarm_at: int | None
    """Pose at which the alarm was raised; None for a healthy body."""
    changed_at: int | None
    """First pose after the change."""
    diagnoses: tuple[Diagnosis, ...]
    """Explanations, the best first; empty for a healthy body."""
    noise: NoiseMixture
    """What was expected to disturb the poses."""
    contradictions: Contradictions
    """Which poses are further off than that noise explains."""
    misfit: Misfit
    """What all others together are off by."""
    misread: str | None = None
    """How the readings were taken wrongly, in words; None where they were not, or that is not
    told."""

    @property
    def healthy(self) -> bool:
        """Whether nothing changed, by alarm, by poses that contradict, or by what all are off."""
        against = self.contradictions.too_many or self.misfit.too_large
        return self.alarm_at is None and not against

    @property
    def false_alarm_chance(self) -> float:
        """Largest probability of an alarm in so many poses had nothing changed."""
        return chance_of_false_alarm(len(self.nis))

    @property
    def threshold(self) -> float:
        """Value of ln R beyond which an alarm is raised."""
        return THRESHOLD

    @property
    def sure(self) -> bool:
        """Whether there were enough poses after the change to tell its cause."""
        return self.changed_at is not None and len(self.nis) - self.changed_at >= ENOUGH

    def beside(self, read: ReadPoses) -> "HealthReport":
        """Return this report, without causes where readings that were taken wrongly explain it."""
        if self.healthy:
            return self
        words = read.misread(self.sample[self.contradictions.found])
        return self if words is None else replace(self, misread=words, diagnoses=())


@on_one_blas_thread
def check_health(model: SelfModel, dataset: Dataset, sensor: str = "auto") -> HealthReport:
    """Watch a body over new poses, in their order.

    Args:
        model: The body, with its covariance and the noise of its training.
        dataset: New encoder readings, and pixels or measured points.
        sensor: `pixels`, `points` or `auto`.

    Returns:
        Whether it still fits, and what changed if it does not.

    Raises:
        DataError: If the data do not suit the model, or nothing was measured.
        ModelError: If the model does not say what noise to expect.
    """
    observations = hand_observations_of(model, dataset, sensor)
    poses = PoseResiduals.of(observations)
    noise = expected_noise(model, poses.sensor, dataset)
    covariance, causes = covariance_of(model, poses.names), hypotheses(model, poses.names)
    report = watched(poses, noise, covariance, monitored_changes(model, poses.names), causes)
    report = report.beside(_read_poses(model, dataset, sensor, report, covariance))
    since, found = report.changed_at, report.diagnoses
    if since is None or not found:
        return report
    slips = slips_of_arm(model, dataset, sensor, noise, since)
    return replace(report, diagnoses=slips.ranked(found))


def _read_poses(
    model: SelfModel, dataset: Dataset, sensor: str, report: HealthReport, covariance: NDArray
) -> ReadPoses:
    numbers, first, row = np.unique(dataset.sample, return_index=True, return_inverse=True)
    since = int(np.searchsorted(numbers, report.sample[report.changed_at or 0]))
    few = some_of(since, len(numbers))

    def read(readings: NDArray) -> PoseResiduals:
        mended = replace(dataset, encoders=readings[row]).select(few[row])
        return PoseResiduals.of(hand_observations_of(model, mended, sensor))

    units, readings = tuple(joint.encoder_unit for joint in dataset.joints), dataset.encoders[first]
    off_by = off_by_mended(read, lambda p: innovations(p, report.noise, covariance), readings)
    return ReadPoses(dataset.joint_names, units, numbers, readings, off_by)


def innovations(poses: PoseResiduals, noise: NoiseMixture, covariance: NDArray) -> NDArray:
    """Return the squared innovation a coordinate of each pose that shows something. Shape (K,)."""
    nis = MixtureDensity(poses, noise, covariance).nis(poses.residuals)
    return np.asarray(nis[poses.dof > 0] / poses.dof[poses.dof > 0])


def watched(
    poses: PoseResiduals,
    noise: NoiseMixture,
    covariance: NDArray,
    changes: MonitoredChanges,
    causes: Sequence[Hypothesis],
    share: float | None = None,
) -> HealthReport:
    """Watch a body of any kind over poses, in their order.

    Args:
        poses: New poses held against it.
        noise: What is expected to disturb them.
        covariance: Of the poses' parameters. Shape (P, P).
        changes: What is looked for.
        causes: What may have changed.
        share: Of poses with false detections; what the noise says if omitted.

    Returns:
        Whether it fits, and since when not and why.
    """
    density = MixtureDensity(poses, noise, covariance)
    changes = changes.with_plain_sizes(density, poses.slopes)
    steps = changes.steps(density, poses.residuals, poses.slopes)
    monitor, course = Monitor.of(changes.weights), np.zeros(len(poses))
    alarm_at, since, found = None, None, ()
    for i, step in enumerate(steps):
        monitor = monitor.after(step)
        course[i:] = monitor.log_ratio
        if monitor.alarm:
            alarm_at = i
            since, found = dated(poses, noise, covariance, causes, monitor.changed_at, alarm_at)
            break
    nis = density.nis(poses.residuals)
    against = Contradictions.of(poses, density, share)
    misfit = Misfit.of(poses.select(~against.found), noise, covariance)
    return HealthReport(
        poses.sample, nis, poses.dof, course, alarm_at, since, found, noise, against, misfit
    )


def dated(
    poses: PoseResiduals,
    noise: NoiseMixture,
    covariance: NDArray,
    causes: Sequence[Hypothesis],
    since: int,
    alarm_at: int,
) -> tuple[int, tuple[Diagnosis, ...]]:
    """Return since when a body is another, and why: each by the other, in turn.

    Args:
        covariance: Of the poses' parameters. Shape (P, P).
        causes: What may have changed.
        since: The first guess.
        alarm_at: The change was no later.

    Returns:
        First pose after the change, and explanations, the best first.
    """
    found = ranked_causes(poses, noise, covariance, causes, since)
    for _ in range(_LOOKS):
        # The sum over all poses from each one on.
        said = np.cumsum(found[0].of_pose[::-1])[::-1]
        after = int(np.argmax(said[: alarm_at + 1]))
        if after == since:
            break
        since, found = after, ranked_causes(poses, noise, covariance, causes, after)
    return since, found

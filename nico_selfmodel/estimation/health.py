"""Whether a body still fits what is known of it, sighting by sighting.

Each new sighting gives a normalised innovation squared (NIS), chi-square distributed while the
model holds. Three sums watch it: the cumulative excess of NIS (CUSUM, Page 1954), which sees any
change; the likelihood ratio of one parameter's change over the last sightings; and for each joint,
either way, a CUSUM matched to a slip of 2 deg, which sees that sooner than the others.
How soon, and what no test can do, is in docs/health.md. No single sighting raises an alarm: that is
how a false detection looks.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset import Dataset
from nico_selfmodel.estimation.diagnosis import Diagnosis, diagnose
from nico_selfmodel.estimation.large_slips import with_large_slips
from nico_selfmodel.estimation.sightings import covariance_of, sightings_of
from nico_selfmodel.model.self_model import SelfModel

ALLOWANCE = 0.75
"""Excess of NIS over its expectation, as a share of that, which a healthy body is granted. The
expectation of points is 3 and of pixels 4; noise known to 3 % alone shifts it by 6 %."""
THRESHOLD = 20.0
"""Cumulative excess that raises the alarm."""
LARGEST_STEP = 0.6 * THRESHOLD
"""Most that one sighting adds to the excess."""
LARGEST_NIS = 14.0
"""Most of one sighting that counts in a likelihood ratio; chi-square of 4 passes it once in 140."""
WINDOW = 12
"""Sightings over which likelihood ratios are formed."""
RATIO_THRESHOLD = 25.0
"""Likelihood ratio that raises the alarm; chi-square of 1 passes it once in 1.7 million."""
SLIP = np.radians(2.0)
"""Slip of a joint that the matched sums look for [rad]."""
SLIP_THRESHOLD = 9.0
"""Log-likelihood ratio of a slip that raises the alarm."""
LARGEST_SLIP_STEP = 0.9 * SLIP_THRESHOLD
"""Most that one sighting adds to it."""
ENOUGH = 10
"""Sightings after a change by which its cause is told reliably."""


@dataclass(frozen=True, eq=False)
class Watch:
    """What is remembered of the sightings so far; each new one makes a new watch."""

    excess: float = 0.0
    """g = max(0, g + NIS - dof - allowance)."""
    ratio: float = 0.0
    """Largest likelihood ratio of one parameter's change that ends at the last sighting."""
    sightings: int = 0
    """Sightings so far."""
    since: int = 0
    """First sighting after the excess was last zero."""
    ratio_since: int = 0
    """First sighting of the window with the largest ratio."""
    slip: float = 0.0
    """Largest log-likelihood ratio of a joint's slip."""
    slip_sums: tuple[float, ...] = ()
    """Of each joint's slip forwards, then of each backwards."""
    slip_since: tuple[int, ...] = ()
    """First sighting after each of them was last zero."""
    recent: tuple[tuple[NDArray, NDArray], ...] = ()
    """Of the last sightings: h'r and h'h of each parameter watched. Each of shape (m,)."""

    @property
    def alarm(self) -> bool:
        """Whether any sum has passed its threshold."""
        return self.excess > THRESHOLD or self.ratio > RATIO_THRESHOLD or self.slip > SLIP_THRESHOLD

    @property
    def changed_at(self) -> int:
        """First sighting after the change, if there was one."""
        if self.slip > SLIP_THRESHOLD:
            return self.slip_since[int(np.argmax(self.slip_sums))]
        return self.since if self.excess > 0.0 else self.ratio_since

    def after(self, residual: NDArray, slopes: NDArray, slips: NDArray | None = None) -> "Watch":
        """Return the watch after one more sighting.

        Args:
            residual: Whitened innovation, without the coordinates not seen. Shape (k,).
            slopes: Whitened derivatives by the parameters watched. Shape (k, m).
            slips: What a slip of each joint would do to the residual; none if omitted.
                Shape (k, n).
        """
        nis, dof = float(residual @ residual), len(residual)
        step = min(nis - (1.0 + ALLOWANCE) * dof, LARGEST_STEP)
        excess, count = max(0.0, self.excess + step), self.sightings + 1
        shrink = min(1.0, np.sqrt(LARGEST_NIS / max(nis, 1e-12)))
        newest = (shrink * (residual @ slopes), np.sum(slopes * slopes, axis=0))
        recent = (*self.recent, newest)[-WINDOW:]
        # Sums over the last 1, 2, ... sightings.
        along = np.cumsum([h for h, _ in reversed(recent)], axis=0)
        levers = np.cumsum([h for _, h in reversed(recent)], axis=0)
        ratios = (along**2 / np.maximum(levers, 1e-12)).max(axis=1)
        best = int(np.argmax(ratios))
        slips = np.zeros((dof, 0)) if slips is None else slips
        slip_sums, slip_since = self._slips_after(residual, slips)
        return Watch(
            excess,
            float(ratios[best]),
            count,
            self.since if excess > 0.0 else count,
            count - 1 - best,
            float(slip_sums.max(initial=0.0)),
            tuple(slip_sums.tolist()),
            tuple(slip_since.tolist()),
            recent,
        )

    def _slips_after(self, residual: NDArray, slips: NDArray) -> tuple[NDArray, NDArray]:
        """Return g = max(0, g + h'r - h'h / 2) of every slip h, and since when. Shapes (2 n,)."""
        along, lever = residual @ slips, 0.5 * np.sum(slips * slips, axis=0)
        step = np.minimum(np.concatenate([along - lever, -along - lever]), LARGEST_SLIP_STEP)
        before = np.array(self.slip_sums or np.zeros(len(step)))
        since = np.array(self.slip_since or np.zeros(len(step)), dtype=int)
        sums = np.maximum(before + step, 0.0)
        return sums, np.where(sums > 0.0, since, self.sightings + 1)


@dataclass(frozen=True, eq=False)
class Watched:
    """Which single changes of a body are watched."""

    places: NDArray
    """Of zeros, gears and hand points among all parameters. Shape (m,)."""
    zeros: NDArray
    """Of each joint's zero among them. Shape (n,)."""
    turns: NDArray
    """By how much a slip of `SLIP` moves each zero [encoder rad]. Shape (n,)."""

    def of(self, slopes: NDArray) -> tuple[NDArray, NDArray]:
        """Return what `Watch.after` needs of derivatives by all parameters. Shape (k, P)."""
        return slopes[:, self.places], slopes[:, self.zeros] * self.turns


def watched(model: SelfModel, names: tuple[str, ...]) -> Watched:
    """Return which parameters' single changes are watched: zeros, gears and hand points.

    Args:
        model: The body.
        names: Parameters that sightings depend on.
    """
    own = {f"{joint}.{part}" for joint in model.joints for part in ("theta_offset", "gear")}
    own |= {f"hand.{marker}.{axis}" for marker in model.markers for axis in "xyz"}
    return Watched(
        np.array([i for i, name in enumerate(names) if name in own]),
        np.array([names.index(f"{joint}.theta_offset") for joint in model.joints]),
        SLIP * model.servos.gear,
    )


@dataclass(frozen=True, eq=False)
class HealthReport:
    """New sightings held against a body."""

    sample: NDArray
    """Number of the pose of each sighting. Shape (N,)."""
    nis: NDArray
    """Normalised innovations squared. Shape (N,)."""
    dof: NDArray
    """What each is to be expected to be. Shape (N,)."""
    excess: NDArray
    """Cumulative excess after each sighting, as it was at the alarm from there on. Shape (N,)."""
    ratio: NDArray
    """Largest likelihood ratio after each sighting, likewise. Shape (N,)."""
    slip: NDArray
    """Largest log-likelihood ratio of a slip after each sighting, likewise. Shape (N,)."""
    alarm_at: int | None
    """Sighting at which the alarm was raised; None for a healthy body."""
    changed_at: int | None
    """First sighting after the change."""
    diagnoses: tuple[Diagnosis, ...]
    """Explanations, the best first; empty for a healthy body."""

    @property
    def sums(self) -> tuple[tuple[str, NDArray, float], ...]:
        """Name, course and threshold of every sum that can raise the alarm."""
        return (
            ("cumulative excess", self.excess, THRESHOLD),
            ("likelihood ratio of one change", self.ratio, RATIO_THRESHOLD),
            ("log-likelihood ratio of a slip", self.slip, SLIP_THRESHOLD),
        )

    @property
    def healthy(self) -> bool:
        """Whether no alarm was raised."""
        return self.alarm_at is None

    @property
    def sure(self) -> bool:
        """Whether there were enough sightings after the change to tell its cause."""
        return self.changed_at is not None and len(self.nis) - self.changed_at >= ENOUGH


def check_health(model: SelfModel, dataset: Dataset, sensor: str = "auto") -> HealthReport:
    """Watch a body over new sightings, in their order.

    Args:
        model: The body, with its covariance.
        dataset: New encoder readings, and pixels or measured points.
        sensor: `pixels`, `points` or `auto`.

    Returns:
        Whether it still fits, and what changed if it does not.

    Raises:
        DataError: If the data do not suit the model, or nothing was seen.
        ModelError: If the model does not say what noise to expect.
    """
    sightings = sightings_of(model, dataset, sensor)
    innovations = sightings.innovations(covariance_of(model, sightings.names))
    r, slopes = innovations.whitened
    which = watched(model, sightings.names)
    watch, alarm_at = Watch(), None
    sums = np.zeros((3, len(sightings)))
    for i, seen in enumerate(innovations.seen):
        watch = watch.after(r[i, seen], *which.of(slopes[i, seen]))
        sums[:, i:] = [[watch.excess], [watch.ratio], [watch.slip]]
        if watch.alarm:
            alarm_at = i
            break
    report = HealthReport(
        sightings.sample,
        innovations.nis,
        innovations.dof,
        sums[0],
        sums[1],
        sums[2],
        alarm_at,
        None,
        (),
    )
    if alarm_at is None:
        return report
    # The change that explains all that came after it best tells when it was, too.
    starts = range(max(0, alarm_at - WINDOW + 1), alarm_at + 1)
    found = {
        start: diagnose(model, sightings.names, innovations.select(slice(start, None)))
        for start in starts
    }
    changed_at = max(found, key=lambda start: found[start][0].score)
    diagnoses = with_large_slips(model, dataset, sensor, innovations, changed_at, found[changed_at])
    return replace(report, changed_at=changed_at, diagnoses=diagnoses)

"""Whether the parameters stayed the same while the data were recorded.

For a change of a group of parameters after a pose, the score test with all parameters as nuisance
(Andrews 1993): with sums over the poses before it, T = sum J'S^-1 r and H = sum J'S^-1 J,
T_g' [(H_t - H_t H^-1 H_t)_gg]^-1 T_g is chi square of the group's size where nothing changed; few
degrees of freedom tell the variance, too (`ScoreSums.chance`).
A marker that was knocked, an encoder that jumped, a tracker that drifted all show.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.diagnosis.score_sums import (
    CourseFound,
    ScoreSums,
    sums_of_arm,
)
from nico_selfmodel.estimation.diagnosis.systematic_residuals import Pattern
from nico_selfmodel.estimation.noise.arm_solution import ArmSolution
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.geometry.rotation import slope_together
from nico_selfmodel.model.arm.dh_parameters import DhParameters

LARGEST_CHANCE = 1e-7
"""Of a change where there was none; some hundred samples and ten groups are tried."""
NOTABLE = 1.1
"""Ratio of the mean residuals without and with it that makes a change worth a failure."""
FEWEST_VISITS = 20
"""Visits below which no change, and samples below which no lag is looked for."""
_FOLLOWS = 0.9
"""Correlation of a reading with time above which place and time cannot be told apart ..."""
_OVERLAP = 0.2
"""... as where less of the poses before a step lies within the range of those after, or back."""
_EXPLAINS_MUCH = 1.5
"""Ratio beyond which a change is one, though a pattern gains more or its own gain is small."""
_SIMPLER = 7.0
"""Chi square that each further number of a change must bring to be named."""


Words = Callable[[NDArray, bool], str]
"""What is said of a change by its size, and whether it came by and by."""


@dataclass(frozen=True, eq=False)
class Change:
    """A group of parameters that did not stay the same."""

    what: str
    """In words: `the encoder of elbow jumped by about 2 deg after sample 40`."""
    ratio: float
    """The mean residual without it over that with it."""
    told_from_place: bool = True
    """Whether it is surely one of time: what depends on the place may look the same."""

    @property
    def notable(self) -> bool:
        """Whether other recordings will miss by more than the held-out poses of this one."""
        return self.ratio > NOTABLE and self.told_from_place

    @property
    def explains(self) -> bool:
        """Whether it explains so much that all else that is wrong follows from it."""
        return self.ratio > _EXPLAINS_MUCH and self.told_from_place

    @property
    def reason(self) -> str | None:
        """Why a calibration fails; None where the change does not matter, or may be none."""
        advice = "learn from one part alone, or record again"
        return f"{self.what}: {advice}" if self.notable else None

    @property
    def warning(self) -> str | None:
        """What is said where it is no failure."""
        if not self.told_from_place:
            return f"{self.what}, or the arm bends there: the poses do not tell which"
        return None if self.notable else f"{self.what}; too little to matter beside the noise"


def change_in_time(
    observations: Observations,
    solved: ArmSolution,
    granted: NDArray,
    patterns: Sequence[Pattern] = (),
) -> Change | None:
    """Find what changed in the middle of a recording.

    Args:
        observations: What was measured; samples are numbered in the order of time.
        solved: The arm. Its outliers take part: what contradicts all that was before is no noise.
        granted: What the residuals may depend on besides, as changes of the predictions: in poses
            that follow an order, an error that depends on the place looks like one of time.
            Shape (N, 3, m).
        patterns: What they do depend on; a change counts only where it explains more.

    Returns:
        The change that explains most, or None where there is none.
    """
    if solved.noise is None or len(np.unique(observations.visit)) < FEWEST_VISITS:
        return None
    ways = _hand_as_one(solved.parameters)
    sums = sums_of_arm(observations, solved, granted, ways)
    groups = [*_groups(solved.parameters, solved.parameters.names)]
    if ways.size:
        last = sums.left.jacobian.shape[2]
        what = "what carries the markers on the hand"
        groups.append((moved_words(what), list(range(last - ways.shape[1], last))))
    # Sums of scores are cut and swelled, so that a pattern may gain more and explain much less.
    gain = max((pattern.score.gain for pattern in patterns), default=0.0)

    def mixed(found: CourseFound) -> bool:
        course = found.course[np.searchsorted(sums.last, observations.sample)]
        return mixed_in_time(observations.angles, course)

    return likeliest_change(sums, groups, mixed, gain)


def likeliest_change(
    sums: ScoreSums,
    groups: Iterable[tuple[Words, list[int]]],
    mixed: Callable[[CourseFound], bool],
    gain: float = 0.0,
) -> Change | None:
    """Return the change that explains most, None where there is none.

    Args:
        sums: Scores over time.
        groups: Parameters that may change together, with what is said of them.
        mixed: Whether poses of all times are mixed, so that time is told from place.
        gain: Of what else the residuals depend on; a change counts only where it explains more.
    """
    candidates = [
        _Candidate(words, columns, found, *sums.improvement(columns, found))
        for words, columns in groups
        for found in (sums.step(columns), sums.drift(columns))
        if found is not None
    ]
    if not candidates:
        return None
    best = max(candidates, key=lambda one: one.found.statistic - _SIMPLER * len(one.columns))
    chance = sums.chance(best.found, best.columns)
    # What joint noise took for its own explains much, though its scores are small.
    most = max(candidates, key=lambda one: one.ratio)
    by_ratio = sums.chance_of(most.ratio, most.columns) * len(candidates)
    rival = best.ratio if chance <= LARGEST_CHANCE else 1.0
    if by_ratio < LARGEST_CHANCE and most.ratio > _EXPLAINS_MUCH * rival:
        best, chance = most, by_ratio
    if chance > LARGEST_CHANCE:
        return None
    found = best.found
    what = f"{best.words(best.size, found.drift)} {sums.when(found)}"
    surely = found.statistic > gain or best.ratio > _EXPLAINS_MUCH
    return Change(what, best.ratio, mixed(found) and surely)


def mixed_in_time(readings: NDArray, course: NDArray) -> bool:
    """Return whether poses of all times are mixed: no joint's reading follows the course of time.

    Args:
        readings: Of the joints, by row. Shape (N, n).
        course: Of the change in time, by row. Shape (N,).
    """
    time = course - course.mean()
    angles = readings - readings.mean(axis=0)
    sizes = np.linalg.norm(time) * np.linalg.norm(angles, axis=0)
    if bool((np.abs(time @ angles) > _FOLLOWS * np.maximum(sizes, 1e-300)).any()):
        return False
    late = course > 0.5
    if not late.any() or late.all():
        return True
    for column in readings.T:
        apart = min(
            np.mean(column[late] >= column[~late].min()),
            np.mean(column[late] <= column[~late].max()),
            np.mean(column[~late] >= column[late].min()),
            np.mean(column[~late] <= column[late].max()),
        )
        if apart < _OVERLAP:
            return False
    return True


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A group of parameters and how it may have changed."""

    words: Words
    columns: list[int]
    found: CourseFound
    ratio: float
    """The mean residual without it over that with it."""
    size: NDArray
    """Of the change, in the parameters' own units."""


def verb(drift: bool, at_once: str = "moved") -> str:
    """Return what something did that changed."""
    return "drifted" if drift else at_once


def encoder_words(joint: str, slides: bool = False) -> Words:
    """Return what is said of a joint's readings that changed [rad], [m] of one that slides."""

    def words(size: NDArray, drift: bool) -> str:
        far = abs(float(size[0]))
        told = f"{1e3 * far:.2g} mm" if slides else f"{np.degrees(far):.2g} deg"
        return f"the encoder of {joint!r} {verb(drift, 'jumped')} by about {told}"

    return words


def moved_words(what: str) -> Words:
    """Return what is said of a frame whose place [m] and turn [rad] changed."""

    def words(size: NDArray, drift: bool) -> str:
        far, turn = 1e3 * np.linalg.norm(size[:3]), np.degrees(np.linalg.norm(size[3:]))
        return f"{what} {verb(drift)} by about {far:.2g} mm and {turn:.2g} deg"

    return words


def mirror_words(mirror: str) -> Words:
    """Return what is said of a plane whose two tilts [rad] and distance [m] changed."""

    def words(size: NDArray, drift: bool) -> str:
        far, turn = 1e3 * abs(float(size[2])), np.degrees(np.linalg.norm(size[:2]))
        return f"mirror {mirror!r} {verb(drift)} by about {far:.2g} mm and {turn:.2g} deg"

    return words


def _hand_as_one(parameters: DhParameters) -> NDArray:
    """Return how the parameters go where markers move together. Shape (P, 6), (P, 0) of one."""
    p_NH, markers = parameters.table.p_NH, parameters.table.markers
    out = np.zeros((len(parameters.names), 6 if len(p_NH) > 1 else 0))
    if out.size:
        own = [f"hand.{marker}.{axis}" for marker in markers for axis in "xyz"]
        out[[parameters.names.index(name) for name in own]] = slope_together(p_NH).reshape(-1, 6)
    return out


def _groups(parameters: DhParameters, names: tuple[str, ...]) -> Iterator[tuple[Words, list[int]]]:
    """Yield what may change together, with its words."""
    for joint, gear in zip(parameters.table.joints, parameters.servos.gear, strict=True):
        words = encoder_words(joint)

        def jumped(size: NDArray, drift: bool, words: Words = words, gear: float = gear) -> str:
            return words(size / gear, drift)

        yield jumped, [names.index(f"{joint}.theta_offset")]
    for marker in parameters.table.markers:

        def slipped(size: NDArray, drift: bool, marker: str = marker) -> str:
            did = "wandered" if drift else "slipped"
            length = 1e3 * float(np.linalg.norm(size))
            return f"marker {marker} {did} on the hand by about {length:.2g} mm"

        yield slipped, [names.index(f"hand.{marker}.{axis}") for axis in "xyz"]

    def moved(size: NDArray, drift: bool) -> str:
        listed = ", ".join(f"{value:.2g}" for value in 1e3 * size)
        return f"tracker or base {verb(drift)} by about ({listed}) mm"

    yield moved, [names.index(f"M0.{axis}") for axis in "xyz"]

    def turned(size: NDArray, drift: bool) -> str:
        degrees = np.degrees(np.linalg.norm(size))
        return f"tracker or base {verb(drift, 'turned')} by about {degrees:.2g} deg"

    yield turned, [names.index(f"M0.{axis}") for axis in ("rx", "ry", "rz")]

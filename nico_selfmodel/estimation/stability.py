"""Whether the parameters stayed the same while the data were recorded.

For a change of a group of parameters after a pose, the score test with all parameters as nuisance
(Andrews 1993): with sums over the poses before it, T = sum J'S^-1 r and H = sum J'S^-1 J,
T_g' [(H_t - H_t H^-1 H_t)_gg]^-1 T_g is chi square of the group's size where nothing changed.
A marker that was knocked, an encoder that jumped, a tracker that drifted all show.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.arm_solution import ArmSolution, Linearised
from nico_selfmodel.estimation.observations import Observations
from nico_selfmodel.estimation.pose_noise import PoseGroups, PoseWhitening
from nico_selfmodel.estimation.score_test import ScoreTest
from nico_selfmodel.estimation.systematic_residuals import Pattern, backlash_columns
from nico_selfmodel.model import DhParameters
from nico_selfmodel.optimization.chi_square import chi_square_tail

LARGEST_CHANCE = 1e-7
"""Of a change where there was none; some hundred samples and ten groups are tried."""
NOTABLE = 1.1
"""Ratio of the mean residuals without and with it that makes a change worth a failure."""
_FEWEST = 20
"""Samples below which no change is looked for."""
_MARGIN = 4
"""Samples that lie before and after any change."""
_CLIPPED = 2.5
"""Whitened residuals of a sample count up to this rms: a single outlier is no change."""
_MOST_SAMPLES, _MOST_SPANS = 2000, 400
"""Samples that are looked at, and spans of time between which a change may lie."""
_LAGS = 12
"""Spans over which residuals may be alike for another reason: poses in an order."""
_LEAST_LAG = 0.01
"""Part of the time between two samples below which a lag is something else, such as backlash."""
_FOLLOWS = 0.9
"""Correlation of a reading with time above which place and time cannot be told apart ..."""
_OVERLAP = 0.2
"""... as where less of the poses before a step lies within the range of those after, or back."""
_EXPLAINS_MORE = 1.5
"""How many times more than a pattern a change must explain that the pattern outdoes in gain."""
_SIMPLER = 7.0
"""Chi square that each further number of a change must bring to be named."""


@dataclass(frozen=True, eq=False)
class Change:
    """A group of parameters that did not stay the same."""

    what: str
    """In words: `the encoder of elbow jumped by about 2 deg after sample 40`."""
    chance: float
    """How often it is found where nothing changed."""
    ratio: float
    """The mean residual without it over that with it."""
    told_from_place: bool = True
    """Whether it is surely one of time: what depends on the place may look the same."""

    @property
    def notable(self) -> bool:
        """Whether other recordings will miss by more than the held-out poses of this one."""
        return self.ratio > NOTABLE and self.told_from_place


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
    if solved.noise is None or len(np.unique(observations.sample)) < _FEWEST:
        return None
    sums = _Sums.of(observations, solved, granted)
    best, most = None, -np.inf
    for words, columns in _groups(solved.parameters, sums.names):
        for course in (sums.step, sums.drift):
            found = course(columns)
            if found is not None and found.statistic - _SIMPLER * len(columns) > most:
                most = found.statistic - _SIMPLER * len(columns)
                best = (words, columns, found)
    if best is None:
        return None
    words, columns, found = best
    chance = chi_square_tail(found.statistic, len(columns))
    if chance > LARGEST_CHANCE:
        return None
    what = f"{words(found.size, found.drift)} {sums.when(found)}"
    alike = mixed_in_time(
        observations, found.course[np.searchsorted(sums.last, observations.sample)]
    )
    ratio = sums.improvement(columns, found)
    # Sums of scores are cut and swelled, so that a pattern may gain more and explain much less.
    gain = max((pattern.score.gain for pattern in patterns), default=0.0)
    explained = max((pattern.score.improvement for pattern in patterns), default=1.0)
    surely = found.statistic > gain or ratio > _EXPLAINS_MORE * explained
    return Change(what, chance, ratio, alike and surely)


def mixed_in_time(observations: Observations, course: NDArray) -> bool:
    """Return whether poses of all times are mixed: no joint's reading follows the course of time.

    Args:
        observations: What was measured.
        course: Of the change in time, by row. Shape (N,).
    """
    time = course - course.mean()
    angles = observations.angles - observations.angles.mean(axis=0)
    sizes = np.linalg.norm(time) * np.linalg.norm(angles, axis=0)
    if bool((np.abs(time @ angles) > _FOLLOWS * np.maximum(sizes, 1e-300)).any()):
        return False
    late = course > 0.5
    if not late.any() or late.all():
        return True
    for column in observations.angles.T:
        apart = min(
            np.mean(column[late] >= column[~late].min()),
            np.mean(column[late] <= column[~late].max()),
            np.mean(column[~late] >= column[late].min()),
            np.mean(column[~late] <= column[late].max()),
        )
        if apart < _OVERLAP:
            return False
    return True


Words = Callable[[NDArray, bool], str]


def _groups(parameters: DhParameters, names: tuple[str, ...]) -> Iterator[tuple[Words, list[int]]]:
    """Yield what may change together, with its words."""
    for joint, gear in zip(parameters.table.joints, parameters.servos.gear, strict=True):

        def jumped(size: NDArray, drift: bool, joint: str = joint, gear: float = gear) -> str:
            verb = "drifted" if drift else "jumped"
            degrees = float(np.degrees(abs(size[0]) / gear))
            return f"the encoder of {joint} {verb} by about {degrees:.2g} deg"

        yield jumped, [names.index(f"{joint}.theta_offset")]
    for marker in parameters.table.markers:

        def slipped(size: NDArray, drift: bool, marker: str = marker) -> str:
            verb = "wandered" if drift else "slipped"
            length = 1e3 * float(np.linalg.norm(size))
            return f"marker {marker} {verb} on the hand by about {length:.2g} mm"

        yield slipped, [names.index(f"hand.{marker}.{axis}") for axis in "xyz"]

    def moved(size: NDArray, drift: bool) -> str:
        listed = ", ".join(f"{value:.2g}" for value in 1e3 * size)
        verb = "drifted" if drift else "moved"
        return f"tracker or base {verb} by about ({listed}) mm"

    yield moved, [names.index(f"M0.{axis}") for axis in "xyz"]

    def turned(size: NDArray, drift: bool) -> str:
        verb = "drifted" if drift else "turned"
        return f"tracker or base {verb} by about {np.degrees(np.linalg.norm(size)):.2g} deg"

    yield turned, [names.index(f"M0.{axis}") for axis in ("rx", "ry", "rz")]


def lag_in_time(
    observations: Observations, parameters: DhParameters, test: ScoreTest
) -> Change | None:
    """Find whether points were measured earlier or later than the readings beside them.

    A point that lags by a part t of the time between two samples misses by -t dp/dq (q_k - q_k-1).

    Args:
        observations: What was measured; samples are numbered in the order of time.
        parameters: The arm.
        test: Residuals at the solution, what they are known to depend on granted.

    Returns:
        The lag, or None where there is none.
    """
    samples, first, of = np.unique(observations.sample, return_index=True, return_inverse=True)
    if len(samples) < _FEWEST:
        return None
    # Of samples that are missing in between, the part that one of them would have had.
    moves = np.diff(observations.angles[first], axis=0) / np.diff(samples)[:, None]
    zero = np.zeros((1, moves.shape[1]))
    best, cases = None, ((zero, moves, "lag behind"), (moves, zero, "lead"))
    for first_part, second_part, verb in cases:
        move = (np.vstack([first_part, second_part]) / parameters.servos.gear)[of.reshape(-1)]
        columns = np.einsum("nij,nj->ni", test.linear.by_angle, move)
        score = test.of(columns[:, :, None])
        if score.chance < LARGEST_CHANCE and (best is None or score.gain > best[0].gain):
            best = (score, verb)
    if best is None:
        return None
    score, verb = best
    # Backlash follows the direction of motion too, but not how far it went.
    backlash = test.of(backlash_columns(observations, test.linear.by_angle))
    if backlash.gain - _SIMPLER * backlash.dof > score.gain:
        return None
    size = abs(float(score.values[0]))
    if size < _LEAST_LAG:
        return None
    what = (
        f"the points {verb} the readings by about {size:.2g} of the time between two samples: take "
        "both at one moment, or let the arm settle before each sample"
    )
    return Change(what, score.chance, score.improvement)


@dataclass(frozen=True, eq=False)
class _Found:
    """The best of one course of time."""

    statistic: float
    size: NDArray
    """What changed, in the parameters' own units."""
    course: NDArray
    """How it came: 0 and 1 before and after a step, or a steady rise. Shape (spans,)."""
    span: int
    """Last span before a step."""
    drift: bool


@dataclass(frozen=True, eq=False)
class _Sums:
    """Scores J'S^-1 r and information J'S^-1 J of spans of time."""

    linear: Linearised
    """Residuals of the samples that are looked at."""
    span: NDArray
    """Span of each of its rows. Shape (N,)."""
    free: NDArray
    """Places of the free parameters, and of patterns. Shape (k,)."""
    s: NDArray
    """Shape (spans, P)."""
    plain: NDArray
    """The scores with outliers in full. Shape (spans, P)."""
    h: NDArray
    """Shape (spans, P, P)."""
    inverse: NDArray
    """(sum h)_ff^-1. Shape (k, k)."""
    squares: float
    """Of all whitened residuals, what the free parameters could take taken off."""
    variance: float
    """Of one of them."""
    scale: NDArray
    """What the parameters were divided by. Shape (P,)."""
    last: NDArray
    """Last sample of each span. Shape (spans,)."""

    @classmethod
    def of(cls, observations: Observations, solved: ArmSolution, granted: NDArray) -> "_Sums":
        assert solved.noise is not None
        samples = np.unique(observations.sample)
        chosen = samples[:: max(len(samples) // _MOST_SAMPLES, 1)]
        looked_at = np.isin(observations.sample, chosen)
        rows = observations.select(looked_at)
        everything = np.ones(len(rows), dtype=bool)
        linear = Linearised.at(rows, solved.parameters, everything, solved.noise)
        jacobian = np.concatenate([linear.jacobian, granted[looked_at]], axis=2)
        linear = replace(linear, jacobian=jacobian)
        groups = PoseGroups(rows.sample, everything, 3)
        whitening = PoseWhitening(groups, linear.by_angle, solved.noise)
        w = whitening.root(groups.gather(linear.residuals[:, :, None]))[:, :, 0]
        large = np.sqrt(np.sum(w**2, axis=1) / (3.0 * np.bincount(groups.pose))) / _CLIPPED
        full, w = w, w / np.maximum(large, 1.0)[:, None]
        scale = 1.0 / np.maximum(np.sqrt(np.sum(linear.jacobian**2, axis=(0, 1))), 1e-300)
        U = whitening.root(groups.gather(linear.jacobian * scale))
        starts = np.unique(np.linspace(0, len(chosen), _MOST_SPANS, endpoint=False).astype(int))
        s, plain = (np.add.reduceat(np.einsum("gkp,gk->gp", U, part), starts) for part in (w, full))
        h = np.add.reduceat(np.swapaxes(U, 1, 2) @ U, starts)
        free = [i for i, n in enumerate(linear.names) if n in solved.free]
        free = np.array([*free, *range(len(linear.names), jacobian.shape[2])])
        inverse = np.linalg.pinv(h.sum(axis=0)[np.ix_(free, free)], rcond=1e-10, hermitian=True)
        score = s.sum(axis=0)[free]
        squares = float(np.sum(w**2) - score @ inverse @ score)
        redundancy = max(3 * len(rows) - len(free), 1)
        variance = max(squares / redundancy, np.finfo(float).tiny)
        last = chosen[np.append(starts[1:], len(chosen)) - 1]
        span = np.searchsorted(starts, groups.pose, side="right") - 1
        return cls(linear, span, free, s, plain, h, inverse, squares, variance, scale, last)

    @property
    def names(self) -> tuple[str, ...]:
        """All parameters."""
        return self.linear.names

    def step(self, columns: list[int]) -> _Found | None:
        """Return the best sudden change of some parameters."""
        T, M = self._efficient(np.cumsum(self.s, axis=0), np.cumsum(self.h, axis=0), columns)
        inside = slice(_MARGIN, len(T) - _MARGIN)
        gains = np.full(len(T), -np.inf)
        gains[inside] = _quadratic(M[inside], T[inside])
        at = int(np.argmax(gains))
        size = np.linalg.lstsq(M[at], T[at], rcond=1e-9)[0]
        after = np.arange(len(T)) > at
        # The change that is told is that of later poses.
        return self._found(float(gains[at]), columns, -size, at, after.astype(float), drift=False)

    def drift(self, columns: list[int]) -> _Found | None:
        """Return the best steady change of some parameters, over the whole recording."""
        course = np.linspace(-0.5, 0.5, len(self.s))
        T, _ = self._efficient(
            (course[:, None] * self.s).sum(axis=0)[None],
            (course[:, None, None] * self.h).sum(axis=0)[None],
            columns,
        )
        own = (course[:, None, None] ** 2 * self.h).sum(axis=0)[columns][:, columns]
        cross = (course[:, None, None] * self.h).sum(axis=0)[columns][:, self.free]
        M = own - cross @ self.inverse @ cross.T
        gain = float(_quadratic(M[None], T)[0])
        size = np.linalg.lstsq(M, T[0], rcond=1e-9)[0]
        return self._found(gain, columns, size, len(course) // 2, course, drift=True)

    def _efficient(self, s: NDArray, h: NDArray, columns: list[int]) -> tuple[NDArray, NDArray]:
        """Return scores and information of columns, what free parameters take taken off."""
        cross = h[:, columns][:, :, self.free]
        total = self.inverse @ self.s.sum(axis=0)[self.free]
        taken = cross @ self.inverse @ np.swapaxes(cross, 1, 2)
        return s[:, columns] - cross @ total, h[:, columns][:, :, columns] - taken

    def _found(
        self,
        gain: float,
        columns: list[int],
        size: NDArray,
        at: int,
        course: NDArray,
        *,
        drift: bool,
    ) -> _Found | None:
        """Return what was found, with the sums' own scatter taken into account."""
        if not np.isfinite(gain) or gain <= 0.0:
            return None
        own = self.h[:, columns][:, :, columns]
        expected = course[:, None] * np.einsum("tij,j->ti", own, size)
        statistic = gain / self.variance / _likeness(self.s[:, columns] - expected)
        return _Found(statistic, size * self.scale[columns], course, at, drift)

    def improvement(self, columns: list[int], found: _Found) -> float:
        """Return the mean distance of all rows from the arm over that with the change.

        Its size is that which explains outliers, if they are part of it, or that which does not.
        """
        cross = np.einsum("t,tij->ij", found.course, self.h[:, columns][:, :, self.free])
        own = np.einsum("t,tij->ij", found.course**2, self.h[:, columns][:, :, columns])
        before = np.linalg.norm(self.linear.residuals, axis=1).mean()
        after = [before]
        for s in (self.s, self.plain):
            fitted = s.sum(axis=0)[self.free]
            along = found.course @ s[:, columns] - cross @ self.inverse @ fitted
            size = np.linalg.lstsq(own - cross @ self.inverse @ cross.T, along, rcond=1e-9)[0]
            taken = self.inverse @ (fitted - cross.T @ size)
            moved = self.linear.jacobian[:, :, self.free] @ (taken * self.scale[self.free])
            changed = self.linear.jacobian[:, :, columns] @ (size * self.scale[columns])
            moved += found.course[self.span, None] * changed
            after.append(np.linalg.norm(self.linear.residuals - moved, axis=1).mean())
        return float(before / max(min(after), np.finfo(float).tiny))

    def when(self, found: _Found) -> str:
        """Say when."""
        if found.drift:
            return "during the recording"
        return f"after sample {int(self.last[found.span])}"


def _quadratic(M: NDArray, T: NDArray) -> NDArray:
    """Return T' M^-1 T of each; directions that nothing tells count for nothing."""
    values, vectors = np.linalg.eigh(M)
    along = np.einsum("tij,ti->tj", vectors, T)
    largest = np.maximum(values[:, -1:], 1e-300)
    parts = along**2 / np.maximum(values, 1e-300)
    return np.sum(np.where(values > 1e-6 * largest, parts, 0.0), axis=1)


def _likeness(scores: NDArray) -> float:
    """Return by how much successive scores being alike swells their sums (Newey, West 1987)."""
    centred = scores - scores.mean(axis=0)
    power = np.maximum(np.sum(centred**2, axis=0), 1e-300)
    swell = 1.0
    for lag in range(1, min(_LAGS, len(scores) // 4) + 1):
        alike = np.mean(np.sum(centred[lag:] * centred[:-lag], axis=0) / power)
        swell += 2.0 * (1.0 - lag / (_LAGS + 1.0)) * float(alike)
    return max(swell, 1.0)

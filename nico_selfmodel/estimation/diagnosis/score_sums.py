"""Sums of scores over the spans of a recording, and the best course of a change in them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.arm_solution import ArmSolution, Linearised
from nico_selfmodel.estimation.noise.pose_groups import PoseGroups
from nico_selfmodel.estimation.noise.pose_noise import PoseWhitening
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.optimization.chi_square import chi_square_tail

MARGIN = 4
"""Visits that lie before and after any change, of those that tell of it."""
_CLIPPED = 2.5
"""Whitened residuals of a visit, or an observation, count up to this rms: a single outlier is no
change."""
_MOST_VISITS, _MOST_SPANS = 2000, 400
"""Visits that are looked at, and spans of time between which a change may lie."""
_LAGS = 12
"""Spans over which residuals may be alike for another reason: poses in an order."""


@dataclass(frozen=True, eq=False)
class CourseFound:
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
class Left:
    """Residuals that changes are to explain, and their derivatives."""

    residuals: NDArray
    """Measured minus predicted, in one unit. Shape (N, d)."""
    jacobian: NDArray
    """By all parameters over `scale`. Shape (N, d, P)."""
    scale: NDArray
    """What the parameters were divided by. Shape (P,)."""
    visit: NDArray
    """Visit of each row, in the order of time. Shape (N,)."""


@dataclass(frozen=True, eq=False)
class ScoreSums:
    """Scores J'S^-1 r and information J'S^-1 J of spans of time."""

    left: "Left"
    """Rows that are looked at, not whitened."""
    span: NDArray
    """Span of each of them. Shape (N,)."""
    free: NDArray
    """Places of the free parameters, and of patterns. Shape (k,)."""
    s: NDArray
    """Shape (spans, P)."""
    plain: NDArray
    """The scores with outliers in full. Shape (spans, P)."""
    h: NDArray
    """Shape (spans, P, P)."""
    inverse: NDArray
    """(sum h)_ff^-1, priors included. Shape (k, k)."""
    pull: NDArray
    """What priors add to the scores of the free parameters. Shape (k,)."""
    variance: float
    """Of one whitened residual, what the free parameters could take taken off."""
    dof: float
    """Degrees of freedom that tell the variance: numbers beyond the free parameters."""
    last: NDArray
    """Last sample of each span. Shape (spans,)."""
    by_row: bool = False
    """Whether a change is asked what it does to what it moves, not to all rows."""

    @classmethod
    def of(
        cls,
        white: NDArray,
        visit: NDArray,
        left: "Left",
        free: NDArray,
        last: NDArray,
        prior: tuple[NDArray, NDArray] | None = None,
        single: NDArray | None = None,
        most: int = _MOST_SPANS,
    ) -> "ScoreSums":
        """Sum scores and information over spans of time.

        Args:
            white: Whitened residuals, measured minus predicted, then derivatives. (T, 1 + P).
            visit: Visit of each, in the order of time. Shape (T,).
            left: The same not whitened.
            free: Places of the free parameters, and of patterns. Shape (k,).
            last: Last sample of each visit. Shape (visits,).
            prior: Whitened derivatives by the free parameters, (m, k), and residuals of priors.
            single: What may be an outlier by itself, of each; a visit if omitted. Shape (T,).
            most: Spans at most.
        """
        full, U = white[:, 0], white[:, 1:]
        counts = np.bincount(left.visit, minlength=len(last)) * left.residuals.shape[1]
        if single is not None:
            counts = np.bincount(single)
        of = visit if single is None else single
        squares = np.bincount(of, full**2, minlength=len(counts))
        large = np.sqrt(squares / np.maximum(counts, 1)) / _CLIPPED
        w = full / np.maximum(large, 1.0)[of]
        starts = np.unique(np.linspace(0, len(last), most, endpoint=False).astype(int))
        span_of = np.searchsorted(starts, np.arange(len(last)), "right") - 1
        s, plain, h = _sums_of_spans(U, w, full, span_of[visit], len(starts))
        told = h.sum(axis=0)[np.ix_(free, free)]
        information, pull = told, np.zeros(len(free))
        if prior is not None:
            information, pull = told + prior[0].T @ prior[0], prior[0].T @ prior[1]
        inverse = np.linalg.pinv(information, rcond=1e-10, hermitian=True)
        score = s.sum(axis=0)[free]
        step = inverse @ (score + pull)
        # Of the residuals alone: what priors give way by is not taken off them.
        rest = float(np.sum(w**2) - 2.0 * score @ step + step @ told @ step)
        # What a prior holds takes nothing from the residuals.
        taken = float(np.sum(inverse * told))
        dof = max(left.residuals.size - taken, 1.0)
        variance = max(rest / dof, np.finfo(float).tiny)
        ends = last[np.append(starts[1:], len(last)) - 1]
        span = span_of[left.visit]
        told_by = variance, dof
        return cls(left, span, free, s, plain, h, inverse, pull, *told_by, ends, single is not None)

    def step(self, columns: list[int]) -> CourseFound | None:
        """Return the best sudden change of some parameters."""
        parts = self._parts(columns)
        s, cross, own = (np.cumsum(part, axis=0) for part in parts)
        T, M = self._efficient(s, cross, own)
        # A few wrong sights of what was hardly seen before are no change of it.
        told = np.cumsum(parts[2].any(axis=(1, 2)))
        inside = (told > MARGIN) & (told[-1] - told >= MARGIN)
        gains = np.full(len(T), -np.inf)
        gains[inside] = _quadratic(M[inside], T[inside])
        at = int(np.argmax(gains))
        size = np.linalg.lstsq(M[at], T[at], rcond=1e-9)[0]
        after = np.arange(len(T)) > at
        # The change that is told is that of later poses.
        return self._found(float(gains[at]), columns, -size, at, after.astype(float), drift=False)

    def drift(self, columns: list[int]) -> CourseFound | None:
        """Return the best steady change of some parameters, over the whole recording."""
        course = np.linspace(-0.5, 0.5, len(self.s))
        s, cross, own = self._parts(columns)
        s, cross = np.tensordot(course, s, 1), np.tensordot(course, cross, 1)
        M = np.tensordot(course**2, own, 1) - cross @ self.inverse @ cross.T
        T = s - cross @ self._step_of_all
        gain = float(_quadratic(M[None], T[None])[0])
        size = np.linalg.lstsq(M, T, rcond=1e-9)[0]
        return self._found(gain, columns, size, len(course) // 2, course, drift=True)

    def _parts(self, columns: list[int]) -> tuple[NDArray, NDArray, NDArray]:
        """Return scores of columns, and their information with what is free and each other."""
        h = self.h[:, columns]
        return self.s[:, columns], h[:, :, self.free], h[:, :, columns]

    @cached_property
    def _step_of_all(self) -> NDArray:
        """What the free parameters would still do. Shape (k,)."""
        return self.inverse @ (self.s.sum(axis=0)[self.free] + self.pull)

    def _efficient(self, s: NDArray, cross: NDArray, own: NDArray) -> tuple[NDArray, NDArray]:
        """Return scores and information of columns, what free parameters take taken off."""
        taken = cross @ self.inverse
        return s - cross @ self._step_of_all, own - taken @ np.swapaxes(cross, 1, 2)

    def _found(
        self,
        gain: float,
        columns: list[int],
        size: NDArray,
        at: int,
        course: NDArray,
        *,
        drift: bool,
    ) -> CourseFound | None:
        """Return what was found, with the sums' own scatter taken into account."""
        if not np.isfinite(gain) or gain <= 0.0:
            return None
        own = self.h[:, columns][:, :, columns]
        expected = course[:, None] * np.einsum("tij,j->ti", own, size)
        statistic = gain / self.variance / _likeness(self.s[:, columns] - expected)
        return CourseFound(statistic, size * self.left.scale[columns], course, at, drift)

    def improvement(self, columns: list[int], found: CourseFound) -> tuple[float, NDArray]:
        """Return the mean distance of rows over that with a change, and how large it is.

        What the residuals may depend on besides is taken off both. The size of the change is that
        which explains outliers, if they are part of it, or that which does not.
        """
        s, cross, own = self._parts(columns)
        cross = np.tensordot(found.course, cross, 1)
        left = np.tensordot(found.course**2, own, 1) - cross @ self.inverse @ cross.T
        rows = self._moved_by(columns)
        before, after, sizes = [], [], []
        for each, part in ((self.s, s), (self.plain, self.plain[:, columns])):
            fitted = each.sum(axis=0)[self.free] + self.pull
            before.append(self._mean_distance(self.inverse @ fitted, 0.0, rows))
            along = found.course @ part - cross @ self.inverse @ fitted
            size = np.linalg.lstsq(left, along, rcond=1e-9)[0]
            taken = self.inverse @ (fitted - cross.T @ size)
            changed = np.tensordot(self.left.jacobian[:, :, columns], size, 1)
            changed = found.course[self.span, None] * changed
            after.append(self._mean_distance(taken, changed, rows))
            sizes.append(size * self.left.scale[columns])
        ratio = float(min(before) / max(min(*before, *after), np.finfo(float).tiny))
        return ratio, sizes[int(np.argmin(after))]

    @cached_property
    def _free_columns(self) -> NDArray:
        """Derivatives by the free parameters. Shape (N, d, k)."""
        return self.left.jacobian.take(self.free, axis=2)

    def _moved_by(self, columns: list[int]) -> NDArray:
        """Return which rows are asked about a change. Boolean, shape (N,)."""
        if not self.by_row:
            return np.ones(len(self.left.residuals), dtype=bool)
        return np.asarray(self.left.jacobian[:, :, columns].any(axis=(1, 2)))

    def _mean_distance(self, taken: NDArray, changed: NDArray | float, rows: NDArray) -> float:
        """Return the mean residual when the free parameters take a step and something changed."""
        left = self.left.residuals - np.tensordot(self._free_columns, taken, 1) - changed
        return float(np.linalg.norm(left[rows], axis=1).mean())

    def chance(self, found: CourseFound, columns: list[int]) -> float:
        """Return how often noise alone makes the scores ask for as large a change.

        The change's own part of the squares R^2 = statistic / dof told the variance, too: of n
        degrees of freedom, -(n - k / 2 - 1) log(1 - R^2) is chi square of the k columns (Bartlett
        1938; exact of two). Of many degrees of freedom it is the statistic.
        """
        k = len(columns)
        share = min(found.statistic / self.dof, 1.0 - np.finfo(float).eps)
        return chi_square_tail(-(self.dof - 0.5 * k - 1.0) * float(np.log1p(-share)), k)

    def chance_of(self, ratio: float, columns: list[int]) -> float:
        """Return how often noise of poses makes residuals fall by a ratio after some sample.

        Where joint noise took the change for its own, scores are small and the residuals fall all
        the same: a share R^2 of the squares of n poses, by chance (1 - R^2)^(n/2), 1 / (1 - R^2)
        being the ratio squared (the tail of a beta distribution; Cochran 1934).
        """
        asked, each = self._moved_by(columns), self.left.residuals.shape[1]
        poses = (1.0 - len(self.free) / (each * max(asked.sum(), 1))) * len(
            np.unique(self.left.visit[asked])
        )
        return float(min(len(self.s) * max(ratio, 1.0) ** -max(poses, 0.0), 1.0))

    def when(self, found: CourseFound) -> str:
        """Say when."""
        if found.drift:
            return "during the recording"
        return f"after sample {int(self.last[found.span])}"


def sums_of_arm(
    observations: Observations, solved: ArmSolution, granted: NDArray, ways: NDArray
) -> ScoreSums:
    """Sum scores and information of an arm over spans of time, its outliers included.

    Args:
        observations: What was measured; samples are numbered in the order of time.
        solved: The arm, with its noise.
        granted: What the residuals may depend on besides. Shape (N, 3, m).
        ways: In which parameters may change together, the last columns. Shape (P, w).
    """
    assert solved.noise is not None
    # Frames of one visit share its joint noise: together they are one witness of time.
    visits = np.unique(observations.visit)
    chosen = visits[:: max(len(visits) // _MOST_VISITS, 1)]
    looked_at = np.isin(observations.visit, chosen)
    rows = observations.select(looked_at)
    everything = np.ones(len(rows), dtype=bool)
    linear = Linearised.at(rows, solved.parameters, everything, solved.noise)
    beside = [granted[looked_at], linear.jacobian @ ways]
    jacobian = np.concatenate([linear.jacobian, *beside], axis=2)
    groups = PoseGroups(rows.visit, everything, 3)
    whitening = PoseWhitening(groups, linear.by_angle, solved.noise)
    scale = 1.0 / np.maximum(np.sqrt(np.sum(jacobian**2, axis=(0, 1))), 1e-300)
    both = np.concatenate([linear.residuals[:, :, None], jacobian * scale], axis=2)
    free = [i for i, n in enumerate(linear.names) if n in solved.free]
    free = np.array([*free, *range(len(linear.names), jacobian.shape[2] - ways.shape[1])])
    order = np.argsort(rows.visit, kind="stable")
    ending = np.searchsorted(rows.visit, chosen, side="right", sorter=order) - 1
    last = np.maximum.accumulate(rows.sample[order])[ending]
    left = Left(linear.residuals, jacobian * scale, scale, groups.pose)
    return ScoreSums.of(whitening.root(groups.gather(both)), groups.visit, left, free, last)


def _sums_of_spans(
    U: NDArray, w: NDArray, full: NDArray, span: NDArray, spans: int
) -> tuple[NDArray, NDArray, NDArray]:
    """Return U'w, U'full and U'U of each span. Shapes (spans, P), (spans, P), (spans, P, P)."""
    order = np.argsort(span, kind="stable")
    starts = np.searchsorted(span[order], np.arange(1, spans))  # in some nothing was seen
    both = np.column_stack([w, full, U])[order]
    sums = [part[:, 2:].T @ part for part in np.split(both, starts)]
    found = np.stack(sums)
    return found[:, :, 0], found[:, :, 1], found[:, :, 2:]


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

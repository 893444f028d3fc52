"""Whether what was seen, or a joint's reading, is of another moment than the readings beside it.

What lags by a part t of the step between two samples misses by -t dp/dq (q_k - q_k-1). A wrong
gear, an eccentric disc, gravity and backlash miss by what depends on where a joint is and from
which side it came: a lag is one where it explains what these do not.

Sensors of one moment that is not that of the others, as cameras with one trigger, hold a body
together: one of them alone says nothing, and all of them that they lag a little. Lags of all are
asked as one, and those left out, one after the other, that are not sure beside the rest.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.diagnosis.changes_in_time import (
    FEWEST_VISITS,
    Change,
)
from nico_selfmodel.estimation.diagnosis.errors_of_joint import errors_beside_a_line
from nico_selfmodel.estimation.diagnosis.score_test import ScoreTest, Weighed

SURE, BESIDE = 28.4, 15.1
"""Chi square of one number that chance exceeds once in 1e7, `LARGEST_CHANCE`, and once in 1e4: of a
lag, and of a lag beside all that tells nothing of time."""
_LEAST_REDUNDANCY = 15
"""Numbers left over below which nothing is told."""
_ALIKE = 0.2
"""Part of the largest lag below which another one's is no lag."""
_ADVICE = "take both at one moment, or let the robot settle before each sample"


@dataclass(frozen=True, eq=False)
class Steps:
    """How joints moved about the moment of each row [rad or m]."""

    place: NDArray
    """Where they were. Shape (N, n)."""
    since: NDArray
    """From the sample before, by one number of a sample; 0 at the first. Shape (N, n)."""
    until: NDArray
    """To the sample after, alike. Shape (N, n)."""
    samples: int
    """How many samples there are."""

    @classmethod
    def of(cls, sample: NDArray, place: NDArray, moves: NDArray | None = None) -> "Steps":
        """Return them of rows.

        Args:
            sample: Number of each row's sample, in the order of time. Shape (N,).
            place: Displacements of joints. Shape (N, n).
            moves: By how much they went from one sample to the next; the difference of places if
                omitted. Shape (samples - 1, n).
        """
        samples, first, of = np.unique(sample, return_index=True, return_inverse=True)
        moves = np.diff(place[first], axis=0) if moves is None else moves
        # Of samples that are missing in between, the part that one of them would have had.
        steps = moves / np.diff(samples)[:, None]
        none = np.zeros((1, place.shape[1]))
        since, until = (np.vstack(both)[of.ravel()] for both in ((none, steps), (steps, none)))
        return cls(place, since, until, len(samples))

    def at(self, rows: NDArray) -> "Steps":
        """Return them of other rows, that are of the moments of these. Shape (M,)."""
        return Steps(self.place[rows], self.since[rows], self.until[rows], self.samples)

    @property
    def alone(self) -> Iterator[NDArray]:
        """What tells nothing of time: turns by where a joint is, and the side it came from."""
        q = self.place
        yield from (q, np.sin(q), np.cos(q), np.sin(2.0 * q), np.cos(2.0 * q))
        yield np.sign(self.since)


@dataclass(frozen=True, eq=False)
class _Suspect:
    """What may be of another moment."""

    name: str
    column: NDArray
    """What a whole step changes of the predictions. Shape (N, d, 1)."""
    lags: bool
    """Whether it lags; else it leads."""


def lag_in_time(
    steps: Steps,
    test: ScoreTest[Weighed],
    seen: Mapping[str, NDArray],
    joints: Mapping[str, int],
    *,
    granted: bool = True,
) -> Change | None:
    """Find what lags behind the readings or leads them, and which readings lag behind what is seen.

    Args:
        steps: How joints moved about each row.
        test: Residuals at the solution.
        seen: Rows that one sensor tells, by what is said of them in the plural. Boolean, (N,) each.
        joints: Columns of joints that are read, by name.
        granted: Whether a lag must explain what joints' places and sides do not.

    Returns:
        The lags, or None where there is none.
    """
    found = _found(steps, test, seen, joints, granted=granted)
    return _change(found, test, list(seen)) if found else None


def _found(
    steps: Steps,
    test: ScoreTest[Weighed],
    seen: Mapping[str, NDArray],
    joints: Mapping[str, int],
    *,
    granted: bool,
) -> list[_Suspect]:
    """Return what lags, what explains most first; nothing where too little was recorded."""
    if steps.samples < FEWEST_VISITS:
        return []
    by_angle = test.linear.by_angle
    suspects = list(_suspects(steps, by_angle, seen, joints))
    columns, patterns = _columns(suspects), None
    found = late_together(test, [one for one in suspects if one.name in seen])
    if found:
        patterns = _patterns(steps, by_angle) if granted else by_angle[:, :, :0]
        if not they_explain(test, test.beside(patterns), found, likelier(test, columns)):
            found = []
    while len(found) <= len(seen):
        plain = test.beside(_columns(found)) if found else test
        late = _late(plain, columns, SURE)
        if not late.any():
            break
        if patterns is None:
            patterns = _patterns(steps, by_angle) if granted else by_angle[:, :, :0]
        beside = plain.beside(patterns)
        late &= _late(beside, columns, BESIDE)
        if beside.redundancy < _LEAST_REDUNDANCY or not late.any():
            break
        gain = beside.one_by_one(columns)[0]
        found.append(suspects[int(np.argmax(np.where(late, gain, 0.0)))])
    return found


def late_together(test: ScoreTest[Weighed], suspects: Sequence[_Suspect]) -> list[_Suspect]:
    """Return several sensors, but not all, that lag or lead, each surely so beside the others.

    Args:
        test: Residuals at the solution.
        suspects: Sensors, each once lagging and once leading.
    """
    found, most = list[_Suspect](), 0.0
    for lags in (True, False):
        kept = [one for one in suspects if one.lags == lags]
        count, gain, least = len(kept), 0.0, -np.inf
        while len(kept) > 1 and least <= SURE:
            score = test.of(_columns(kept))
            sure = np.where(score.values > 0.0, (score.values / score.sigma) ** 2, 0.0)
            gain, least = score.gain, float(sure.min())
            if least <= SURE:
                del kept[int(np.argmin(sure))]
        if 1 < len(kept) < count and gain > most:
            found, most = kept, gain
    return found


def they_explain(
    test: ScoreTest[Weighed],
    beside: ScoreTest[Weighed],
    found: Sequence[_Suspect],
    singly: tuple[NDArray, NDArray],
) -> bool:
    """Return whether several explain more than any one does, and than what tells nothing of time.

    Args:
        test: Residuals at the solution.
        beside: The same beside what tells nothing of time.
        found: Suspects.
        singly: By how much each suspect makes residuals likelier, and its number. Shapes (m,).
    """
    likely = [_likelihood(one, one.of(_columns(found)).gain) for one in (test, beside)]
    best = float(np.max(singly[0], where=singly[1] > 0.0, initial=0.0))
    enough = beside.redundancy >= _LEAST_REDUNDANCY
    return bool(enough and likely[0] > best + (len(found) - 1) * SURE and likely[1] > BESIDE)


def _columns(suspects: Sequence[_Suspect]) -> NDArray:
    """Return what they change of the predictions. Shape (N, d, m)."""
    return np.concatenate([one.column for one in suspects], axis=2)


def _likelihood(test: ScoreTest[Weighed], gain: NDArray | float) -> NDArray:
    """Return by how much gains make residuals likelier: see `likelier`."""
    part = np.minimum(gain / test.redundancy, 1.0 - 1e-12)
    return -test.redundancy * np.log1p(-part)


def lag_taken_for_noise(
    steps: Steps, test: ScoreTest[Weighed], joint: str, j: int, shown: NDArray, rows: NDArray
) -> Change | None:
    """Find whether errors of a joint that is read worse than others are those of another moment.

    See `diagnosis.errors_of_joint`.

    Args:
        steps: How joints moved about each row.
        test: Residuals at the solution.
        joint: Name of the joint.
        j: Its column.
        shown: How far it was from its readings, by sample that shows it [rad or m]. Shape (M,).
        rows: A row of each such sample. Shape (M,).

    Returns:
        The lag, or None where there is none.
    """
    at = steps.at(rows)
    own = Steps(at.place[:, [j]], at.since[:, [j]], at.until[:, [j]], len(rows))
    errors = errors_beside_a_line(shown, own.place)
    found = _found(own, errors, {}, {joint: 0}, granted=True)
    of_all = _suspects(steps, test.linear.by_angle, {}, {joint: j})
    late = [one for one in of_all if any(lag.lags == one.lags for lag in found)]
    return _change(late, test, []) if late else None


def _change(found: list[_Suspect], test: ScoreTest[Weighed], seen: list[str]) -> Change:
    score = test.of(_columns(found), of_moved=True)
    return Change(_words(found, score.values, seen), score.improvement)


def likelier(test: ScoreTest[Weighed], columns: NDArray) -> tuple[NDArray, NDArray]:
    """Return by how much columns make residuals likelier, and their numbers. Shapes (m,).

    Of N numbers left a column explains the part R^2; twice the logarithm of its likelihood, with
    the noise that it leaves, is -N log(1 - R^2). Of few numbers a score is N R^2 at most.
    """
    gain, values = test.one_by_one(columns)
    return _likelihood(test, gain), values


def _late(test: ScoreTest[Weighed], columns: NDArray, sure: float) -> NDArray:
    """Return which columns are likelier than that, the right way round. Shape (m,)."""
    gain, values = likelier(test, columns)
    return (gain > sure) & (values > 0.0)


def _patterns(steps: Steps, by_angle: NDArray) -> NDArray:
    """Return what tells nothing of time, as changes of the predictions. Shape (N, d, m)."""
    out = np.concatenate([by_angle * turns[:, None] for turns in steps.alone], axis=2)
    return out[:, :, out.any(axis=(0, 1))]


def _suspects(
    steps: Steps, by_angle: NDArray, seen: Mapping[str, NDArray], joints: Mapping[str, int]
) -> Iterator[_Suspect]:
    everywhere = np.ones(len(by_angle), dtype=bool)
    for move, lags in ((steps.since, True), (steps.until, False)):
        sign = 1.0 if lags else -1.0
        moved = np.einsum("ndj,nj->nd", by_angle, move)[:, :, None]
        for name, rows in {**seen, "": everywhere}.items():
            if name or len(seen) > 1:
                yield _Suspect(name, -sign * moved * rows[:, None, None], lags)
        for name, j in joints.items():
            column = by_angle[:, :, j, None] * move[:, j, None, None]
            yield _Suspect(f"the readings of {name!r}", sign * column, lags)


def _words(found: list[_Suspect], values: NDArray, seen: list[str]) -> str:
    """Say what lags by how much; what is said of all sensors is added to what is said of one."""
    of_all = "what all sensors saw"
    signed = [(one.name, v if one.lags else -v) for one, v in zip(found, values, strict=True)]
    sizes: dict[str, float] = {}
    for name, size in signed:
        sizes[name or of_all] = sizes.get(name or of_all, 0.0) + float(size)
    if of_all in sizes and len(sizes) > 1 and any(name in sizes for name in seen):
        common = sizes.pop(of_all)
        sizes |= {name: sizes.get(name, 0.0) + common for name in seen}
    largest = max(map(abs, sizes.values()))
    said = []
    for name, size in sizes.items():
        if abs(size) < _ALIKE * largest:
            continue
        many = not name.startswith("what ")
        verb = ("lag behind" if many else "lags behind") if size > 0.0 else "lead"
        verb = verb if many or size > 0.0 else "leads"
        other = "what was seen" if name.startswith("the readings of") else "the readings"
        said.append(
            f"{name} {verb} {other} by about {abs(size):.2g} of the time between two samples"
        )
    return f"{'; '.join(said)}: {_ADVICE}"

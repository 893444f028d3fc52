"""What may be wrong with the readings of an arm, each mended in one way, and where to start."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from itertools import groupby, islice, pairwise

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.diagnosis.mistaken_units import OTHER_UNIT, mistaken_units
from nico_selfmodel.estimation.initialization.axis_search import first_starts_of_each
from nico_selfmodel.estimation.initialization.start_search import few_rows
from nico_selfmodel.estimation.observations.arm_estimate import ArmEstimate
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.observations.outlier_words import stood_in_a_row
from nico_selfmodel.names import listed

_STARTS = 10
_STARTS_AT_A_GAP = 30
"""A gap in the middle of a turn is rarely there by chance."""
_AT_ONCE, _START_ROWS = 30, 60
"""Starts that are worked out together, in a third of the time of five at once, and on how many
rows: what they leave is asked of more."""
TURNED_ABOUT = "joints are told from the hand to the base"
"""How it is said that joints stand in the opposite order."""
_FEWEST_TURNED_ABOUT = 3
"""Joints of which more are not turned about by exchanging two."""
_LEAST_GAP = 0.1
"""Of a turn: readings that leave out less are spread over the whole turn."""


class Worth(Enum):
    """What a misfit is worth looking for."""

    GAPS = "readings that leave out a gap"
    NEIGHBOURS = "these, and neighbouring columns that are exchanged, or sums of each other"
    EVERYTHING = "all there is"


@dataclass(frozen=True)
class LateReadings:
    """Readings that are of another sample than what was seen beside them."""

    joints: tuple[str, ...]
    """Whose; empty where they are all joints'."""
    shift: int
    """Whose readings a point fits: of the sample before (-1) or after (+1) its own, or of more."""

    def __str__(self) -> str:
        """Say it in words."""
        words = "before" if self.shift < 0 else "after"
        which = "the sample" if abs(self.shift) == 1 else f"{abs(self.shift)} samples"
        of = f" of {listed(self.joints)}" if self.joints else ""
        theirs = "theirs" if self.joints else "the readings"
        return (
            f"the readings{of} lag: each point fits {theirs} of {which} {words} its own; pair them "
            "by the time they were taken"
        )


@dataclass(frozen=True, eq=False)
class Suspicion:
    """Readings mended in one way."""

    words: str
    observations: Observations
    gear_pinned: NDArray
    gears_in_question: bool = False
    starts: int = _STARTS
    late: LateReadings | None = None
    """What is of another sample in them."""

    @cached_property
    def few(self) -> Observations:
        """As many of the readings as tell whether they fit."""
        return few_rows(self.observations, 0)

    @cached_property
    def fewer(self) -> Observations:
        """As many as starts are worked out from."""
        return few_rows(self.few, 0, _START_ROWS)

    def zero(self, zero: NDArray) -> NDArray:
        """Return the angles of a pose near the zero configuration. Shape (n,)."""
        angles = self.few.angles
        return np.asarray(angles[np.argmin(np.abs(angles - zero).sum(axis=1))])


def suspicions_of(
    observations: Observations, gear_pinned: NDArray, held: NDArray, worth: Worth
) -> Iterator[Suspicion]:
    """Yield what may be wrong with the readings, as far as it is worth a search.

    Args:
        observations: What was measured.
        gear_pinned: Gears that are held. Shape (n,).
        held: Those that a unit tells. Shape (n,).
        worth: What is worth a search.
    """
    unwrapped, joints = unwrapped_readings(observations)
    if joints:
        yield Suspicion(
            _wrap_words(observations, unwrapped, joints),
            replace(observations, angles=unwrapped),
            gear_pinned,
            starts=_STARTS_AT_A_GAP,
        )
    if worth is Worth.EVERYTHING:
        yield from _standing(observations, gear_pinned)
        yield from _other_units(observations, gear_pinned, held)
        yield from lagging(observations, gear_pinned, (-1, 1))
    if worth is not Worth.GAPS:
        few = few_rows(observations, 0)
        yield from _exchanged(few, gear_pinned, all_pairs=worth is Worth.EVERYTHING)
        yield from _mixed(few, gear_pinned)
    if worth is not Worth.EVERYTHING:
        return
    if held.any():
        yield Suspicion(
            "the encoders do not read joint angles: the data ask for the gears ",
            observations,
            gear_pinned & ~held,
            gears_in_question=True,
        )
    yield from lagging(observations, gear_pinned, (-2, 2))


def lagging(
    observations: Observations,
    gear_pinned: NDArray,
    shifts: Iterable[int],
    joints: Sequence[int] = (),
) -> Iterator[Suspicion]:
    """Yield readings of samples before or after their own.

    Args:
        observations: What was measured.
        gear_pinned: Gears that are held. Shape (n,).
        shifts: By how many samples, before (-) or after (+).
        joints: Whose readings; of all if omitted.
    """
    late = [*joints] or [*range(len(observations.joints))]
    for shift in shifts:
        shifted = _shifted(observations, shift, late)
        if shifted is not None:
            cause = LateReadings(tuple(observations.joints[i] for i in joints), shift)
            yield Suspicion(str(cause), shifted, gear_pinned, late=cause)


def _standing(observations: Observations, gear_pinned: NDArray) -> Iterator[Suspicion]:
    """Yield what is left without the samples in a row in which one encoder alone stands still."""
    sample, first = np.unique(observations.sample, return_index=True)
    units = observations.units
    read = observations.angles[first] / units.radians_per_unit
    found = stood_in_a_row(observations.joints, units.unit, sample, read)
    if found is None:
        return
    _, stood, words = found
    moving = ~np.isin(observations.sample, stood)
    if len(np.unique(observations.marker[moving])) == len(observations.markers):
        yield Suspicion(words, observations.select(moving), gear_pinned)


def _exchanged(
    observations: Observations, gear_pinned: NDArray, *, all_pairs: bool
) -> Iterator[Suspicion]:
    """Yield readings with two joints' columns exchanged, neighbours first, or all turned about."""
    joints, n = observations.joints, len(observations.joints)
    pairs = [(i, i + step) for step in range(1, n if all_pairs else 2) for i in range(n - step)]
    orders = []
    for i, j in pairs:
        order = np.arange(n)
        order[[i, j]] = j, i
        orders.append((f"the readings of {joints[i]} and {joints[j]} are exchanged", order))
    if all_pairs and n > _FEWEST_TURNED_ABOUT:
        words = f"{TURNED_ABOUT}, {joints[0]} first: name the base's first"
        orders.insert(n - 1, (words, np.arange(n)[::-1]))
    for words, order in orders:
        mended = replace(observations, angles=observations.angles[:, order])
        yield Suspicion(words, mended, gear_pinned[order])


def _mixed(observations: Observations, gear_pinned: NDArray) -> Iterator[Suspicion]:
    """Yield readings of motors that move two neighbouring joints: differentials, coupled drives."""
    for i, (first, second) in enumerate(pairwise(observations.joints)):
        a, b = observations.angles[:, i], observations.angles[:, i + 1]
        half, halves = "half the sum", "half the difference"
        both = f"{first} and {second} turn by"
        of = "of what is read of both, as of a differential"
        ways = {
            f"{both} {half} and {halves} {of}": (0.5 * (a + b), 0.5 * (a - b)),
            f"{both} {halves} and {half} {of}": (0.5 * (a - b), 0.5 * (a + b)),
            f"{second} turns by the sum of what is read of {first} and of it": (a, a + b),
            f"{second} turns by what is read of it less that of {first}": (a, b - a),
        }
        pinned = gear_pinned.copy()
        pinned[i : i + 2] = pinned[i : i + 2].all()
        for words, mended in ways.items():
            angles = observations.angles.copy()
            angles[:, i], angles[:, i + 1] = mended
            told = f"{words}: record these sums as readings (`import csv` makes them of columns)"
            yield Suspicion(told, replace(observations, angles=angles), pinned)


def _other_units(
    observations: Observations, gear_pinned: NDArray, held: NDArray
) -> Iterator[Suspicion]:
    """Yield readings with the units mended of joints whose spans are 57 times off."""
    units = observations.units.unit
    factors = mistaken_units(observations.angles, units, held)
    mistaken = np.flatnonzero(factors != 1.0)
    if not len(mistaken):
        return
    said = [
        f"{observations.joints[i]} is read in {OTHER_UNIT[units[i]][0]}, not in {units[i]} as its "
        "encoder_unit states"
        for i in mistaken
    ]
    if len(said) == len(units):
        said = [f"all joints are read in {OTHER_UNIT[units[0]][0]}, not in {units[0]} as stated"]
    words = ", ".join(said)
    yield Suspicion(
        f"{words}: correct encoder_unit",
        replace(observations, angles=observations.angles * factors),
        gear_pinned,
    )


def with_starts(
    suspicions: Iterable[Suspicion], gear_known: NDArray, zero: NDArray, worst: float
) -> Iterator[tuple[Suspicion, list[ArmEstimate]]]:
    """Yield suspicions, each with its starts; those of the same points are worked out at once.

    Args:
        suspicions: What may be wrong.
        gear_known: Joints said to be read in rad or deg. Shape (n,).
        zero: Encoder angles of the zero configuration [rad]. Shape (n,).
        worst: Standard deviation of a coordinate above which a start is of no use [m].
    """

    def alike(one: Suspicion) -> tuple[int, bytes, bytes]:
        return one.starts, (one.gear_pinned & gear_known).tobytes(), one.fewer.p_WH.tobytes()

    for (starts, _, _), group in groupby(suspicions, alike):
        while together := list(islice(group, max(_AT_ONCE // starts, 1))):
            found = first_starts_of_each(
                [one.fewer for one in together],
                together[0].gear_pinned & gear_known,
                [one.zero(zero) for one in together],
                seed=0,
                each=starts,
                worst=worst,
            )
            yield from zip(together, found, strict=True)


def unwrapped_readings(observations: Observations) -> tuple[NDArray, list[int]]:
    """Undo a jump of one turn of the encoder in the middle of a joint's range.

    Readings that were folded into one turn leave out an arc in their middle and reach to both ends
    of the turn. Those below the widest gap are carried on by one turn.

    Returns:
        Encoder angles [rad], shape (N, n), and the joints that were changed.
    """
    angles, turn = observations.angles.copy(), 2.0 * np.pi
    changed = []
    for i in range(angles.shape[1]):
        values = np.unique(angles[:, i])
        span = values[-1] - values[0]
        if len(values) < 3 or span > turn * (1.0 + 1e-9):
            continue
        gaps = np.diff(values)
        widest = int(np.argmax(gaps))
        if gaps[widest] < max(turn - span, _LEAST_GAP * turn):
            continue
        angles[angles[:, i] <= values[widest], i] += turn
        changed.append(i)
    return angles, changed


def _wrap_words(observations: Observations, unwrapped: NDArray, joints: list[int]) -> str:
    words = []
    for i in joints:
        unit = observations.units.radians_per_unit[i]
        moved = unwrapped[:, i] != observations.angles[:, i]
        low, high = observations.angles[moved, i], observations.angles[~moved, i]
        # A stated sign of -1 makes the larger angle the smaller reading.
        side = "below" if unit > 0.0 else "above"
        middle = 0.5 * (low.max() + high.min()) / unit
        words.append(
            f"add {2.0 * np.pi / unit:+.6g} to readings of {observations.joints[i]} {side} "
            f"{middle:.4g} {observations.units.unit[i]}"
        )
    return (
        "encoders jump by a whole turn in the middle of their range: unwrap them "
        f"({', '.join(words)}), here and in all readings to come"
    )


def _shifted(observations: Observations, shift: int, joints: list[int]) -> Observations | None:
    """Pair each point with joints' readings of the sample before (-1) or after (+1) its own."""
    first = dict(zip(observations.sample.tolist(), range(len(observations)), strict=True))
    partner = [first.get(s + shift, -1) for s in observations.sample.tolist()]
    has = np.array(partner) >= 0
    unknowns = 5 * len(observations.joints) + 3 * len(observations.markers)
    if 3 * has.sum() < 2 * unknowns or len(np.unique(observations.marker[has])) < len(
        observations.markers
    ):
        return None
    kept = observations.select(has)
    angles = kept.angles.copy()
    angles[:, joints] = observations.angles[np.array(partner)[has]][:, joints]
    return replace(kept, angles=angles)

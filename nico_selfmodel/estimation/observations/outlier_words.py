"""Points that contradict the rest: which they are, and what they have in common."""

from collections.abc import Sequence
from math import comb

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.results.verdict import outliers_are_many

_SHOWN = 6
"""Samples that are listed by number."""
_FEWEST = 5
"""Poses in a row that make a standing encoder no accident."""
_RIGHTLY = 0.4
"""And as many of these poses at most may be right: one that is frozen is so by chance, now and
then."""
_IN_A_ROW = 8
"""Samples in a row with one reading from which on the encoder stands, where no other does so."""
_MOST_OF_MARKER = 0.3
"""A marker with so many outliers does not move with the others, or moved on the hand."""
_NEARER = 2.0
"""Times that an observation must be nearer to another marker to be of that one."""
_FEWEST_EXCHANGED, _MOST_MENDED = 3, 0.5
"""Samples with two names exchanged, and share of the outliers of the two that are so, from which on
it is no accident."""
_RARE = 1.0 / 2000.0
"""Chance of a held-out share of outliers beyond which it is no accident ..."""
_RARE_OF_MANY = 0.01
"""... and of one that is large: the training may have as many, and be told so itself."""
EXCHANGED_CURE = "correct the labels, or what tells the two apart"
"""What to do where two markers' names are exchanged."""


def describe_outliers(observations: Observations, outliers: NDArray) -> str:
    """Name the samples of outliers, and an encoder that stands still in them.

    Args:
        outliers: Rows that are outliers. Boolean, shape (N,).

    Returns:
        For example "samples 11 to 30, in all of which the encoder of elbow stands at 0.31 rad".
    """
    samples = np.unique(observations.sample[outliers])
    # Frozen readings repeat in inlier poses only where the arm really was there.
    units, sample = observations.units, observations.sample
    readings = observations.angles / units.radians_per_unit
    stuck = stuck_encoder(observations.joints, units.unit, readings, sample, outliers)
    if samples.size > 1 and stuck:
        return f"samples {samples[0]} to {samples[-1]}, {stuck}"
    return name_samples(samples)


def name_samples(samples: NDArray) -> str:
    """Return words for samples: the first ones by number, a run of them by its ends.

    Args:
        samples: Their numbers, ascending, at least one. Shape (n,).
    """
    if samples.size == 1:
        return f"sample {samples[0]}"
    if samples[-1] - samples[0] == samples.size - 1:
        return f"samples {samples[0]} to {samples[-1]}"
    more = samples.size - _SHOWN
    words = "samples " + ", ".join(str(s) for s in samples[:_SHOWN].tolist())
    return words + (f" and {more} more" if more > 0 else "")


def stuck_encoder(
    joints: Sequence[str],
    units: Sequence[str],
    readings: NDArray,
    sample: NDArray,
    outliers: NDArray,
) -> str:
    """Say which encoder reads the same in most outliers though the others move, or nothing.

    Args:
        joints: Names, n of them.
        readings: Of each observation. Shape (N, n).
        sample: Sample of each. Shape (N,).
        outliers: Observations that nothing explains. Boolean, shape (N,).
    """
    _, first = np.unique(sample[outliers], return_index=True)
    off = readings[outliers][first]
    if len(off) < _FEWEST:
        return ""
    moving = np.ptp(off, axis=0) > 0.0
    for i, joint in enumerate(joints):
        values, counts = np.unique(off[:, i], return_counts=True)
        same, value = int(counts.max()), values[np.argmax(counts)]
        alone = np.delete(moving, i).any() or len(joints) == 1
        if same < max(_FEWEST, 0.7 * len(off)) or not alone or np.isnan(value):
            continue  # of a whole pose nothing is read
        inliers = np.unique(sample[(readings[:, i] == value) & ~outliers]).size
        if inliers > _RIGHTLY * same:
            continue  # the joint often stands there
        return (
            f"in {same} of which the encoder of {joint} stands at {value:.6g} {units[i]} while the "
            "hand moves: it was frozen, or not read"
        )
    return ""


def stood_in_a_row(
    joints: Sequence[str], units: Sequence[str], sample: NDArray, readings: NDArray
) -> tuple[str, NDArray, str] | None:
    """Find the encoder that alone reads the same in many samples in a row while others move.

    Args:
        joints: Names, n of them.
        units: In which they are read.
        sample: Numbers of P samples. Shape (P,).
        readings: Of each. Shape (P, n).

    Returns:
        Its joint, the samples of its longest such run, and words; None where no encoder stands so,
        or more than one does.
    """
    order, found = np.argsort(sample, kind="stable"), list[tuple[int, NDArray]]()
    for i, read in enumerate(readings[order].T):
        ends = np.flatnonzero(np.append(np.diff(read) != 0.0, True))
        runs = np.diff(ends, prepend=-1)
        if runs.max(initial=0) >= _IN_A_ROW:
            last = int(ends[np.argmax(runs)])
            found.append((i, order[last - int(runs.max()) + 1 : last + 1]))
    if len(found) != 1:
        return None
    i, span = found[0]
    if not np.delete(np.ptp(readings[span], axis=0) > 0.0, i).any():
        return None
    words = (
        f"the encoder of {joints[i]!r} stands at {readings[span[0], i]:.6g} {units[i]} from "
        f"sample {sample[span[0]]} to {sample[span[-1]]} while others move, as no other ever does: "
        "it was frozen, or not read"
    )
    return joints[i], sample[span], words


def foreign_markers(observations: Observations, outliers: NDArray) -> list[str]:
    """Say which tracked points do not move with the others.

    Args:
        outliers: Rows that are outliers. Boolean, shape (N,).

    Returns:
        A sentence for each marker most of whose points are outliers.
    """
    found = []
    for k, marker in enumerate(observations.markers):
        own = observations.marker == k
        count, total = int(np.sum(outliers & own)), int(own.sum())
        if len(observations.markers) > 1 and count >= 3 and count >= _MOST_OF_MARKER * total:
            found.append(
                f"{count} of {total} points of marker {marker} contradict the other markers: it is "
                "not fixed to the last link, moved on it, or its label is not always on the same "
                "point; leave it out"
            )
    return found


def exchanged_names(
    names: Sequence[str],
    marker: NDArray,
    sample: NDArray,
    outliers: NDArray,
    told_as: NDArray,
) -> list[str]:
    """Say which markers' names are exchanged in part of a recording.

    Two names are where most outliers of the two would be none under the other's.

    Args:
        names: Of the M markers.
        marker: Which of them each observation is said to be of. Shape (N,).
        sample: Sample of each observation. Shape (N,).
        outliers: Observations that nothing explains. Boolean, shape (N,).
        told_as: How far each would be off were it of each marker, over what is no outlier leaves at
            most; nan where nobody asks. Shape (N, M).

    Returns:
        A sentence for each pair.
    """
    rows = np.flatnonzero(outliers)
    off = np.where(np.isnan(told_as[rows]), np.inf, told_as[rows])
    likeliest = np.argmin(off, axis=1)
    own, least = off[np.arange(len(rows)), marker[rows]], off.min(axis=1, initial=np.inf)
    fits = (likeliest != marker[rows]) & (least <= 1.0) & (_NEARER * least < own)
    pairs = np.sort(np.column_stack([marker[rows], likeliest]), axis=1)
    found = []
    for a, b in np.unique(pairs[fits], axis=0).tolist():
        both = np.isin(marker[rows], (a, b))
        mended = fits & (pairs == (a, b)).all(axis=1)
        where = np.unique(sample[rows[mended]])
        if len(where) < _FEWEST_EXCHANGED or mended.sum() < _MOST_MENDED * both.sum():
            continue
        seen = len(np.unique(sample[np.isin(marker, (a, b))]))
        pair = " and ".join(sorted(str(names[i]) for i in (a, b)))
        found.append(
            f"markers {pair} are exchanged in {len(where)} of {seen} samples "
            f"({name_samples(where)}): their points fit under each other's names; "
            f"{EXCHANGED_CURE}"
        )
    return found


def held_out_apart(
    mean: str, where: str, which: str, outliers: NDArray, things: str, worst: str, with_all: str
) -> str:
    """State a held-out error without what no noise explains, and with it.

    Args:
        mean: Without, with its unit.
        where: "18 poses that were held out".
        which: Samples of the outliers.
        outliers: Of all that was held out. Boolean, shape (N,).
        things: What these are: "points".
        worst: How far off outliers are.
        with_all: The mean with them.
    """
    kept = int(np.sum(~outliers))
    return (
        f"{mean} mean error on {where}, {kept} of {len(outliers)} {things}; what is left is up to "
        f"{worst} off, which no noise explains ({which}): {with_all} with it"
    )


def more_held_out_outliers(
    outliers: NDArray,
    things: str,
    which: str,
    poses: tuple[int, int],
    before: tuple[int, int],
    cause: str,
) -> str | None:
    """Say when held-out poses have outliers far more often than training poses.

    Args:
        outliers: Of all that was held out. Boolean, shape (N,).
        things: What these are: "points".
        which: Samples of the outliers.
        poses: How many held-out poses have an outlier, and how many there are.
        before: The same of the training.
        cause: What it may come of.
    """
    (found, n), (had, m) = poses, before
    rare = _RARE if outliers_are_many(outliers) is None else _RARE_OF_MANY
    if not found or chance_of_more(found, n, had, m) > rare:
        return None
    return (
        f"{outliers.sum()} of {len(outliers)} held-out {things} are further off than model and "
        f"noise explain ({which}), in {found} of {n} poses, against {had} of {m} training poses: "
        f"{cause}"
    )


def chance_of_more(found: int, n: int, before: int, m: int) -> float:
    """Return the chance that so many outliers fall into one of two samples (Fisher's exact test).

    Args:
        found: Outliers among the n points in question.
        n: Number of these points.
        before: Outliers among the m points to compare with.
        m: Number of those.

    Returns:
        Probability of `found` or more of all outliers among the n, were both of one kind.
    """
    total = found + before
    ways = sum(comb(n, k) * comb(m, total - k) for k in range(found, min(n, total) + 1))
    return ways / comb(n + m, total)


def equal_readings(samples: int, poses: int) -> list[str]:
    """Say how many poses samples are of, where some have equal readings."""
    if poses == samples:
        return []
    return [
        f"{samples} samples are of {poses} poses: samples with equal readings count as one pose, "
        "in splits as in sigmas"
    ]

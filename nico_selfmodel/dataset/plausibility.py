"""Data that are well formed but can hardly be what they say: units, sweeps that did not move."""

import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.columns import PIXEL_COLUMNS, POINT_COLUMNS
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import HOME, JointInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.names import listed

MAX_SPREAD_M = 20.0
"""Points that lie further apart were hardly measured in metres, unless by a crane [m] ..."""
_NO_MACHINE_M = 100.0
"""... and those that lie even further apart were not: as millimetres they suit any arm [m]."""
_MIN_SPREAD_M = 5e-3
"""Points that stay within it were hardly measured in metres, unless of a micromanipulator [m]: in
metres taken for millimetres they suit robots that are 5 m wide."""
MAX_TURN_RAD = 4.0 * np.pi
"""A joint that turned further was hardly read in radians [rad]."""
_FEWEST_IN_DEGREES = 2
"""Joints read beyond two turns at once, and samples where they are, that are no slip of a pen."""
_BEYOND = 0.05
"""Part of a joint's range by which readings may lie beyond its ends without a word."""
_MOST_OUTSIDE = 0.1
"""Share of pixels that may lie outside their images without a word."""
_FEWEST_NOTHINGS, _FEWEST_PLACES = 2, 10
"""Rows that are exactly 0, among so many others, from which on these are what a sensor writes that
saw nothing."""
_COPIES, _FEWEST_COPIES = 0.25, 10
"""Share and number of rows that stand there again from which on these are copies: a robot that
repeats itself without noise comes back to a pose now and then."""


def check_as_read(dataset: Dataset, place: str) -> None:
    """Refuse data that were read but cannot be what they say; warn of what they hardly are.

    Args:
        place: The file, for messages.

    Raises:
        DataError: As `_check_plausible`, or if many rows are copies, or places exactly 0.

    Warns:
        UserWarning: As `_warn_of_units`, `warn_of_stops`, `warn_of_twins`, `warn_of_outside`.
    """
    _check_plausible(dataset, place)
    ends = [(joint.name, joint.lower, joint.upper) for joint in dataset.joints]
    warn_of_stops(ends, dataset.encoders, place)
    warn_of_twins([joint.name for joint in dataset.joints], dataset.encoders, place)
    measured = np.hstack([dataset.p_WH_measured, dataset.pixels])
    seen = np.isfinite(measured).any(axis=1)
    for own in np.split(dataset.pixels, 2, axis=1):
        warn_of_outside(own, dataset.image_size, place)
    refuse_copies(dataset.sample[seen], np.hstack([dataset.encoders, measured])[seen], place)
    refuse_nothings(dataset.sample, dataset.p_WH_measured, f"{place}: {', '.join(POINT_COLUMNS)}")
    for side in (slice(0, 2), slice(2, 4)):
        columns = f"{place}: {', '.join(PIXEL_COLUMNS[side])}"
        refuse_nothings(dataset.sample, dataset.pixels[:, side], columns)
    _warn_of_units(dataset, place)


def warn_of_stops(
    ends: Sequence[tuple[str, float | None, float | None]], readings: NDArray, place: str
) -> None:
    """Warn of readings beyond the ends that a joint is said to have: either is wrong.

    Args:
        ends: Name of each joint, and its lower and upper end, None where that is not known.
        readings: Shape (N, n).
        place: The file, for the message.

    Warns:
        UserWarning: If some lie beyond by more than a twentieth of the range.
    """
    beyond = []
    for (name, lower, upper), own in zip(ends, readings.T, strict=True):
        if lower is None or upper is None or not np.isfinite(own).any():
            continue
        least, most, spare = np.nanmin(own), np.nanmax(own), _BEYOND * (upper - lower)
        # Of a joint that nobody moves 0 may stand for anything.
        if least < most and (least < lower - spare or most > upper + spare):
            told = f"{least:.5g} to {most:.5g}, its lower and upper are {lower:.5g} and {upper:.5g}"
            beyond.append(f"{name} reads {told}")
    if beyond:
        warnings.warn(
            f"{place}: {'; '.join(beyond)}: correct what is wrong, the ends or the readings",
            stacklevel=4,
        )


def warn_of_twins(names: Sequence[str], readings: NDArray, place: str) -> None:
    """Warn of joints that moved and read the same throughout: one column is a copy of another.

    Args:
        names: Of the joints.
        readings: Shape (N, n).
        place: The file, for the message.

    Warns:
        UserWarning: If there are two such joints.
    """
    own = readings[np.isfinite(readings).all(axis=1)]
    enough = len(own) >= _FEWEST_PLACES
    moved = np.flatnonzero(np.ptp(own, axis=0) > 0.0).tolist() if enough else []
    for k, joint in enumerate(moved):
        for other in moved[:k]:
            if np.array_equal(own[:, joint], own[:, other]):
                warnings.warn(
                    f"{place}: joints {names[other]!r} and {names[joint]!r} read the same in all "
                    f"{len(own)} rows: is one of the columns a copy of the other?",
                    stacklevel=4,
                )


def refuse_nothings(sample: NDArray, values: NDArray, what: str) -> None:
    """Refuse places of which some are exactly 0: noise never is, but nothing seen is written so.

    Args:
        sample: Number of each row's sample. Shape (N,).
        values: What was measured, nan where nothing was. Shape (N, k).
        what: Of what it is, for the message.

    Raises:
        DataError: If two of them or more are, and ten or more are not.
    """
    nothing = (values == 0.0).all(axis=1)
    count = int(nothing.sum())
    others = int(np.isfinite(values).all(axis=1).sum()) - count
    if count < _FEWEST_NOTHINGS or others < _FEWEST_PLACES:
        return
    raise DataError(
        f"{what} are exactly 0 in {count} rows (the first of sample {sample[nothing][0]}): leave "
        "these cells empty, or the rows out, where nothing was seen"
    )


def refuse_copies(sample: NDArray, rows: NDArray, place: str) -> None:
    """Refuse data of which many rows stand there again, to the last digit, at other samples.

    Copies would count as evidence, and be held out of what has their twins. Rows of samples that
    follow each other are none: the robot stands still.

    Args:
        sample: Number of each row's sample. Shape (N,).
        rows: All numbers of each, nan where there is none. Shape (N, k).
        place: The file, for the message.

    Raises:
        DataError: If a quarter of them and more do, ten at least.
    """
    # Sums by weights without a common measure are equal only where all numbers are.
    weights = np.sqrt(2.0 + np.arange(rows.shape[1]))
    keys = np.einsum("ij,j->i", np.where(np.isnan(rows), 0.0, rows), weights)
    fewest = max(_COPIES * len(rows), _FEWEST_COPIES)
    if (np.diff(np.sort(keys)) == 0.0).sum() < fewest:
        return
    rank = np.unique(sample, return_inverse=True)[1].reshape(len(rows))
    order = np.lexsort((rank, keys))
    again = (np.diff(keys[order]) == 0.0) & (np.diff(rank[order]) > 1)
    if again.sum() >= fewest:
        one, other = sample[order[int(np.argmax(again)) :][:2]]
        raise DataError(
            f"{place}: {again.sum()} of {len(rows)} rows are copies, to the last digit, of earlier "
            f"ones at other samples ({other} of {one}): they would count as evidence; leave them "
            "out"
        )


def warn_of_outside(pixels: NDArray, size: tuple[int, int] | None, what: str) -> None:
    """Warn of pixels of which many lie outside their images.

    They are learned from all the same: a simulated camera may have no edges.

    Args:
        pixels: u and v, nan where nothing was seen. Shape (N, 2).
        size: Width and height of the images; nothing is said where that is not known.
        what: Whose they are, for the message.

    Warns:
        UserWarning: If more than a tenth do.
    """
    there = pixels[np.isfinite(pixels).all(axis=1)]
    if size is None or not len(there):
        return
    beyond = (there < -0.5) | (there > np.array(size) - 0.5)
    if beyond.any(axis=1).mean() > _MOST_OUTSIDE:
        u, v = there.max(axis=0)
        warnings.warn(
            f"{what}: pixels up to {u:.4g}, {v:.4g} in images of {size[0]} x {size[1]}: is "
            "image_size that of these images, and are they pixels?",
            stacklevel=4,
        )


def _check_plausible(dataset: Dataset, place: str) -> None:
    """Refuse data that are well formed but cannot be what they say.

    Args:
        place: The file, for messages.

    Raises:
        DataError: If nothing was measured, points spread over more than 100 m, a sweep did not
            move its joint, or moved another joint more.
    """
    seen = dataset.measured
    if not seen.any() and np.isnan(dataset.pixels).all():
        raise DataError(
            f"{place}: nothing was measured: no row has {', '.join(POINT_COLUMNS)} or"
            f" {', '.join(PIXEL_COLUMNS)}"
        )
    points = dataset.p_WH_measured[seen]
    if len(points):
        # The largest coordinate serves as well, and cannot overflow.
        spread = float(np.abs(points - np.median(points, axis=0)).max())
        check_spread(f"{place}: points spread over", spread, f"{', '.join(POINT_COLUMNS)} are")
    for joint in range(len(dataset.joints)):
        _check_sweep_moved(dataset, joint, place)


def check_spread(what: str, spread: float, which: str) -> None:
    """Refuse places that lie further apart than any machine is large; warn of a very large one.

    Args:
        what: Of what it is, for the message.
        spread: How far from their middle places lie [m].
        which: Numbers that are metres, and their verb, for the message.

    Raises:
        DataError: If that is more than 100 m.

    Warns:
        UserWarning: If it is more than 20 m.
    """
    if spread <= MAX_SPREAD_M:
        return
    words = f"{what} {spread:.4g} m: were millimetres given as metres? {which} metres"
    if spread > _NO_MACHINE_M:
        raise DataError(words)
    warnings.warn(f"{words}, and a machine of that size is taken for one", stacklevel=5)


_MOVED = 0.1
"""Joints that move less do not tell that places are too near to each other [rad or m]."""


def _warn_of_units(dataset: Dataset, place: str) -> None:
    """Warn of numbers that look like another unit than the one they are said to have.

    Of joints read in `rad` that turned by more than two whole turns, and of more than two points
    that all lie within 5 mm though joints moved; some samples in degrees are refused, see
    `check_radians`.
    """
    in_rad = [i for i, joint in enumerate(dataset.joints) if joint.encoder_unit == "rad"]
    check_radians(
        [dataset.joints[i].name for i in in_rad], dataset.encoders[:, in_rad], dataset.sample, place
    )
    which = f"{', '.join(POINT_COLUMNS)} are"
    seen = dataset.measured
    sizes = [joint.radians_per_unit for joint in dataset.joints]
    if stood_still(dataset.encoders[seen] * sizes):
        return
    warn_of_specks(f"{place}: all points lie", dataset.p_WH_measured[seen], which)


def stood_still(readings: NDArray) -> bool:
    """Return whether no joint moved enough to say how large its robot is.

    Args:
        readings: Of all joints [rad or m]; nan where there are none. Shape (N, n).
    """
    known = readings[:, np.isfinite(readings).all(axis=0)]
    return bool(known.size) and float(np.ptp(known, axis=0).max()) < _MOVED


def warn_of_specks(what: str, points: NDArray, which: str) -> None:
    """Warn of more than two places that all lie nearer to each other than any robot is small.

    Args:
        what: Of what they are and their verb, for the message.
        points: Places [m]. Shape (N, 3).
        which: Numbers that are metres, and their verb, for the message.

    Warns:
        UserWarning: If they do.
    """
    if len(points) < 3:
        return
    spread = 2.0 * float(np.abs(points - np.median(points, axis=0)).max())
    if 0.0 < spread < _MIN_SPREAD_M:
        warnings.warn(
            f"{what} within {1e3 * spread:.2g} mm: were metres given as millimetres? "
            f"{which} metres",
            stacklevel=5,
        )


def check_radians(names: Sequence[str], readings: NDArray, sample: NDArray, place: str) -> None:
    """Refuse readings of which some samples are in degrees; warn where all of a joint may be.

    Args:
        names: Joints that are read in radians.
        readings: Their readings [rad]. Shape (N, n).
        sample: Number of each row's sample. Shape (N,).
        place: What they are of, for the message.

    Raises:
        DataError: If in some samples several joints are read beyond two turns, and in all others
            none beyond one.

    Warns:
        UserWarning: If a joint turned by more than two whole turns.
    """
    halves = 0.5 * readings  # a difference of halves cannot overflow
    spans = 2.0 * (halves.max(axis=0, initial=-np.inf) - halves.min(axis=0, initial=np.inf))
    wide = [name for name, span in zip(names, spans, strict=True) if span > MAX_TURN_RAD]
    if not wide:
        return
    beyond = np.abs(readings) > MAX_TURN_RAD
    there = beyond.sum(axis=1) >= _FEWEST_IN_DEGREES
    number = len(np.unique(sample[there]))
    elsewhere = np.abs(readings[~there])
    if number >= _FEWEST_IN_DEGREES and elsewhere.size and elsewhere.max() <= 0.5 * MAX_TURN_RAD:
        raise DataError(
            f"{place}: readings of {listed(wide)} are beyond two turns in {number} samples "
            f"({sample[there].min()} to {sample[there].max()}), and within one in all others: "
            "were degrees given as radians there? A joint is read in one unit"
        )
    warnings.warn(
        f"{place}: readings of {listed(wide)} span up to {spans.max():.4g} rad, "
        f"{spans.max() / (2.0 * np.pi):.3g} turns: if these are degrees, set encoder_unit: deg",
        stacklevel=5,
    )


def _check_sweep_moved(dataset: Dataset, joint: int, place: str) -> None:
    name = dataset.joints[joint].name
    marked = dataset.sweep == name
    rows = marked | (dataset.sweep == HOME)
    # One pose alone, left over from a split, shows no motion and claims none.
    if not marked.any() or np.unique(dataset.sample[rows]).size < 2:
        return
    span = np.ptp(dataset.encoders[rows], axis=0)
    if span[joint] == 0.0:
        raise DataError(
            f"{place}: the sweep of joint {name!r} did not move it: encoder.{name} is"
            f" {float(dataset.encoders[rows][0, joint])!r} in all its {int(marked.sum())} rows;"
            " check the sweep column and the encoder"
        )
    radians = span * [info.radians_per_unit for info in dataset.joints]
    other = int(np.argmax(radians))
    if radians[other] > radians[joint] + _still_rad(dataset.joints[other]):
        raise DataError(
            f"{place}: in the sweep of joint {name!r} joint {dataset.joints[other].name!r} moved"
            f" more: {np.degrees(radians[other]):.4g} degrees at its encoder against"
            f" {np.degrees(radians[joint]):.4g}; check the sweep column, and that the"
            f" '{HOME}' rows have the posture of the sweeps"
        )


def _still_rad(info: JointInfo) -> float:
    return info.still_tolerance * info.radians_per_unit

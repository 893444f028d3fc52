"""Steps of commands, cut out of a recording: from rest, and until the joint rests again."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.dataset.motion.motion_recording import MotionRecording
from nico_selfmodel.errors import NotIdentifiableError

FEWEST_STEPS = 4
"""Fewer tell no scatter."""
_REST = 0.02
"""Share of the way that a joint may still creep by at what counts as rest."""
_SPREAD = 5.0
"""Standard deviations within which five readings of a joint at rest lie, 99 times of 100."""
_ENDS = 5
"""Readings that tell where a joint rested."""
_SMALLEST = 1e-6
"""Standard deviation of a reading that is never taken for smaller [rad]."""
_ROUNDING = 1e-9
"""Readings that differ by less than this share are the same."""
_HARDLY_READ = f"have fewer than {2 * _ENDS} readings; read the joint more often"
_MOVES_BEFORE = (
    "begin while the joint moves; wait until it rests, and see that commands and readings have one "
    "clock"
)
_MOVES_AFTER = "end before the joint rests; wait longer after each"
_STREAM = 3
"""Rows between two commands, in the median, below which they are a stream and no steps."""


@dataclass(frozen=True, eq=False)
class Steps:
    """Steps of one joint, the joint's way counted as positive in each.

    Rows of all steps follow each other.
    """

    joint: str
    """Its name."""
    told: NDArray
    """Difference of the commands [rad at the encoder]. Shape (n,)."""
    way: NDArray
    """Difference of the readings at rest, after and before [rad]. Shape (n,)."""
    missed: NDArray
    """Where it rests less where it was told to [rad]. Shape (n,)."""
    begins: NDArray
    """When each was told, in the recording's time [s]. Shape (n,)."""
    step: NDArray
    """Number of the step of each row. Shape (N,)."""
    time: NDArray
    """Of each row since the command [s]. Shape (N,)."""
    gone: NDArray
    """How far the joint has gone on its way, by its encoder [rad]. Shape (N,)."""
    sigma: NDArray
    """Standard deviation of each row: at rest, that of a reading, rounding included [rad]. (N,)."""
    unused: int
    """Further steps that did not begin or end at rest, or were read too rarely."""

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for key in ("told", "way", "missed", "begins", "step", "time", "gone", "sigma"):
            object.__setattr__(self, key, read_only(getattr(self, key)))

    def __len__(self) -> int:
        return len(self.way)

    def select(self, chosen: NDArray) -> "Steps":
        """Return some of them. Boolean, shape (n,)."""
        rows, number = chosen[self.step], np.cumsum(chosen) - 1
        each = {key: getattr(self, key)[chosen] for key in ("told", "way", "missed", "begins")}
        row = {key: getattr(self, key)[rows] for key in ("time", "gone", "sigma")}
        kept = number[self.step[rows]]
        return Steps(self.joint, **each, step=kept, **row, unused=self.unused)


def steps_of(recording: MotionRecording, joint: int) -> Steps | None:
    """Cut the steps of one joint out of a recording.

    Args:
        recording: Commands and readings.
        joint: Its number.

    Returns:
        Steps from rest to rest; None of a joint that was never told to move.

    Raises:
        NotIdentifiableError: If its commands are a stream, or too few steps can be used.
    """
    info, command = recording.joints[joint], recording.commanded[:, joint]
    size = info.radians_per_unit * info.sign
    changes = np.flatnonzero(np.diff(command)) + 1
    if not len(changes):
        return None
    ends = np.append(changes[1:], len(command))
    if len(changes) > _STREAM and np.median(ends - changes) <= _STREAM:
        raise NotIdentifiableError(
            f"{info.name} was told to go somewhere else {len(changes)} times in {len(command)} "
            "rows: a response shows where commands change at once and then stay; record steps "
            "(`nico-selfmodel servo steps`)"
        )
    before = np.append(0, changes[:-1])
    scatter = _scatter(recording.encoders[:, joint])
    cut = [
        _step(recording, joint, *rows, scatter)
        for rows in zip(before.tolist(), changes.tolist(), ends.tolist(), strict=True)
    ]
    found = [one for one in cut if isinstance(one, _Step)]
    if len(found) < FEWEST_STEPS:
        lacks = [one for one in cut if isinstance(one, str)]
        raise NotIdentifiableError(
            f"{info.name}: {len(found)} of {len(cut)} steps can be used, {FEWEST_STEPS} are the "
            f"least: most {max(lacks, key=lacks.count)}"
        )
    rest = np.concatenate([one.rest for one in found])
    grain = _grain(recording.encoders[:, joint])
    noise = abs(size) * np.hypot(np.sqrt(np.mean(rest**2)), grain / np.sqrt(12.0))
    told = np.array([command[one.row] - command[one.row - 1] for one in found])
    gone = abs(size) * np.concatenate([np.sign(one.way) * one.gone for one in found])
    return Steps(
        info.name,
        told=size * told,
        way=size * np.array([one.way for one in found]),
        missed=size * np.array([one.end - command[one.row] for one in found]),
        begins=recording.time[[one.row for one in found]],
        step=np.repeat(np.arange(len(found)), [len(one.time) for one in found]),
        time=np.concatenate([one.time for one in found]),
        gone=gone,
        sigma=np.full(len(gone), max(float(noise), _SMALLEST)),
        unused=len(cut) - len(found),
    )


def _scatter(readings: NDArray) -> float:
    """Return the standard deviation of a reading at rest, where it is in most rows.

    By the median difference of neighbours, 0.954 sigma of normal ones.
    """
    known = readings[np.isfinite(readings)]
    return float(np.median(np.abs(np.diff(known)))) / 0.954 if len(known) > 1 else 0.0


def _grain(readings: NDArray) -> float:
    """Return the smallest difference of two readings, a count of what counts [encoder unit]."""
    apart = np.diff(np.unique(readings[np.isfinite(readings)]))
    apart = apart[apart > _ROUNDING * np.nanmax(np.abs(readings), initial=0.0)]
    return float(apart.min(initial=np.inf)) if len(apart) else 0.0


@dataclass(frozen=True, eq=False)
class _Step:
    """One step, in the encoder's unit."""

    row: int
    way: float
    end: float
    time: NDArray
    gone: NDArray
    rest: NDArray
    """Readings after it rested, less their median."""


def _step(
    recording: MotionRecording, joint: int, before: int, row: int, end: int, scatter: float
) -> _Step | str:
    """Cut one step out; say why it cannot be used, where it does not begin and end at rest.

    Args:
        recording: Commands and readings.
        joint: Number of the joint.
        before: Row of the command before.
        row: Row of its command.
        end: Row of the next command.
        scatter: Standard deviation of a reading at rest [encoder unit].
    """
    readings = recording.encoders[:, joint]
    earlier = readings[before:row]
    earlier = earlier[np.isfinite(earlier)][-_ENDS:]
    rows = row + np.flatnonzero(np.isfinite(readings[row:end]))
    if len(rows) < 2 * _ENDS or len(earlier) < 2:
        return _HARDLY_READ
    told = abs(recording.commanded[row, joint] - recording.commanded[row - 1, joint])
    last = readings[rows[-_ENDS:]]
    still = 3.0 * recording.joints[joint].still_tolerance
    tolerance = max(still, _REST * told, _SPREAD * scatter)
    start, goal = float(np.median(earlier)), float(np.median(last))
    if np.ptp(earlier) > tolerance:
        return _MOVES_BEFORE
    if max(np.ptp(last), abs(readings[rows[-2 * _ENDS]] - goal)) > tolerance:
        return _MOVES_AFTER
    # Rows long after it came to rest tell nothing.
    far = np.flatnonzero(np.abs(readings[rows] - goal) > tolerance)
    time = recording.time[rows] - recording.time[row]
    arrived = time[far[-1]] if far.size else 0.0
    kept = time <= 1.3 * arrived + 4.0 * float(np.median(np.diff(time)))
    return _Step(row, goal - start, goal, time[kept], (readings[rows] - start)[kept], last - goal)

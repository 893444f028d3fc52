"""Encoder readings written as text."""

import csv
import io
import warnings
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import DataError

_FAR = 0.25
"""Share of the trained range that a reading may lie beyond it."""


def readings_from_words(words: list[str], joints: tuple[str, ...]) -> NDArray:
    """Read poses written as `a,b,...`, one number a joint.

    Args:
        words: Poses.
        joints: Names of the joints, in the order of the numbers.

    Returns:
        Readings. Shape (N, n).

    Raises:
        DataError: If a pose has another number of numbers, or one is not finite.
    """
    return np.array([_pose(word.split(","), joints, f"pose {word!r}") for word in words])


def readings_from_table(text: str, joints: tuple[str, ...]) -> NDArray:
    """Read poses from CSV text with a column per joint, named `<joint>` or `encoder.<joint>`.

    Args:
        text: The table, header first; other columns are ignored.
        joints: Names of the joints.

    Returns:
        Readings. Shape (N, n).

    Raises:
        DataError: If a column is missing, a cell is no finite number, or there is no row.
    """
    reader = csv.DictReader(io.StringIO(text.removeprefix("\ufeff")))
    header = reader.fieldnames or []
    columns = []
    for joint in joints:
        found = [name for name in (f"encoder.{joint}", joint) if name in header]
        if not found:
            raise DataError(
                f"the table has no column {joint!r} or 'encoder.{joint}'; it has "
                f"{', '.join(header) or 'no header'}"
            )
        columns.append(found[0])
    rows = [
        _pose([row[name] or "" for name in columns], joints, f"line {number}")
        for number, row in enumerate(reader, start=2)
    ]
    if not rows:
        raise DataError("the table has no row below its header")
    return np.array(rows)


def readings_table(readings: NDArray, joints: tuple[str, ...]) -> str:
    """Return poses as CSV text that `readings_from_table` reads back exactly.

    Args:
        readings: Shape (N, n).
        joints: Names of the joints.

    Returns:
        The table, with a column `encoder.<joint>` for each joint.
    """
    header = ",".join(f"encoder.{joint}" for joint in joints)
    rows = [",".join(repr(value) for value in row) for row in readings.tolist()]
    return "\n".join([header, *rows]) + "\n"


def warn_beyond(
    readings: NDArray, joints: tuple[str, ...], trained: Mapping[str, Sequence[float]]
) -> None:
    """Warn of readings far outside the range that a model was trained on.

    Args:
        readings: Shape (N, n).
        joints: Names of the joints.
        trained: Joint -> lowest and highest reading of the training data; joints that are missing
            are not looked at.

    Warns:
        UserWarning: If a reading lies beyond the range by more than a quarter of it.
    """
    far = []
    for joint, column in zip(joints, readings.T, strict=True):
        if joint not in trained:
            continue
        lower, upper = trained[joint]
        beyond = np.maximum(lower - column, column - upper)
        worst = int(np.argmax(beyond))
        if beyond[worst] > _FAR * (upper - lower):
            far.append(f"{joint} reads {column[worst]:.6g}, trained on {lower:.6g} to {upper:.6g}")
    if far:
        warnings.warn(
            f"readings far outside the training data: {'; '.join(far)}. What is predicted there is "
            "a guess, and its sigma too small",
            stacklevel=2,
        )


def _pose(cells: list[str], joints: tuple[str, ...], where: str) -> list[float]:
    if len(cells) != len(joints):
        raise DataError(
            f"{where} has {len(cells)} numbers, expected {len(joints)}: {', '.join(joints)}"
        )
    values = []
    for joint, cell in zip(joints, cells, strict=True):
        try:
            value = float(cell)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise DataError(f"{where}: the reading of {joint} is {cell!r}, expected a number")
        values.append(value)
    return values

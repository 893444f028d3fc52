"""Encoder readings written as text."""

import warnings
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.columns import APPROACH, ENCODER
from nico_selfmodel.dataset.csv_table import CsvTable
from nico_selfmodel.errors import DataError
from nico_selfmodel.files.csv_cells import rows_text
from nico_selfmodel.files.csv_rows import parse_number
from nico_selfmodel.names import listed, shown

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
    return np.array([_pose(word.split(","), joints, f"pose {shown(word)}") for word in words])


def readings_from_table(table: CsvTable, joints: tuple[str, ...]) -> NDArray:
    """Return the poses of a table with a column per joint, named `encoder.<joint>` or `<joint>`.

    Args:
        table: The table; other columns are ignored.

    Returns:
        Readings. Shape (N, n).

    Raises:
        DataError: If a column is missing, or a cell is no finite number.
    """
    columns = []
    for joint in joints:
        names = (f"{ENCODER}.{joint}", joint)
        found = next((name for name in names if name in table.columns), names[0])
        columns.append(table.numbers(found))
    return np.column_stack(columns)


def approach_from_table(table: CsvTable, joints: tuple[str, ...]) -> NDArray:
    """Return from which sides joints came, columns `approach.<joint>` of -1, 0 or 1.

    Args:
        joints: Names of the joints; one without a column came from an unknown side.

    Returns:
        0 where it is not known. Shape (N, n).

    Raises:
        DataError: If a cell is another number.
    """
    return np.column_stack([table.sides(f"{APPROACH}.{joint}") for joint in joints])


def readings_table(readings: NDArray, joints: tuple[str, ...]) -> str:
    """Return poses as CSV text that `readings_from_table` reads back exactly.

    Args:
        readings: Shape (N, n).

    Returns:
        The table, with a column `encoder.<joint>` for each joint.
    """
    return rows_text([f"{ENCODER}.{joint}" for joint in joints], readings.tolist())


def warn_beyond(
    readings: NDArray, joints: tuple[str, ...], trained: Mapping[str, Sequence[float]]
) -> None:
    """Warn of readings far outside the range that a model was trained on.

    Args:
        readings: Shape (N, n).
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
            f"{where} has {len(cells)} numbers, expected {len(joints)}: {listed(joints)}"
        )
    values = []
    for joint, cell in zip(joints, cells, strict=True):
        try:
            value = parse_number(cell)
        except ValueError as error:
            raise DataError(f"{where}: the reading of {joint}: {error}") from None
        if np.isnan(value):
            raise DataError(f"{where}: the reading of {joint} is {cell!r}, expected a number")
        values.append(value)
    return values

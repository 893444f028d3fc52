"""What the rows of a data set must satisfy, wherever they come from."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nico_selfmodel.dataset.columns import PIXEL_COLUMNS, POINT_COLUMNS
from nico_selfmodel.dataset.joint_info import HOME
from nico_selfmodel.errors import DataError
from nico_selfmodel.names import TAGS_OF_ONE_ID, check_name, listed, shown

Place = Callable[[int, str | None], str]
"""Says where a row (and column) is: the line of a file, or the index of a row."""


def row_place(row: int, column: str | None = None) -> str:
    """Return the place of a row that is not in a file.

    Args:
        row: Index of the row.
        column: Column of the cell, if one is meant.
    """
    return f"row {row}" if column is None else f"row {row}, column {column!r}"


def check_rows(columns: dict[str, Any], joint_names: Sequence[str], where: Place) -> None:
    """Check that the rows of a data set do not contradict each other.

    Args:
        columns: Arrays `sample`, `sweep`, `marker`, `mirror`, `encoders`, `p_WH_measured`,
            `pixels` and, where it is known, `approach` of a `Dataset`.
        where: Says where a row is.

    Raises:
        DataError: If a name is not valid, a sweep names no joint, a cell is missing in a point, a
            row appears twice, or the rows of one sample differ in encoders or sweep.
    """
    for key in ("marker", "mirror"):
        _check_labels(columns[key], key, where)
    _check_sweep_names(columns["sweep"], joint_names, where)
    _check_whole(columns["p_WH_measured"], POINT_COLUMNS, where)
    _check_whole(columns["pixels"][:, :2], PIXEL_COLUMNS[:2], where)
    _check_whole(columns["pixels"][:, 2:], PIXEL_COLUMNS[2:], where)
    _check_no_duplicates(columns, where)
    _check_one_pose_per_sample(columns, joint_names, where)


def _check_labels(labels: npt.NDArray[np.str_], key: str, where: Place) -> None:
    names, rows = np.unique(labels, return_index=True)
    for row, label in sorted(zip(rows.tolist(), names.tolist(), strict=True)):
        try:
            if label or key == "marker":
                check_name(label, f"a {key}")
        except ValueError as error:
            raise DataError(f"{where(row, key)}: {error}") from None


def _check_sweep_names(
    sweep: npt.NDArray[np.str_], joint_names: Sequence[str], where: Place
) -> None:
    valid = ["", HOME, *joint_names]
    bad = np.flatnonzero(~np.isin(sweep, valid))
    if bad.size:
        name = str(sweep[bad[0]])
        raise DataError(
            f"{where(int(bad[0]), 'sweep')}: there is no joint {shown(name)}; joints are"
            f" {listed(joint_names, name)}; '{HOME}' marks the shared home pose, an empty cell a"
            " free pose"
        )


def _check_whole(values: npt.NDArray[np.float64], names: Sequence[str], where: Place) -> None:
    empty = np.isnan(values)
    partial = np.flatnonzero(empty.any(axis=1) & ~empty.all(axis=1))
    if partial.size:
        row = int(partial[0])
        missing = names[int(np.flatnonzero(empty[row])[0])]
        raise DataError(
            f"{where(row, missing)}: the cell is empty but others of {', '.join(names)} are not;"
            " fill all of them, or none where it was not measured"
        )


def _check_no_duplicates(columns: dict[str, Any], where: Place) -> None:
    first: dict[tuple[int, str, str], int] = {}
    keys = (columns[key].tolist() for key in ("sample", "marker", "mirror"))
    for row, key in enumerate(zip(*keys, strict=True)):
        if key in first:
            reflected = f" in mirror {key[2]!r}" if key[2] else ""
            earlier = _short(where(first[key], None))
            raise DataError(
                f"{where(row, 'sample')}: sample {key[0]} with marker {key[1]!r}{reflected}"
                f" is already in {earlier}; {_one_or_two(columns, first[key], row)}"
            )
        first[key] = row


def _one_or_two(columns: dict[str, Any], one: int, other: int) -> str:
    """Say what rows of one sample and marker may be: two tags where they differ at one pose."""
    measured = [columns[key] for key in ("p_WH_measured", "pixels")]
    same = all(np.array_equal(of[one], of[other], equal_nan=True) for of in measured)
    if same or not np.array_equal(columns["encoders"][one], columns["encoders"][other]):
        return "give each pose its own sample number"
    return f"{TAGS_OF_ONE_ID}, or if these are two poses a sample number each"


def _check_one_pose_per_sample(
    columns: dict[str, Any], joint_names: Sequence[str], where: Place
) -> None:
    sample, encoders, sweep = columns["sample"], columns["encoders"], columns["sweep"]
    _, first, inverse = np.unique(sample, return_index=True, return_inverse=True)
    first_row = first[inverse]
    differs = encoders != encoders[first_row]
    if differs.any():
        row, joint = (int(i) for i in np.argwhere(differs)[0])
        here, earlier = (float(encoders[k, joint]) for k in (row, first_row[row]))
        raise DataError(
            f"{where(row, f'encoder.{joint_names[joint]}')}: sample {sample[row]} has reading"
            f" {here!r} here and {earlier!r} in {_short(where(int(first_row[row]), None))}; all"
            " markers of one sample share one pose"
        )
    approach = columns.get("approach")
    differs = (
        np.zeros(encoders.shape, dtype=bool)
        if approach is None
        else approach != approach[first_row]
    )
    if differs.any():
        row, joint = (int(i) for i in np.argwhere(differs)[0])
        raise DataError(
            f"{where(row, f'approach.{joint_names[joint]}')}: sample {sample[row]} came from"
            f" another side in {_short(where(int(first_row[row]), None))}; all markers of one"
            " sample share one pose"
        )
    differs = np.flatnonzero(sweep != sweep[first_row])
    if differs.size:
        row = int(differs[0])
        here, earlier = (str(sweep[k]) for k in (row, first_row[row]))
        raise DataError(
            f"{where(row, 'sweep')}: sample {sample[row]} has sweep {here!r} here and"
            f" {earlier!r} in {_short(where(int(first_row[row]), None))}"
        )


def _short(place: str) -> str:
    """Return the last part of a place, for a second row in the same message."""
    return place.rpartition(", ")[2]

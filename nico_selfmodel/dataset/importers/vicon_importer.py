"""Import a trajectory export of Vicon Nexus together with encoder readings."""

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from nico_selfmodel.dataset.columns import APPROACH, ENCODER
from nico_selfmodel.dataset.csv_table import CsvTable
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.importers.vicon_trajectories import Trajectories, read_trajectories
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.dataset.plausibility import check_as_read
from nico_selfmodel.dataset.row_checks import check_rows
from nico_selfmodel.errors import DataError

_RESERVED = ("frame", "frame_start", "frame_end", "sample", "sweep")


def import_vicon(
    path: str | PathLike[str],
    encoders: str | PathLike[str],
    encoder_unit: str,
    counts_per_turn: float | None = None,
    markers: Sequence[str] | None = None,
    name: str | None = None,
) -> Dataset:
    """Pair a trajectory export of Vicon Nexus with encoder readings by frame number.

    The readings are a CSV with one row per pose: column `frame`, or `frame_start` and
    `frame_end` (included) of an interval in which the arm had settled, over which the points are
    averaged; one column per joint, `<joint>` or `encoder.<joint>`; optionally `sample` and
    `sweep`. A marker that was hidden in a whole interval counts as not measured.

    Args:
        path: The export.
        encoders: The readings.
        encoder_unit: Unit of all joints, which are the other columns of the readings: `counts`,
            `rad` or `deg`.
        counts_per_turn: Counts of one turn of the encoder, if the unit is `counts`.
        markers: Which markers to take, with or without `<subject>:`. By default all that have
            a name.
        name: Name of the data set; by default that of the file.

    Returns:
        The data set. Its extra columns `frame_start`, `frame_end` and `frames_used` say which
        frames each row comes from and how many of them were not gaps.

    Raises:
        DataError: If a file is not valid, a frame is not in the export or a marker is not;
            names file, line and column.
    """
    path = Path(path)
    table = CsvTable.read(Path(encoders))
    joints = _joints_of(table, encoder_unit, counts_per_turn)
    trajectories = read_trajectories(path, markers)
    columns = _columns(table, joints, list(trajectories.points))
    columns |= _averages(table, trajectories)
    markers_per_pose = len(trajectories.points)
    check_rows(
        columns,
        [joint.name for joint in joints],
        lambda row, column: table.where(row // markers_per_pose, column),
    )
    source = f"Vicon trajectories {path.name} with encoders {table.path.name}"
    try:
        dataset = Dataset(name=name or path.stem, joints=tuple(joints), source=source, **columns)
    except (ValueError, DataError) as error:
        raise DataError(f"{path}: {error}") from None
    check_as_read(dataset, str(path))
    return dataset


def _columns(table: CsvTable, joints: Sequence[JointInfo], markers: list[str]) -> dict[str, Any]:
    """Return the columns that come from the readings; all markers of a pose stand together."""
    poses = len(table)
    sample = np.arange(1, poses + 1)
    sweep = np.full(poses, "")
    if "sample" in table.columns:
        sample = table.integers("sample")
    if "sweep" in table.columns:
        sweep = table.texts("sweep")
    encoders = [table.numbers(_reading_column(table, joint.name)) for joint in joints]
    sides = [
        table.sides(name)
        if (name := f"{APPROACH}.{joint.name}") in table.columns
        else np.zeros(poses)
        for joint in joints
    ]
    count = poses * len(markers)
    return {
        "sample": np.repeat(sample, len(markers)),
        "sweep": np.repeat(sweep, len(markers)),
        "encoders": np.repeat(np.column_stack(encoders), len(markers), axis=0),
        "approach": np.repeat(np.column_stack(sides), len(markers), axis=0),
        "marker": np.tile(markers, poses),
        "mirror": np.full(count, ""),
        "pixels": np.full((count, 4), np.nan),
    }


def _averages(table: CsvTable, trajectories: Trajectories) -> dict[str, Any]:
    """Return the measured points, and as extra columns which frames they come from."""
    start, end = _intervals(table, trajectories)
    averages = [trajectories.mean_points(marker, start, end) for marker in trajectories.points]
    means, used = zip(*averages, strict=True)
    frames = {
        "frame_start": np.repeat(start, len(averages)),
        "frame_end": np.repeat(end, len(averages)),
        "frames_used": np.stack(used, axis=1).ravel(),
    }
    return {
        "p_WH_measured": np.stack(means, axis=1).reshape(-1, 3),
        "extra": {key: tuple(map(str, values.tolist())) for key, values in frames.items()},
    }


def _intervals(
    table: CsvTable, trajectories: Trajectories
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    names = ("frame", "frame") if "frame" in table.columns else ("frame_start", "frame_end")
    if names[0] == "frame" and {"frame_start", "frame_end"} & set(table.columns):
        raise DataError(f"{table.path}: give column 'frame' or 'frame_start' and 'frame_end'")
    start, end = (table.integers(name) for name in names)
    first, last = trajectories.frames[0], trajectories.frames[-1]
    for values, name in zip((start, end), names, strict=True):
        absent = np.flatnonzero(~np.isin(values, trajectories.frames))
        if absent.size:
            row = int(absent[0])
            raise DataError(
                f"{table.where(row, name)}: frame {values[row]} is not in {trajectories.path},"
                f" which has frames {first} to {last}"
            )
    backward = np.flatnonzero(end < start)
    if backward.size:
        row = int(backward[0])
        raise DataError(
            f"{table.where(row, 'frame_end')}: frame_end {end[row]} lies before frame_start"
            f" {start[row]}"
        )
    _, first_of, which = np.unique(
        np.stack([start, end]), axis=1, return_index=True, return_inverse=True
    )
    again = np.flatnonzero(first_of[which.ravel()] < np.arange(len(start)))
    if again.size:
        row = int(again[0])
        other = table.lines[int(first_of[which.ravel()[row]])]
        raise DataError(
            f"{table.where(row, names[0])}: frame {start[row]} is there twice, in line {other}, "
            "too: one frame has one pose; leave one of the rows out"
        )
    return start, end


def _joints_of(
    table: CsvTable, encoder_unit: str, counts_per_turn: float | None
) -> tuple[JointInfo, ...]:
    own = [n for n in table.columns if n not in _RESERVED and not n.startswith(f"{APPROACH}.")]
    names = [name.removeprefix(f"{ENCODER}.") for name in own]
    if not names:
        raise DataError(f"{table.path}: no column of a joint beside the frames")
    try:
        return tuple(JointInfo(name, encoder_unit, counts_per_turn) for name in names)
    except ValueError as error:
        raise DataError(f"{table.path}: {error}") from None


def _reading_column(table: CsvTable, joint: str) -> str:
    prefixed = f"encoder.{joint}"
    return prefixed if prefixed in table.columns else joint

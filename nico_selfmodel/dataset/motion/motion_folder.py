"""Commands and readings over time as a folder: `dataset.yaml` beside `motion.csv`."""

from os import PathLike
from pathlib import Path

import numpy as np

from nico_selfmodel.dataset.columns import ENCODER
from nico_selfmodel.dataset.csv_table import CsvTable
from nico_selfmodel.dataset.metadata_file import read_joint_list
from nico_selfmodel.dataset.motion.motion_recording import MotionRecording
from nico_selfmodel.errors import DataError
from nico_selfmodel.files.csv_cells import number_cells, table_text
from nico_selfmodel.files.folder_contents import found_at
from nico_selfmodel.files.reading import real_path
from nico_selfmodel.files.whole import folder_in_place_of, refuse_existing
from nico_selfmodel.files.yaml_mapping import check_keys, read_yaml_mapping, text_value
from nico_selfmodel.files.yaml_text import yaml_text
from nico_selfmodel.names import shown

FORMAT = "nico-motion/1"
FILES = ("dataset.yaml", "motion.csv")
_KEYS = ("format", "name", "joints", "source")
_TIME, _COMMAND = "time_s", "command"


def load_motion(folder: str | PathLike[str]) -> MotionRecording:
    """Read what joints were told over time, and what their encoders read.

    Args:
        folder: With `dataset.yaml` and `motion.csv`.

    Raises:
        DataError: If anything is missing or not valid; names file, line and column.
    """
    folder = Path(folder)
    head, table = (folder / name for name in FILES)
    if not (head.is_file() and table.is_file()):
        raise DataError(
            f"{found_at(folder)}; a recording of steps is a folder with {' and '.join(FILES)}, as "
            "`nico-selfmodel servo steps` makes it"
        )
    content = read_yaml_mapping(head)
    if content.get("format") != FORMAT:
        raise DataError(f"{head}: expected 'format: {FORMAT}', got {shown(content.get('format'))}")
    check_keys(content, _KEYS, str(head))
    joints = read_joint_list(content, str(head))
    columns = CsvTable.read(table)
    told = [columns.numbers(f"{_COMMAND}.{joint.name}") for joint in joints]
    read = [columns.numbers(f"{ENCODER}.{joint.name}", empty_allowed=True) for joint in joints]
    try:
        return MotionRecording(
            text_value(content, "name", str(head)),
            joints,
            columns.numbers(_TIME),
            np.column_stack(told),
            np.column_stack(read),
            text_value(content, "source", str(head), default=""),
        )
    except ValueError as error:
        raise DataError(f"{table}: {error}") from None


def save_motion(
    recording: MotionRecording, folder: str | PathLike[str], *, force: bool = False
) -> None:
    """Write a recording to a folder, whole or not at all.

    Args:
        recording: What was told and read.
        folder: The folder to make.
        force: Replace what is there.

    Raises:
        FileExistsError: If the folder exists, without `force`.
        OSError: If it cannot be written.
    """
    folder = real_path(folder)
    refuse_existing(folder, force=force)
    head = {
        "format": FORMAT,
        "name": recording.name,
        "joints": [joint.to_mapping() for joint in recording.joints],
        **({"source": recording.source} if recording.source else {}),
    }
    columns = {_TIME: recording.time}
    for kind, values in ((_COMMAND, recording.commanded), (ENCODER, recording.encoders)):
        for k, joint in enumerate(recording.joints):
            columns[f"{kind}.{joint.name}"] = values[:, k]
    rows = {name: number_cells(column.tolist()) for name, column in columns.items()}
    with folder_in_place_of(folder, keep_others=True) as fresh:
        for name, text in zip(FILES, (yaml_text(head), table_text(rows)), strict=True):
            (fresh / name).write_bytes(text.encode())

"""Files: read within limits and with failures in one plain line, written whole or not at all."""

from nico_selfmodel.files.whole import (
    RESULT_FILE,
    folder_in_place_of,
    folder_written_whole,
    recover,
    refuse_existing,
    refuse_folder,
    write_bytes_whole,
    write_whole,
)

__all__ = [
    "RESULT_FILE",
    "folder_in_place_of",
    "folder_written_whole",
    "recover",
    "refuse_existing",
    "refuse_folder",
    "write_bytes_whole",
    "write_whole",
]

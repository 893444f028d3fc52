"""A detector run over many photographs, and the folder that tells what it saw."""

import json
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import DataError
from nico_selfmodel.files.csv_cells import quoted_cell, safe_cell
from nico_selfmodel.files.whole import RESULT_FILE, folder_written_whole, refuse_folder
from nico_selfmodel.names import TAGS_OF_ONE_ID, listed
from nico_selfmodel.progress import Progress
from nico_selfmodel.vision.annotate import Seen, annotated
from nico_selfmodel.vision.boards.board_detection import AnyBoard, BoardDetection
from nico_selfmodel.vision.boards.chessboard import Board
from nico_selfmodel.vision.boards.exact_corners import WINDOW
from nico_selfmodel.vision.color.color_blob import ColorBlob, find_color_blob
from nico_selfmodel.vision.color.color_model import ColorModel
from nico_selfmodel.vision.images.image_file import image_files, looking_at, read_image, write_image
from nico_selfmodel.vision.images.not_seen import NotSeen
from nico_selfmodel.vision.markers.fiducial import Fiducial, FiducialSearch, of_one_id
from nico_selfmodel.vision.markers.fiducial_family import FiducialFamily

FORMAT = "nico-detections/1"
TABLE = "detections.csv"
_LONGEST_STEM = 230  # of the name of a copy [bytes]
COLUMNS = (
    *("image", "detector", "seen", "id", "mirrored", "u", "v"),
    *(f"corner_{i}_{axis}" for i in range(4) for axis in "uv"),
    "reason",
)
"""Columns of the table; pixels, empty where there is nothing to say."""


@dataclass(frozen=True)
class Detector:
    """One way of looking at a photograph."""

    name: str
    """What it looks for, in words."""
    look: Callable[[NDArray], list[Seen] | NotSeen]
    """Takes an image, returns what it saw."""

    @classmethod
    def for_fiducials(cls, family: str) -> "Detector":
        """Look for all markers of a family."""
        chosen = FiducialFamily(family)

        def look(image: NDArray) -> list[Seen] | NotSeen:
            seen = FiducialSearch.of(image, chosen).found
            return seen if isinstance(seen, NotSeen) else list(seen)

        return cls(f"fiducial {family}", look)

    @classmethod
    def for_color(cls, model: ColorModel) -> "Detector":
        """Look for the largest patch of a colour."""

        def look(image: NDArray) -> list[Seen] | NotSeen:
            seen = find_color_blob(image, model)
            return seen if isinstance(seen, NotSeen) else [seen]

        return cls(f"color {model.dominant}", look)

    @classmethod
    def for_board(cls, board: AnyBoard, window: int = WINDOW) -> "Detector":
        """Look for a board."""

        def look(image: NDArray) -> list[Seen] | NotSeen:
            seen = board.find(image, window)
            return seen if isinstance(seen, NotSeen) else [seen]

        return cls(f"chessboard {board}" if isinstance(board, Board) else str(board), look)


def images_of(paths: Iterable[str | Path]) -> list[Path]:
    """Return the photographs that files and folders stand for, each once.

    Args:
        paths: Files, taken as they are, and folders, whose images are taken.

    Raises:
        DataError: If a folder or file is missing, or a folder holds no images.
    """
    files: list[Path] = []
    for path in map(Path, paths):
        if path.is_dir():
            inside = image_files(path)
            if not inside:
                raise DataError(f"{path}: no images (.png, .jpg) in this folder")
            files += inside
        elif path.exists():
            files.append(path)
        else:
            raise DataError(f"{path}: there is no such file or folder")
    return list(dict.fromkeys(files))


def write_detections(
    files: Sequence[Path],
    detector: Detector,
    folder: str | Path,
    *,
    force: bool = False,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Look at photographs; write what was seen as a table and drawn into copies of them.

    The folder gets `detections.csv`, a PNG for each photograph and `result.json`, whole or not at
    all.

    Args:
        progress: Told how many images are done.

    Returns:
        The content of `result.json`: how many images, how many of them show something, how many
        detections, and why nothing was seen in the others.

    Raises:
        DataError: If there are no photographs, or one cannot be read.
        FileExistsError: If `folder` exists and may not be replaced.
        OSError: If it cannot be written.

    Warns:
        UserWarning: If tags of one id are at two places of a photograph; it tells which.
    """
    if not files:
        raise DataError("no images were given")
    refuse_folder(folder, force=force, inputs=files)
    rows: list[dict[str, str]] = []
    not_seen: dict[str, str] = {}
    twice: dict[str, tuple[int, ...]] = {}
    count = 0
    with folder_written_whole(folder, force=force) as new:
        for done, (file, name) in enumerate(zip(files, _names(files), strict=True), start=1):
            image = read_image(file)
            with looking_at(file):
                seen = detector.look(image)
                write_image(new / name, annotated(image, seen))
            rows += _rows(str(file), detector.name, seen)
            twice |= _of_one_id(str(file), seen)
            if isinstance(seen, NotSeen):
                not_seen[str(file)] = seen.reason
            else:
                count += len(seen)
            if progress:
                progress("looking", done, len(files))
        document = {
            "format": FORMAT,
            "detector": detector.name,
            "images": len(files),
            "images_with_detections": len(files) - len(not_seen),
            "detections": count,
            "not_seen": not_seen,
        }
        _write_table(new / TABLE, rows)
        (new / RESULT_FILE).write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    if twice:
        warnings.warn(_of_one_id_words(twice), stacklevel=2)
    return document


def _of_one_id(image: str, seen: list[Seen] | NotSeen) -> dict[str, tuple[int, ...]]:
    """Return the ids of markers that are at two places of a photograph, if any, by its name."""
    if isinstance(seen, NotSeen):
        return {}
    ids = of_one_id(item for item in seen if isinstance(item, Fiducial))
    return {image: ids} if ids else {}


def _of_one_id_words(twice: dict[str, tuple[int, ...]]) -> str:
    first, *more = twice
    where = f"{first} and {len(more)} more" if more else first
    ids = sorted({one for ids in twice.values() for one in ids})
    markers = f"marker {ids[0]} is" if len(ids) == 1 else f"markers {listed(ids)} are"
    return f"{where}: {markers} at two places at once: {TAGS_OF_ONE_ID}"


def _names(files: Sequence[Path]) -> list[str]:
    """Return a name for the copy of each photograph, no two alike even where case counts not."""
    names: list[str] = []
    taken: set[str] = set()
    for file in files:
        # Room for a number and the ending, in what a file system takes.
        stem = file.stem.encode()[:_LONGEST_STEM].decode("utf-8", "ignore")
        name, number = stem, 1
        while name.lower() in taken:
            number += 1
            name = f"{stem}_{number}"
        taken.add(name.lower())
        names.append(f"{name}.png")
    return names


def _write_table(path: Path, rows: Sequence[dict[str, str]]) -> None:
    cells = [COLUMNS, *([safe_cell(row.get(name, "")) for name in COLUMNS] for row in rows)]
    path.write_bytes("".join(",".join(map(quoted_cell, row)) + "\n" for row in cells).encode())


def _rows(image: str, detector: str, seen: list[Seen] | NotSeen) -> list[dict[str, str]]:
    """Return the table rows of one photograph."""
    start = {"image": image, "detector": detector}
    if isinstance(seen, NotSeen):
        return [{**start, "seen": "no", "reason": seen.reason}]
    return [{**start, "seen": "yes", **cells} for item in seen for cells in _cells(item)]


def _cells(seen: Seen) -> list[dict[str, str]]:
    """Return what is particular to a detection: a row for each corner of a board, or one row."""
    if isinstance(seen, BoardDetection):
        found = np.flatnonzero(seen.seen).tolist()
        # Of a part nobody can say which corners these are.
        return [{"id": "" if seen.loose else str(i), **_pixel("", seen.corners[i])} for i in found]
    if isinstance(seen, ColorBlob):
        left, top, width, height = seen.box
        right, bottom = left + width - 1, top + height - 1
        box = [(left, top), (right, top), (right, bottom), (left, bottom)]
        return [{**_pixel("", seen.center), **_corners(box)}]
    return [
        {
            "id": str(seen.id),
            "mirrored": "yes" if seen.mirrored else "no",
            **_pixel("", seen.center),
            **_corners(seen.corners),
        }
    ]


def _corners(corners: Iterable[Any]) -> dict[str, str]:
    cells: dict[str, str] = {}
    for i, corner in enumerate(corners):
        cells |= _pixel(f"corner_{i}_", corner)
    return cells


def _pixel(prefix: str, pixel: Any) -> dict[str, str]:
    return {f"{prefix}u": f"{float(pixel[0]):.4f}", f"{prefix}v": f"{float(pixel[1]):.4f}"}

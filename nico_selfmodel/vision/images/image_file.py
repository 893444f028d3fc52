"""Photographs on disk."""

import os
import re
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import DataError
from nico_selfmodel.files.folder_contents import SUFFIXES, found_at
from nico_selfmodel.files.reading import LARGEST_PICTURE, read_bytes
from nico_selfmodel.files.whole import write_bytes_whole
from nico_selfmodel.vision.images.picture_header import check_header

"""Endings of the files that count as images, in small letters."""


def read_image(path: str | Path) -> NDArray:
    """Read a photograph as the sensor stored it, whatever turn its metadata ask a viewer for.

    Args:
        path: A PNG or a JPEG.

    Returns:
        Blue, green and red, 8 bits. Shape (h, w, 3).

    Raises:
        DataError: If the file is missing, not readable, no file (a pipe is not waited for), not
            an image, cut off, or of a size that `picture_header` does not allow.
    """
    path = Path(path)
    content = read_bytes(path, LARGEST_PICTURE)
    if not content:
        raise DataError(f"{path}: the file is empty; an image was expected")
    try:
        width, height = check_header(content)
        image = _decoded(content)
    except ValueError as error:
        raise DataError(f"{path}: {error}") from None
    if image.shape != (height, width, 3):
        raise DataError(f"{path}: a damaged image; save it as PNG or JPEG anew")
    return image


def _decoded(content: bytes) -> NDArray:
    # Asked for colours, OpenCV takes four times as long for a grey file as for its grey.
    flags = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        with _errors_of_libraries_unheard():
            image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), flags)
    except cv2.error:
        image = None
    if image is None:
        raise ValueError("not an image that can be read; save it as PNG or JPEG")
    return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image


_ONE_AT_A_TIME = threading.Lock()


@contextmanager
def _errors_of_libraries_unheard() -> Iterator[None]:
    """Keep libpng and libjpeg from printing beside our own line, which they do without asking.

    They write to the process' standard error, so this closes it to all for as long as a picture
    takes to decode.
    """
    with _ONE_AT_A_TIME:
        try:
            heard = os.dup(2)
        except OSError:  # it is closed anyway
            yield
            return
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            sys.stderr.flush()
            os.dup2(nowhere, 2)
            yield
        finally:
            os.dup2(heard, 2)
            os.close(nowhere)
            os.close(heard)


@contextmanager
def looking_at(path: Path) -> Iterator[None]:
    """Let what OpenCV or a detector does not like in a picture be said with the picture's name.

    Raises:
        DataError: In place of their errors.
    """
    try:
        yield
    except ValueError as error:
        raise DataError(f"{path}: {error}") from error
    except cv2.error as error:
        reason = " ".join(str(error).split())
        raise DataError(f"{path}: OpenCV cannot look at this picture: {reason}") from error


def write_image(path: str | Path, image: NDArray) -> None:
    """Write an image, whole or not at all.

    Args:
        path: Where to write; its ending says how, `.png` or `.jpg`.
        image: Grey or BGR, 8 bits.

    Raises:
        ValueError: If the ending is another.
        OSError: If the folder is missing or cannot be written to.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"{path}: an image is written as {', '.join(SUFFIXES)}")
    write_bytes_whole(path, encoded(image, path.suffix.lower()))


def encoded(image: NDArray, suffix: str, quality: int | None = None) -> bytes:
    """Return an image as the content of a file.

    Args:
        image: Grey, BGR or, of a PNG, BGR and opacity; 8 bits.
        suffix: One of `SUFFIXES`.
        quality: Of a JPEG, 0 to 100, or how hard a PNG is packed, 0 to 9; OpenCV's own if omitted.
    """
    kind = cv2.IMWRITE_PNG_COMPRESSION if suffix == ".png" else cv2.IMWRITE_JPEG_QUALITY
    options = [] if quality is None else [kind, quality]
    return cv2.imencode(suffix, image, options)[1].tobytes()


def image_files(folder: str | Path) -> list[Path]:
    """Return the images in a folder, with image2 before image10.

    Args:
        folder: The folder; folders in it are not looked into.

    Returns:
        The paths of files that end as images do and are not hidden.

    Raises:
        DataError: If it is not a folder or cannot be read.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise DataError(f"{found_at(folder)}; a folder of images was expected")
    try:
        files = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES]
    except OSError as error:
        raise DataError(f"{folder}: cannot be read: {error.strerror or error}") from error
    return sorted((p for p in files if not p.name.startswith(".")), key=natural_key)


def natural_key(path: Path) -> list[tuple[int, str]]:
    """Return what sorts names with numbers as people do."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), part) if part.isdecimal() else (-1, part) for part in parts]

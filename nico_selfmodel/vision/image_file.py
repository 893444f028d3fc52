"""Photographs on disk."""

import re
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import DataError
from nico_selfmodel.files import write_bytes_whole

SUFFIXES = (".png", ".jpg", ".jpeg")
"""Endings of the files that count as images, in small letters."""


def read_image(path: str | Path) -> NDArray:
    """Read a photograph as the sensor stored it, whatever turn its metadata ask a viewer for.

    Args:
        path: A PNG, a JPEG, or what else OpenCV reads.

    Returns:
        Blue, green and red, 8 bits. Shape (h, w, 3).

    Raises:
        DataError: If the file is missing, not readable or not an image.
    """
    path = Path(path)
    try:
        content = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    except FileNotFoundError:
        raise DataError(f"{path}: there is no such file") from None
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror or error}") from error
    if not content.size:
        raise DataError(f"{path}: the file is empty; an image was expected")
    try:
        image = cv2.imdecode(content, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error:
        image = None
    if image is None:
        raise DataError(f"{path}: not an image that can be read; save it as PNG or JPEG")
    return image


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
    _, content = cv2.imencode(path.suffix.lower(), image)
    write_bytes_whole(path, content.tobytes())


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
        raise DataError(f"{folder}: there is no such folder of images")
    try:
        files = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES]
    except OSError as error:
        raise DataError(f"{folder}: cannot be read: {error.strerror or error}") from error
    return sorted((p for p in files if not p.name.startswith(".")), key=natural_key)


def natural_key(path: Path) -> list[tuple[int, str]]:
    """Return what sorts names with numbers as people do."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), part) if part.isdecimal() else (-1, part) for part in parts]

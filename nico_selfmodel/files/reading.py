"""Files that are read: regular ones of a size that fits, with failures in one plain line."""

import os
import stat
import sys
from os import PathLike
from pathlib import Path

from nico_selfmodel.errors import DataError

MEGABYTE = 1_000_000
LARGEST_TABLE = 256 * MEGABYTE
"""Of a CSV file [bytes]."""
LARGEST_DOCUMENT = 4 * MEGABYTE
"""Of a YAML file [bytes]."""
LARGEST_BODY = 64 * MEGABYTE
"""Of the YAML file of a body [bytes]: the covariance of some hundred parameters takes megabytes."""
LARGEST_SCENE = 256 * MEGABYTE
"""Of a JSON file [bytes]; scenes hold pictures."""
LARGEST_MESH = 256 * MEGABYTE
"""Of a PLY [bytes]."""
LARGEST_ROBOT = 16 * MEGABYTE
"""Of a URDF [bytes]."""
LARGEST_PICTURE = 256 * MEGABYTE
"""Of a PNG or JPEG [bytes]."""

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
# What a shell's <(command) hands over is a pipe, and meant to be one.
_STREAMS = ("/dev/fd/", "/proc/self/fd/", "/dev/stdin")


def read_bytes(path: Path, most: int) -> bytes:
    """Return the content of a file; what is no file is refused and not waited for.

    Args:
        path: The file, or a stream that a shell hands over (`<(command)`).
        most: Bytes that it may have.

    Raises:
        DataError: If it is missing, not readable, no regular file or larger.
    """
    try:
        if not str(path).startswith(_STREAMS):
            _check_regular(path)
        with path.open("rb") as file:
            content = file.read(most + 1)
    except FileNotFoundError:
        raise DataError(f"{path}: there is no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL byte in the name
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise DataError(f"{path}: cannot be read: {reason or error}") from error
    if len(content) > most:
        raise DataError(f"{path}: larger than {most // MEGABYTE} MB, which is more than is read")
    return content


def real_path(path: str | PathLike[str]) -> Path:
    """Return where a path leads, as far as it does: a link that leads to itself stays one.

    `Path.resolve` raises a `RuntimeError` there.
    """
    return Path(os.path.realpath(path))


def read_text(path: Path, most: int) -> str:
    """Return the text of a UTF-8 file, without a byte order mark and with its own line ends.

    Args:
        most: Bytes that it may have.

    Raises:
        DataError: If the file is missing, not readable, too large, not text in UTF-8 or empty.
    """
    return _text(read_bytes(path, most), str(path))


def read_standard_input(most: int) -> str:
    """Return the text that is piped in, with the same checks as that of a file.

    Raises:
        DataError: If it is too large, not text in UTF-8 or empty.
    """
    stream = getattr(sys.stdin, "buffer", None)  # a test's stream has text only
    content = stream.read(most + 1) if stream else sys.stdin.read(most + 1).encode()
    if len(content) > most:
        raise DataError(f"standard input: more than {most // MEGABYTE} MB")
    return _text(content, "standard input")


def _check_regular(path: Path) -> None:
    mode = path.stat().st_mode
    for is_kind, name in _KINDS:
        if is_kind(mode):
            raise DataError(f"{path}: is {name}, a file was expected")


def _text(content: bytes, where: str) -> str:
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(
            f"{where}: not UTF-8 text (byte {error.start}); save it as UTF-8 (in spreadsheets:"
            " 'CSV UTF-8')"
        ) from None
    if not text.strip():
        raise DataError(f"{where}: the file is empty")
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise DataError(f"{where}, line {line}: not text: holds a NUL byte")
    return text

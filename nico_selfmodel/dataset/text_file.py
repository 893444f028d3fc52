"""Text files as people make them: read whole, with failures in one plain line."""

from pathlib import Path

from nico_selfmodel.errors import DataError


def read_text(path: Path) -> str:
    """Return the text of a UTF-8 file, without a byte order mark and with its own line ends.

    Args:
        path: The file.

    Returns:
        Its text.

    Raises:
        DataError: If the file is missing, not readable, not UTF-8 or empty.
    """
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise DataError(f"{path}: there is no such file") from None
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise DataError(
            f"{path}: not UTF-8 text (byte {error.start}); save it as UTF-8 (in spreadsheets:"
            " 'CSV UTF-8')"
        ) from None
    if not text.strip():
        raise DataError(f"{path}: the file is empty")
    return text

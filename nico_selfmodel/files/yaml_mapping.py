"""Read a YAML mapping and take checked values out of it."""

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from nico_selfmodel.errors import DataError
from nico_selfmodel.files.reading import LARGEST_DOCUMENT, read_text
from nico_selfmodel.files.yaml_text import parse_yaml
from nico_selfmodel.names import did_you_mean, shown

SMALLEST, LARGEST = 1e-12, 1e12
"""Between these lies the size of every number that a person writes into a file of ours."""


def read_yaml_mapping(path: Path) -> dict[str, Any]:
    """Read a YAML file whose top level is a mapping.

    Raises:
        DataError: If the file cannot be read, is not YAML or holds something else.
    """
    content = parse_yaml(read_text(path, LARGEST_DOCUMENT), str(path))
    if not isinstance(content, dict):
        got = "nothing" if content is None else type(content).__name__
        raise DataError(f"{path}: expected a mapping ('key: value' lines), got {got}")
    return content


def check_keys(mapping: Mapping[str, Any], known: Iterable[str], where: str) -> None:
    """Refuse keys that nobody reads, so that a misspelt one is not ignored.

    Raises:
        DataError: If a key is not known; names the closest valid one.
    """
    known = list(known)
    for key in mapping:
        if key not in known:
            raise DataError(
                f"{where}: unknown key {shown(key)}{did_you_mean(str(key), known)};"
                f" valid keys are {', '.join(known)}"
            )


def text_value(mapping: Mapping[str, Any], key: str, where: str, default: str | None = None) -> str:
    """Return a text value.

    Args:
        where: Place for the message.
        default: Value of an absent key; None makes the key compulsory.

    Raises:
        DataError: If the key is missing or its value is not text.
    """
    value = mapping.get(key)
    value = default if value is None else value
    if value is None:
        raise DataError(f"{where}: key {key!r} is missing")
    if not isinstance(value, str):
        raise DataError(f"{where}: {key!r} must be text, got {shown(value)}; put it in quotes")
    return value


def number_value(mapping: Mapping[str, Any], key: str, where: str) -> float | None:
    """Return a finite number of a size that something real has, or None for an absent key.

    Text that is a number counts as one.

    Returns:
        The number, or None.

    Raises:
        DataError: If the value is not a finite number, or one beyond `SMALLEST` and `LARGEST`.
    """
    value = mapping.get(key)
    if value is None:
        return None
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise DataError(f"{where}: {key!r} must be a finite number, got {shown(value)}")
    if number and not SMALLEST <= abs(number) <= LARGEST:
        raise DataError(
            f"{where}: {key!r} must be 0 or of a size between {SMALLEST:g} and {LARGEST:g}, got "
            f"{number:g}"
        )
    return number


def integer_value(mapping: Mapping[str, Any], key: str, where: str) -> int | None:
    """Return a whole number, or None for an absent key.

    Returns:
        The number, or None.

    Raises:
        DataError: If the value is not a whole number.
    """
    value = mapping.get(key)
    if value is None or (isinstance(value, int) and not isinstance(value, bool)):
        return value
    raise DataError(f"{where}: {key!r} must be a whole number, got {shown(value)}")

"""Read a YAML mapping and take checked values out of it."""

import difflib
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from nico_selfmodel.dataset.text_file import read_text
from nico_selfmodel.errors import DataError
from nico_selfmodel.unique_keys import UniqueKeys


class _Loader(UniqueKeys, getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # pyright: ignore
    """Safe loading, fast where the C library is there."""


def read_yaml_mapping(path: Path) -> dict[str, Any]:
    """Read a YAML file whose top level is a mapping.

    Args:
        path: The file.

    Returns:
        The mapping.

    Raises:
        DataError: If the file cannot be read, is not YAML or holds something else.
    """
    text = read_text(path)
    try:
        content = yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        raise DataError(f"{_place(path, error)}: not valid YAML: {_problem(error)}") from None
    # PyYAML lets these through for impossible dates, values that do not fit a tag and deep nests.
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise DataError(f"{path}: not valid YAML: {error}") from None
    if not isinstance(content, dict):
        raise DataError(
            f"{path}: expected a mapping ('key: value' lines), got {type(content).__name__}"
        )
    return content


def check_keys(mapping: Mapping[str, Any], known: Iterable[str], where: str) -> None:
    """Refuse keys that nobody reads, so that a misspelt one is not ignored.

    Args:
        mapping: What was read.
        known: The valid keys.
        where: Place for the message.

    Raises:
        DataError: If a key is not known; names the closest valid one.
    """
    known = list(known)
    for key in mapping:
        if key not in known:
            raise DataError(
                f"{where}: unknown key {key!r}{did_you_mean(str(key), known)};"
                f" valid keys are {', '.join(known)}"
            )


def did_you_mean(name: str, known: Iterable[str], likeness: float = 0.6) -> str:
    """Return `, did you mean 'x'?` for the closest known name, or an empty text.

    Args:
        name: What was written.
        known: What could have been meant.
        likeness: How alike the two must be, 0 to 1.

    Returns:
        The hint, beginning with a comma.
    """
    close = _closest(name, known, likeness)
    return f", did you mean {close!r}?" if close else ""


def found_instead(name: str, found: Iterable[str]) -> str:
    """Return `, but 'x' looks like it: rename it` for a missing name, or an empty text.

    Args:
        name: What is missing.
        found: What is there.

    Returns:
        The hint, beginning with a comma.
    """
    close = _closest(name, found, 0.6)
    return f", but {close!r} looks like it: rename it" if close else ""


def text_value(mapping: Mapping[str, Any], key: str, where: str, default: str | None = None) -> str:
    """Return a text value.

    Args:
        mapping: What was read.
        key: Its key.
        where: Place for the message.
        default: Value of an absent key; None makes the key compulsory.

    Returns:
        The text.

    Raises:
        DataError: If the key is missing or its value is not text.
    """
    value = mapping.get(key)
    value = default if value is None else value
    if value is None:
        raise DataError(f"{where}: key {key!r} is missing")
    if not isinstance(value, str):
        raise DataError(f"{where}: {key!r} must be text, got {value!r}; put it in quotes")
    return value


def number_value(mapping: Mapping[str, Any], key: str, where: str) -> float | None:
    """Return a finite number, or None for an absent key.

    Text that is a number counts as one: YAML 1.1 reads `1e-3` as text.

    Args:
        mapping: What was read.
        key: Its key.
        where: Place for the message.

    Returns:
        The number, or None.

    Raises:
        DataError: If the value is not a finite number.
    """
    value = mapping.get(key)
    if value is None:
        return None
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise DataError(f"{where}: {key!r} must be a finite number, got {value!r}")
    return number


def integer_value(mapping: Mapping[str, Any], key: str, where: str) -> int | None:
    """Return a whole number, or None for an absent key.

    Args:
        mapping: What was read.
        key: Its key.
        where: Place for the message.

    Returns:
        The number, or None.

    Raises:
        DataError: If the value is not a whole number.
    """
    value = mapping.get(key)
    if value is None or (isinstance(value, int) and not isinstance(value, bool)):
        return value
    raise DataError(f"{where}: {key!r} must be a whole number, got {value!r}")


def _closest(name: str, others: Iterable[str], likeness: float) -> str | None:
    by_lower_case = {other.lower(): other for other in others}
    close = difflib.get_close_matches(name.lower(), by_lower_case, n=1, cutoff=likeness)
    return by_lower_case[close[0]] if close else None


def _place(path: Path, error: yaml.YAMLError) -> str:
    mark = getattr(error, "problem_mark", None)
    return f"{path}, line {mark.line + 1}" if mark else str(path)


def _problem(error: yaml.YAMLError) -> str:
    return str(getattr(error, "problem", None) or error).splitlines()[0]

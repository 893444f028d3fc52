"""Numbers of a self-model's file: what no body has is refused, with the place where it stands."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from numpy.typing import NDArray

from nico_selfmodel.arrays import as_floats
from nico_selfmodel.files.yaml_mapping import LARGEST
from nico_selfmodel.names import shown

LARGEST_SIGMA_M = 100.0
"""Of a measured coordinate about a model, however bad [m]."""
LARGEST_SIGMA_PX = 1e5
"""Of a pixel coordinate about a model, however bad [px]."""


def numbers(values: Any, name: str, most: float = LARGEST) -> NDArray:
    """Return numbers as an array.

    Args:
        values: A number, or lists of them.
        name: What the message calls them.
        most: How large they may be.

    Returns:
        The array, finite.

    Raises:
        ValueError: If something else is among them, or one is too large.
    """
    for value in _leaves(values):
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"{name} must be numbers, got {shown(value)}")
        if not math.isfinite(value):
            raise ValueError(f"{name} must be finite, got {value}")
        if abs(value) > most:
            raise ValueError(f"{name} must be at most {most:g}, got {value:g}")
    return as_floats(values, name)


def number(value: Any, name: str, most: float = LARGEST) -> float:
    """Return one number.

    Raises:
        ValueError: If it is none, or too large.
    """
    found = numbers(value, name, most)
    if found.shape != ():
        raise ValueError(f"{name} must be a number, got {shown(value)}")
    return float(found)


def sigma(value: Any, name: str, most: float) -> float | None:
    """Return a standard deviation, None where it is not known.

    Raises:
        ValueError: If it is no finite number between 0 and `most`.
    """
    if value is None:
        return None
    found = number(value, name, most)
    if found < 0.0:
        raise ValueError(f"{name} must not be negative, got {found:g}")
    return found


def mapping(value: Any, name: str) -> dict[str, Any]:
    """Return a mapping whose keys are text and whose numbers are finite; empty for None.

    Raises:
        ValueError: If it is something else.
    """
    value = {} if value is None else value
    if not isinstance(value, dict) or not all(isinstance(key, str) for key in value):
        raise ValueError(f"{name} must be a mapping of names, got {shown(value)}")
    for leaf in _leaves(value):
        if isinstance(leaf, float) and not math.isfinite(leaf):
            raise ValueError(f"{name} must hold finite numbers, got {leaf}")
    return value


def last_mapping(document: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the mapping with which a document ends, empty where nothing is known of it.

    Raises:
        ValueError: If it is not there, as of a file that was cut off, or something else.
    """
    if document.get(name) is None:
        raise ValueError(
            f"it ends before {name!r} ({{}} where none is known), as a file does that was cut off: "
            "copy it again, or learn it anew"
        )
    return mapping(document[name], name)


def mappings(value: Any, name: str) -> list[dict[str, Any]]:
    """Return a list of mappings.

    Raises:
        ValueError: If it is something else.
    """
    if not isinstance(value, list) or not all(isinstance(entry, dict) for entry in value):
        raise ValueError(f"{name} must be a list of mappings, got {shown(value)}")
    return value


def texts(values: Any, name: str) -> tuple[str, ...]:
    """Return words.

    Raises:
        ValueError: If something else is among them.
    """
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        raise ValueError(f"{name} must be a list of names, got {shown(values)}")
    return tuple(values)


def damage(error: Exception) -> str:
    """Return what is wrong with a document, in the words of people, by what reading it raised."""
    if isinstance(error, KeyError):
        return f"{error} is missing"
    if isinstance(error, ValueError):
        return " ".join(str(error).split())
    return "a value in it is of another kind than what belongs there"


def _leaves(value: Any) -> Iterator[Any]:
    """Yield what is no list and no mapping, in order."""
    inside = value.values() if isinstance(value, Mapping) else value
    if isinstance(value, Mapping | list | tuple):
        for item in inside:
            yield from _leaves(item)
    else:
        yield value

"""Numbers of a self-model's file: what no body has is refused, with the place where it stands."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    return np.array(values, dtype=float)


def sigma(value: Any, name: str, most: float) -> float | None:
    """Return a standard deviation, None where it is not known.

    Raises:
        ValueError: If it is no finite number between 0 and `most`.
    """
    if value is None:
        return None
    found = float(numbers(value, name, most))
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


def fit(value: Any) -> dict[str, Any]:
    """Return the statistics of a fit; what commands go by is checked.

    Raises:
        ValueError: If `readings`, `expected_error` or `joint_sigma_rad` is not what it should be.
    """
    found = mapping(value, "fit")
    for joint, ends in mapping(found.get("readings"), "fit.readings").items():
        lowest_and_highest = numbers(ends, f"fit.readings of {joint}")
        if lowest_and_highest.shape != (2,):
            raise ValueError(f"fit.readings of {joint} must be two numbers, got {shown(ends)}")
    expected = mapping(found.get("expected_error"), "fit.expected_error")
    if expected and not all(float(numbers(expected[key], key)) > 0.0 for key in ("n", "median_m")):
        raise ValueError(f"fit.expected_error must have positive numbers, got {shown(expected)}")
    sigma(found.get("joint_sigma_rad"), "fit.joint_sigma_rad", math.pi)
    return found


def _leaves(value: Any) -> Iterator[Any]:
    """Yield what is no list and no mapping, in order."""
    inside = value.values() if isinstance(value, Mapping) else value
    if isinstance(value, Mapping | list | tuple):
        for item in inside:
            yield from _leaves(item)
    else:
        yield value

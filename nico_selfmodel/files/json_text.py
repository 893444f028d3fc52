"""JSON that is read: finite numbers only, no key twice, no deeper than the stack."""

import json
import math
from typing import Any

from nico_selfmodel.errors import DataError
from nico_selfmodel.names import shown

_LONGEST_INTEGER = 40


def parse_json(text: str, where: str) -> Any:
    """Return what a JSON document says.

    Raises:
        DataError: If it is not JSON, or holds what no document of ours does: a key twice, `NaN`,
            a number too large, nests too deep.
    """
    try:
        return json.loads(
            text,
            parse_constant=_refuse_number,
            parse_float=_finite,
            parse_int=_integer,
            object_pairs_hook=_unique,
        )
    except ValueError as error:
        raise DataError(f"{where} is not valid JSON: {error}") from None
    except RecursionError:
        raise DataError(f"{where} is not valid JSON: nested too deep") from None


def _finite(text: str) -> float:
    number = float(text)
    return number if math.isfinite(number) else _refuse_number(text)


def _integer(text: str) -> int:
    return int(text) if len(text) <= _LONGEST_INTEGER else _refuse_number(text)


def _refuse_number(text: str) -> Any:
    raise ValueError(f"{shown(text)} is no number that can be written down")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"key {shown(twice)} stands twice")
    return found

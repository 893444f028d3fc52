"""Parameters of a test, of which the plain run takes the first ones and the slow run the rest."""

from collections.abc import Iterable
from typing import Any

import pytest


def slow_rest(values: Iterable[Any], plain: int = 1) -> list[Any]:
    """Return parameters for `parametrize`; a tuple is one value for each name."""
    values = list(values)
    return [*values[:plain], *(_slow(value) for value in values[plain:])]


def _slow(value: Any) -> Any:
    """Return a parameter, or a `pytest.param` with its id and marks, as a slow one."""
    if hasattr(value, "marks"):
        return pytest.param(*value.values, marks=[*value.marks, pytest.mark.slow], id=value.id)
    each = value if isinstance(value, tuple) else (value,)
    return pytest.param(*each, marks=pytest.mark.slow)

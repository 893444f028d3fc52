"""Parameters of a test, of which the plain run takes the first ones and the slow run the rest."""

from collections.abc import Iterable
from typing import Any

import pytest


def slow_rest(values: Iterable[Any], plain: int = 1) -> list[Any]:
    """Return parameters for `parametrize`; a tuple is one value for each name."""
    values = list(values)
    rest = [value if isinstance(value, tuple) else (value,) for value in values[plain:]]
    return [*values[:plain], *(pytest.param(*each, marks=pytest.mark.slow) for each in rest)]

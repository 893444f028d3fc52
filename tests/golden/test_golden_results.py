"""Results of stored data stay what they are, number for number."""

import json
from collections.abc import Iterator
from typing import Any

import pytest

from .cases import CASES, stored

OF_SIGMA = 1e-6
"""What a parameter may change by, over its sigma."""
RELATIVE = 1e-9
"""What other numbers may."""
_OF_THE_DAY = ("seconds", "history")


def numbers(document: Any, place: tuple = ()) -> Iterator[tuple[tuple, Any]]:
    """Yield what stands at each place of a document but for times."""
    if isinstance(document, dict):
        for key in sorted(document):
            if key not in _OF_THE_DAY:
                yield from numbers(document[key], (*place, key))
    elif isinstance(document, list):
        for i, entry in enumerate(document):
            yield from numbers(entry, (*place, i))
    else:
        yield place, document


def slack(before: dict, place: tuple, value: float) -> float:
    """Return what the number at a place may be off by."""
    sigma = None
    if place[0] == "parameters" and place[-1] == "value":
        sigma = before["parameters"][place[1]].get("sigma")
    return RELATIVE * abs(value) if sigma is None else OF_SIGMA * sigma


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_results_of_stored_data_are_what_they_were(name):
    before = json.loads(stored(name).read_text())
    after = json.loads(json.dumps(CASES[name](), allow_nan=False))
    old, new = dict(numbers(before)), dict(numbers(after))
    assert set(new) == set(old)
    changed = {}
    for place, value in old.items():
        same = value == new[place]
        if isinstance(value, float) and isinstance(new[place], int | float):
            same = abs(value - new[place]) <= max(slack(before, place, value), 1e-12)
        if not same:
            changed[place] = (value, new[place])
    assert not changed

"""Cards of markers in a room as a YAML file, `nico-cards/1`.

`cards` is a list: each has `first` (id of its first marker), `xyz_m` and `rpy_deg` (where its frame
is, as a URDF's `origin` says it), and, where they are not the usual ones, `columns`, `rows`,
`side_mm`, `pitch_mm` and `family`.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import DataError
from nico_selfmodel.files.yaml_mapping import (
    check_keys,
    integer_value,
    number_value,
    read_yaml_mapping,
    text_value,
)
from nico_selfmodel.geometry.rotation import rotation_from_rpy
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.names import listed, shown
from nico_selfmodel.vision.markers.tag_card import TagCard

FORMAT = "nico-cards/1"
_KEYS = ("first", "xyz_m", "rpy_deg", "columns", "rows", "side_mm", "pitch_mm", "family")


def load_cards(path: str | Path, taken: Iterable[int] = ()) -> tuple[TagCard, ...]:
    """Read the cards of a room.

    Args:
        taken: Ids of markers that are elsewhere.

    Returns:
        The cards, in the frame that the file's poses are in.

    Raises:
        DataError: If the file is missing or not valid, or an id stands twice; names file and key.
    """
    path = Path(path)
    content = read_yaml_mapping(path)
    if content.get("format") != FORMAT:
        raise DataError(
            f"{path}: not the cards of a room: format is {shown(content.get('format'))}, expected "
            f"{FORMAT!r}"
        )
    check_keys(content, ("format", "cards"), str(path))
    entries = content.get("cards")
    if not isinstance(entries, list) or not entries:
        raise DataError(
            f"{path}: 'cards' must be a list with one entry a card, got {shown(entries)}"
        )
    cards = tuple(_card(entry, f"{path}, card {k}") for k, entry in enumerate(entries, 1))
    ids = [*taken, *(i for card in cards for i in card.ids)]
    if twice := sorted({i for i in ids if ids.count(i) > 1}):
        raise DataError(
            f"{path}: the markers {listed(map(str, twice))} would be there twice: give each card "
            f"ids of its own, {listed(map(str, sorted(taken))) or 'none'} are on the hands"
        )
    return cards


def _card(entry: Any, where: str) -> TagCard:
    if not isinstance(entry, dict):
        raise DataError(f"{where}: expected a mapping ('key: value' lines), got {shown(entry)}")
    check_keys(entry, _KEYS, where)
    first = integer_value(entry, "first", where)
    if first is None or first < 0:
        raise DataError(f"{where}: 'first' must be the id of its first marker, got {shown(first)}")
    roll, pitch, yaw = np.radians(_triple(entry, "rpy_deg", where))
    options: dict[str, Any] = {
        key: value
        for key in ("columns", "rows")
        if (value := integer_value(entry, key, where)) is not None
    }
    for key, name in (("side_mm", "side"), ("pitch_mm", "pitch")):
        if (length := number_value(entry, key, where)) is not None:
            options[name] = 1e-3 * length
    if "family" in entry:
        options["family"] = text_value(entry, "family", where)
    X_WK = transform(rotation_from_rpy(roll, pitch, yaw), _triple(entry, "xyz_m", where))
    try:
        return TagCard(first, X_WK, **options)
    except (ValueError, KeyError) as error:
        raise DataError(f"{where}: {error}") from None


def _triple(entry: Mapping[str, Any], key: str, where: str) -> NDArray:
    """Return three numbers. Shape (3,)."""
    value = entry.get(key)
    if not isinstance(value, list) or len(value) != 3:
        raise DataError(f"{where}: {key!r} must be three numbers, got {shown(value)}")
    parts = [number_value({key: one}, key, where) for one in value]
    if any(part is None for part in parts):
        raise DataError(f"{where}: {key!r} must be three numbers, got {shown(value)}")
    return np.array(parts, dtype=float)

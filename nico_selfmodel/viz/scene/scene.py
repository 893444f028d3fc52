"""One plain description of what to draw, for any viewer and for files."""

import base64
import itertools
import json
import re
from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import frozen_array
from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.files.folder_contents import found_at
from nico_selfmodel.files.json_text import parse_json
from nico_selfmodel.files.reading import LARGEST_SCENE, read_text
from nico_selfmodel.model.document_values import damage
from nico_selfmodel.names import listed, refuse_unknown, shown
from nico_selfmodel.viz.figures.rgba import Rgba
from nico_selfmodel.viz.scene.scene_items import ITEM_KINDS, Item

FORMAT = "nico-scene/1"
SCENE_FILE = "scene.json"
"""Beside a result's report."""
ROOT = "/self_model"
"""Every viewer hangs a scene here, so that a new one replaces the old one."""
FIELD_OF_VIEW = float(np.radians(40.0))
"""Of every camera, from the bottom to the top of the picture [rad]."""


@dataclass(frozen=True)
class LegendEntry:
    """What a colour stands for. Scenes hold no text: whoever shows one shows this beside it."""

    label: str
    """For people."""
    color: Rgba
    """As drawn."""
    colors: tuple[Rgba, ...] = ()
    """From the least to the largest, where the colour is a scale."""


@dataclass(frozen=True, eq=False)
class Camera:
    """Where a scene is first seen from."""

    p_WC: NDArray
    """The camera [m]. Shape (3,)."""
    p_WT: NDArray
    """What it looks at [m]. Shape (3,)."""

    def __post_init__(self) -> None:
        """Check shapes and make the arrays read-only."""
        for name in ("p_WC", "p_WT"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (3,), name))


@dataclass(frozen=True, eq=False)
class Scene:
    """Shapes, a camera and a legend. z is up."""

    title: str
    """What is shown."""
    items: tuple[Item, ...]
    """Shapes, each with a path of its own."""
    camera: Camera
    """First view."""
    legend: tuple[LegendEntry, ...] = ()
    """What the colours stand for, with the factors of what is drawn larger than it is."""

    def __post_init__(self) -> None:
        """Check that no two items share a path."""
        paths = [item.path for item in self.items]
        repeated = sorted({path for path in paths if paths.count(path) > 1})
        if repeated:
            raise ValueError(f"paths must differ, got {listed(repeated)} more than once")

    @property
    def paths(self) -> tuple[str, ...]:
        """Path of every item."""
        return tuple(item.path for item in self.items)

    def under(self, path: str) -> tuple[Item, ...]:
        """Return the item at a path and all items below it."""
        return tuple(i for i in self.items if i.path == path or i.path.startswith(f"{path}/"))

    def to_json(self) -> str:
        """Return the scene as text; floats round-trip exactly."""
        document = {
            "format": FORMAT,
            "title": self.title,
            "camera": {"p_WC": self.camera.p_WC.tolist(), "p_WT": self.camera.p_WT.tolist()},
            "legend": [vars(entry) for entry in self.legend],
            "items": [_item_document(item) for item in self.items],
        }
        return json.dumps(document, allow_nan=False, separators=(",", ":")) + "\n"

    @classmethod
    def from_json(cls, text: str) -> "Scene":
        """Read a scene.

        Args:
            text: What `to_json` returned.

        Raises:
            ModelError: If the text is not a scene, or one of another version.
        """
        try:
            document = parse_json(text, "the scene")
        except DataError as error:
            raise ModelError(str(error)) from error
        found = document.get("format") if isinstance(document, dict) else None
        if found != FORMAT:
            raise ModelError(
                f"a scene must have format {FORMAT}, got {shown(found)}: learn it anew"
            )
        try:
            return cls(
                document["title"],
                tuple(_item(entry) for entry in document["items"]),
                Camera(**document["camera"]),
                tuple(_legend_entry(entry) for entry in document["legend"]),
            )
        except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
            raise ModelError(f"the scene is damaged: {damage(error)}") from error


def load_scene(result: str | Path) -> Scene:
    """Read the scene of a result folder, so that it can be drawn without learning again.

    Args:
        result: The folder, or its `scene.json`.

    Raises:
        ModelError: If there is none, or it is not valid.
    """
    path = Path(result)
    inside = path / SCENE_FILE
    if not path.exists() or (path.is_dir() and not inside.exists()):
        raise ModelError(
            f"{found_at(path)}; expected a result folder with {SCENE_FILE}, or that file"
        )
    path = inside if path.is_dir() else path
    if path.suffix != inside.suffix:
        raise ModelError(f"{path} is no scene; give the folder, or its {SCENE_FILE}")
    try:
        text = read_text(path, LARGEST_SCENE)
    except DataError as error:
        reason = str(error).removeprefix(f"{path}: ").removeprefix("cannot be read: ")
        raise ModelError(f"{path} cannot be read: {reason}") from error
    try:
        return Scene.from_json(text)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from error


def path_names(texts: Iterable[str]) -> list[str]:
    """Return texts as names in a path, all different: letters, digits, `_`, `.` and `-` stay.

    >>> path_names(["elbow", "a/b", "a b"])
    ['elbow', 'a_b', 'a_b_2']
    """
    names: list[str] = []
    for text in texts:
        name = unique = re.sub(r"[^\w.-]+", "_", text) or "_"
        copies = itertools.count(2)
        while unique in names:
            unique = f"{name}_{next(copies)}"
        names.append(unique)
    return names


def _item_document(item: Item) -> dict[str, Any]:
    document: dict[str, Any] = {"kind": type(item).__name__.lower()}
    for entry in fields(item):
        value = getattr(item, entry.name)
        if value is None or (entry.name == "X_WI" and np.array_equal(value, np.eye(4))):
            continue
        document[entry.name] = _plain(value)
    return document


def _plain(value: Any) -> Any:
    """Return a field as JSON has it."""
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    return value.tolist() if isinstance(value, np.ndarray) else value


def _item(document: dict[str, Any]) -> Item:
    values = dict(document)
    kind = values.pop("kind")
    refuse_unknown("item", kind, ITEM_KINDS)
    if "image" in values:
        values["image"] = base64.b64decode(values["image"], validate=True)
    return ITEM_KINDS[kind](**values)


def _legend_entry(document: dict[str, Any]) -> LegendEntry:
    colors = tuple(tuple(color) for color in document["colors"])
    return LegendEntry(document["label"], tuple(document["color"]), colors)

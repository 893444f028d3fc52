"""A learned shape on disk: a folder `body` beside the self-model, one PLY a link and an index."""

import re
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.files.reading import LARGEST_MESH, read_bytes
from nico_selfmodel.files.whole import folder_in_place_of
from nico_selfmodel.files.yaml_mapping import check_keys, read_yaml_mapping
from nico_selfmodel.files.yaml_text import yaml_text
from nico_selfmodel.geometry.triangle_mesh import TriangleMesh
from nico_selfmodel.model.document_values import damage, mappings, number, numbers
from nico_selfmodel.model.shape.link_shape import COLOR_STEPS, BodyShape, LinkShape
from nico_selfmodel.model.shape.ply import parse_ply, ply_bytes
from nico_selfmodel.names import shown

FORMAT = "nico-shape/1"
FOLDER = "body"
"""Beside a self-model."""
INDEX = "shape.yaml"
"""In that folder."""
UNSEEN = 128
"""Grey, which stands in files for the colour of what was never seen, of 255."""
UNITS = {"vertices": "m", "sigma": "m", "colors": f"1/{COLOR_STEPS}"}
WORLD = "W of the self-model beside this folder"
_KEYS = ("link", "file", "X_WF", "vertices", "seen")
_COLUMNS = ("x", "y", "z", "red", "green", "blue", "sigma", "looks", "seen")
_PLAIN = re.compile(r"\w[\w-]{0,99}", re.ASCII)
_FILE = re.compile(r"\w[\w.-]{0,120}", re.ASCII)
_FARTHEST = 1e3
"""That a vertex may be from the origin of its link, and a link from the world's [m]."""


def save_shape(shape: BodyShape, folder: str | PathLike[str]) -> None:
    """Write a learned shape, whole or not at all; one that is there is replaced.

    The same shape gives the same bytes.

    Args:
        folder: `body` beside the self-model.

    Raises:
        OSError: If it cannot be written.
    """
    files = file_names(shape, ".ply")
    index = {
        "format": FORMAT,
        "world": WORLD,
        "units": UNITS,
        "links": [_entry(shape, link, file) for link, file in files.items()],
    }
    with folder_in_place_of(Path(folder)) as fresh:
        for link, file in files.items():
            (fresh / file).write_bytes(_ply(shape.links[link]))
        (fresh / INDEX).write_text(yaml_text(index), encoding="utf-8", newline="\n")


def load_shape(folder: str | PathLike[str]) -> BodyShape:
    """Read a learned shape.

    Args:
        folder: What `save_shape` wrote.

    Returns:
        The shape, equal to the last bit to the one saved.

    Raises:
        ModelError: If something is missing, of another format, or not valid; names the file.
    """
    index = Path(folder) / INDEX
    try:
        document = read_yaml_mapping(index)
        _check_index(document, index)
        entries = mappings(document["links"], "links")
        read = [_link(entry, index) for entry in entries]
        names = [shape.link for shape, _ in read]
        if len(set(names)) != len(names):
            raise ValueError("a link is named twice")
        return BodyShape(
            {shape.link: shape for shape, _ in read}, {shape.link: pose for shape, pose in read}
        )
    except DataError as error:
        raise ModelError(f"{error}: a learned shape was expected") from error
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ModelError(f"{index} is not a valid learned shape: {damage(error)}") from error


def shape_beside(model: str | PathLike[str]) -> BodyShape | None:
    """Read the learned shape that lies beside a self-model; None where there is none.

    Args:
        model: The self-model's file or result folder.

    Raises:
        ModelError: If there is one that is not valid.
    """
    path = Path(model)
    folder = (path if path.is_dir() else path.parent) / FOLDER
    return load_shape(folder) if folder.exists() else None


def file_names(shape: BodyShape, end: str) -> dict[str, str]:
    """Return a file's name for each link: its own, or a number where no file may be called so.

    Args:
        end: Of the names, with a dot.
    """
    return {
        link: link + end if _PLAIN.fullmatch(link) else f"link.{k}{end}"
        for k, link in enumerate(shape.links)
    }


def _entry(shape: BodyShape, link: str, file: str) -> dict[str, Any]:
    own = shape.links[link]
    return {
        "link": link,
        "file": file,
        "X_WF": shape.X_WF[link].tolist(),
        "vertices": len(own.seen),
        "seen": int(own.seen.sum()),
    }


def _ply(shape: LinkShape) -> bytes:
    colors = np.where(shape.seen[:, None], COLOR_STEPS * shape.colors, UNSEEN)
    columns = {
        **dict(zip("xyz", shape.mesh.vertices.T, strict=True)),
        **dict(zip(("red", "green", "blue"), np.round(colors).astype("u1").T, strict=True)),
        "sigma": shape.sigma,
        "looks": shape.looks.astype("u4"),
        "seen": shape.seen.astype("u1"),
    }
    comments = (
        "x, y, z in the frame of the link [m]; sigma along the normal [m], nan where never seen",
        "looks: pictures that show the vertex or its outline; seen: 1 where its place is claimed",
    )
    return ply_bytes(columns, shape.mesh.triangles, comments)


def _check_index(document: Mapping[str, Any], index: Path) -> None:
    """Refuse what is not an index of ours, or of another version."""
    if document.get("format") != FORMAT:
        raise ModelError(
            f"{index} has format {shown(document.get('format'))}, expected {FORMAT}: learn the "
            "shape anew with `nico-selfmodel learn --shape`"
        )
    check_keys(document, ("format", "world", "units", "links"), str(index))
    for key, known in (("units", UNITS), ("world", WORLD)):
        if document.get(key) != known:
            raise ValueError(f"{key} must be {known}, got {shown(document.get(key))}")


def _link(entry: Mapping[str, Any], index: Path) -> tuple[LinkShape, np.ndarray]:
    """Return one link's shape and pose."""
    check_keys(entry, _KEYS, str(index))
    link, file = entry["link"], entry["file"]
    if not isinstance(file, str) or not _FILE.fullmatch(file):
        raise ValueError(f"file of {shown(link)} must be a name in this folder, got {shown(file)}")
    path = index.parent / file
    columns, triangles = parse_ply(read_bytes(path, LARGEST_MESH), str(path), _COLUMNS)
    vertices = np.stack([columns[name] for name in "xyz"], axis=1).astype(float)
    if not (np.abs(vertices) < _FARTHEST).all():
        raise ValueError(f"vertices in {file} must be finite and within {_FARTHEST:g} m")
    if not np.isin(columns["seen"], (0, 1)).all():
        raise ValueError(f"seen in {file} must be 0 or 1")
    colors = np.stack([columns[name] for name in ("red", "green", "blue")], axis=1)
    shape = LinkShape(
        link,
        TriangleMesh(vertices, triangles),
        columns["sigma"].astype(float),
        colors.astype(float) / COLOR_STEPS,
        columns["looks"],
        columns["seen"] == 1,
    )
    for key, count in (("vertices", len(shape.seen)), ("seen", int(shape.seen.sum()))):
        if number(entry[key], key) != count:
            raise ValueError(f"{file} holds {count} {key}, the index says {entry[key]}")
    return shape, numbers(entry["X_WF"], f"X_WF of {link}", _FARTHEST)

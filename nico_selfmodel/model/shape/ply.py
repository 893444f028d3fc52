"""Triangle meshes as binary PLY: the columns of its vertices, and its triangles."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import DataError
from nico_selfmodel.names import listed, shown

_TYPES = {
    "char": "<i1", "uchar": "<u1", "short": "<i2", "ushort": "<u2", "int": "<i4", "uint": "<u4",
    "float": "<f4", "double": "<f8", "int8": "<i1", "uint8": "<u1", "int16": "<i2",
    "uint16": "<u2", "int32": "<i4", "uint32": "<u4", "float32": "<f4", "float64": "<f8",
}  # fmt: skip
"""Of a property, in both spellings that are in use -> numpy's."""
_WORDS = {np.dtype(code): word for word, code in reversed(_TYPES.items())}
_FORMAT = "binary_little_endian"
_HEADER = re.compile(rb"ply\r?\n(.{0,65536}?)\nend_header\r?\n", re.DOTALL)
_INDICES = ("vertex_indices", "vertex_index")
_MOST = 100_000_000
"""Vertices or triangles of a file, which no file that is read can hold."""


def ply_bytes(columns: Mapping[str, NDArray], triangles: NDArray, comments: Iterable[str]) -> bytes:
    """Return a mesh as a binary PLY.

    Args:
        columns: Name -> values of all vertices, in the type in which they are kept. (V,) each.
        triangles: Numbers of vertices. Shape (T, 3).
        comments: Lines for people.
    """
    types = [(name, np.asarray(values).dtype.newbyteorder("<")) for name, values in columns.items()]
    size = len(next(iter(columns.values())))
    rows = np.zeros(size, dtype=types)
    for name, values in columns.items():
        rows[name] = values
    faces = np.zeros(len(triangles), dtype=_face("<u1", "<i4"))
    faces["count"], faces["corners"] = 3, triangles
    lines = [
        "ply",
        f"format {_FORMAT} 1.0",
        *(f"comment {line}" for line in comments),
        f"element vertex {size}",
        *(f"property {_WORDS[np.dtype(kind)]} {name}" for name, kind in types),
        f"element face {len(triangles)}",
        f"property list uchar int {_INDICES[0]}",
        "end_header\n",
    ]
    return "\n".join(lines).encode("ascii", "replace") + rows.tobytes() + faces.tobytes()


def parse_ply(
    content: bytes, where: str, wanted: Iterable[str]
) -> tuple[dict[str, NDArray], NDArray]:
    """Return what a binary PLY of triangles holds.

    Args:
        where: Place for messages.
        wanted: Properties that its vertices must have; others are not returned.

    Returns:
        Name -> values of all vertices, in the file's own types, shape (V,) each; numbers of the
        vertices of each triangle, shape (T, 3).

    Raises:
        DataError: If it is no binary PLY, lacks a property or ends too early or too late, or not
            all faces are triangles of vertices that there are.
    """
    header, body = _split(content, where)
    vertices, faces = header.vertices, header.faces
    missing = [name for name in wanted if name not in (vertices.names or ())]
    if missing:
        raise DataError(
            f"{where}: its vertices lack {listed(missing)}, they have "
            f"{listed(vertices.names or ['nothing'])}: learn the shape anew"
        )
    first = header.size * vertices.itemsize
    expected = first + header.count * faces.itemsize
    if len(body) != expected:
        raise DataError(
            f"{where}: {len(body)} bytes after the header, {header.size} vertices and "
            f"{header.count} triangles take {expected}: it was cut off, or not all faces are "
            "triangles"
        )
    rows = np.frombuffer(body[:first], vertices)
    found = np.frombuffer(body[first:], faces)
    if (found["count"] != 3).any():
        raise DataError(f"{where}: a face of {int(found['count'].max())} corners, 3 were expected")
    triangles = found["corners"].astype(np.int64)
    if triangles.size and not (triangles.min() >= 0 and triangles.max() < header.size):
        raise DataError(
            f"{where}: triangles name vertices from {triangles.min()} to {triangles.max()}, there "
            f"are 0 to {header.size - 1}"
        )
    return {name: rows[name].copy() for name in wanted}, triangles


@dataclass(frozen=True)
class _Header:
    """What a header says."""

    size: int
    vertices: np.dtype
    count: int
    faces: np.dtype


def _face(count: str, corner: str) -> np.dtype:
    return np.dtype([("count", count), ("corners", corner, (3,))])


def _split(content: bytes, where: str) -> tuple[_Header, bytes]:
    """Return the header, and what follows it."""
    found = _HEADER.match(content)
    if found is None:
        raise DataError(f"{where}: not a PLY: it begins {shown(content[:12])}, expected 'ply'")
    lines = [line.split() for line in found[1].decode("ascii", "replace").splitlines()]
    lines = [words for words in lines if words and words[0] not in ("comment", "obj_info")]
    if not lines or lines[0] != ["format", _FORMAT, "1.0"]:
        got = shown(" ".join(lines[0])) if lines else "nothing"
        raise DataError(f"{where}: expected `format {_FORMAT} 1.0`, got {got}: save it as that")
    return _header(lines[1:], where), content[found.end() :]


def _header(lines: list[list[str]], where: str) -> _Header:
    """Return what the lines after the format say: vertices, then faces, nothing else."""
    sizes: dict[str, int] = {}
    columns: list[tuple[str, str]] = []
    corners: np.dtype | None = None
    for words in lines:
        match words:
            case ["element", ("vertex" | "face") as name, size] if name not in sizes:
                sizes[name] = _whole(size, where)
            case ["property", kind, name] if list(sizes) == ["vertex"] and kind in _TYPES:
                columns.append((name, _TYPES[kind]))
            case ["property", "list", count, kind, name] if (
                name in _INDICES and {count, kind} <= set(_TYPES) and corners is None
            ):
                corners = _face(_TYPES[count], _TYPES[kind])
            case _:
                raise DataError(f"{where}: its header says {shown(' '.join(words))}: not read here")
    names = [name for name, _ in columns]
    if list(sizes) != ["vertex", "face"] or corners is None or len(set(names)) != len(names):
        raise DataError(
            f"{where}: its header must name vertices, each property once, and then triangles"
        )
    if any(corners[part].base.kind == "f" for part in ("count", "corners")):
        raise DataError(f"{where}: numbers of vertices must be whole")
    return _Header(sizes["vertex"], np.dtype(columns), sizes["face"], corners)


def _whole(text: str, where: str) -> int:
    if not re.fullmatch(r"[0-9]{1,9}", text) or int(text) > _MOST:
        raise DataError(f"{where}: its header counts {shown(text)}, a whole number was expected")
    return int(text)

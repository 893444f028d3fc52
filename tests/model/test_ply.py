"""Meshes as binary PLY."""

import contextlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from nico_selfmodel.errors import DataError
from nico_selfmodel.model.shape.ply import parse_ply, ply_bytes

TYPES = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
COLUMNS = {"x": np.array([0.1, 2.0, 3.0]), "seen": np.array([1, 0, 1], "u1")}
TRIANGLES = np.array([[0, 1, 2], [2, 1, 0]])
SOUND = ply_bytes(COLUMNS, TRIANGLES, ["made by hand"])


@st.composite
def meshes(draw):
    size = draw(st.integers(1, 20))
    names = draw(st.lists(st.from_regex(r"[a-z]{1,6}", fullmatch=True), unique=True, min_size=1))
    columns = {name: draw(arrays(draw(st.sampled_from(TYPES)), size)) for name in names}
    shape = (draw(st.integers(0, 30)), 3)
    return columns, draw(arrays("i8", shape, elements=st.integers(0, size - 1)))


@pytest.mark.slow
@given(meshes())
def test_every_mesh_survives_the_round_trip_to_the_last_bit(mesh):
    columns, triangles = mesh
    found, again = parse_ply(ply_bytes(columns, triangles, ()), "it", columns)
    np.testing.assert_array_equal(again, triangles)
    for name, values in columns.items():
        assert found[name].tobytes() == values.tobytes()


def test_a_mesh_that_another_program_wrote_is_read():
    header, body = SOUND.split(b"end_header\n", 1)
    header = header.replace(b"vertex_indices", b"vertex_index").replace(
        b"uchar seen", b"uint8 seen"
    )
    other = (header + b"end_header\n").replace(b"\n", b"\r\n") + body
    found, triangles = parse_ply(other, "it", ["x"])
    assert list(found) == ["x"]
    np.testing.assert_array_equal(triangles, TRIANGLES)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "not a PLY"),
        (b"solid ascii\n", "not a PLY"),
        (SOUND.replace(b"binary_little_endian", b"ascii"), "expected `format binary_little"),
        (SOUND[:-1], "it was cut off"),
        (SOUND + b"\0", "it was cut off"),
        (SOUND.replace(b"property uchar seen\n", b""), "lack seen"),
        (SOUND.replace(b"vertex 3", b"vertex 3000000000"), "counts '3000000000'"),
        (SOUND.replace(b"vertex 3", b"vertex -3"), "counts '-3'"),
        (SOUND.replace(b"double x", b"string x"), "not read here"),
        (SOUND.replace(b"element face", b"element edge"), "not read here"),
        (SOUND.replace(b"uchar seen", b"double x"), "each property once"),
        (SOUND.replace(b"uchar int vertex", b"uchar float vertex"), "must be whole"),
        (SOUND[:-13] + b"\4" + SOUND[-12:], "a face of 4 corners"),
        (SOUND[:-4] + b"\7\0\0\0", "from 0 to 7"),
    ],
)
def test_a_bad_file_is_refused_in_one_line_that_names_it(content, words):
    with pytest.raises(DataError) as raised:
        parse_ply(content, "head.ply", COLUMNS)
    message = str(raised.value)
    assert message.startswith("head.ply: ")
    assert words in message
    assert "\n" not in message


@given(st.binary(max_size=40), st.integers(0, len(SOUND)))
def test_no_bytes_end_in_anything_but_a_mesh_or_a_refusal(extra, cut):
    with contextlib.suppress(DataError):
        parse_ply(SOUND[:cut] + extra + SOUND[cut + len(extra) :], "it", COLUMNS)

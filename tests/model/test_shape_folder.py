"""Learned shapes on disk."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.triangle_mesh import TriangleMesh
from nico_selfmodel.model.shape.link_shape import BodyShape, LinkShape
from nico_selfmodel.model.shape.shape_folder import load_shape, save_shape, shape_beside

from ..learned_ball import ball_body, ball_shape


@st.composite
def link_shapes(draw, link):
    size = draw(st.integers(3, 12))
    vertices = draw(arrays(float, (size, 3), elements=st.floats(-900.0, 900.0)))
    triangles = draw(arrays("i8", (draw(st.integers(1, 9)), 3), elements=st.integers(0, size - 1)))
    return LinkShape(
        link,
        TriangleMesh(vertices, triangles),
        draw(arrays(float, size, elements=st.floats(1e-9, 1e3))),
        draw(arrays(float, (size, 3), elements=st.floats(0.0, 1.0))),
        draw(arrays("i8", size, elements=st.integers(0, 2**32 - 1))),
        draw(arrays(bool, size)),
    )


@pytest.mark.slow
@settings(max_examples=35)  # of three shapes each
@given(st.data())
def test_every_shape_survives_the_round_trip_to_the_last_bit(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("shape") / "body"
    links = ("head", "a link/with words", "../up")
    shapes = {link: data.draw(link_shapes(link)) for link in links}
    saved = BodyShape(shapes, {link: np.eye(4) for link in links})
    save_shape(saved, folder)
    found = load_shape(folder)
    assert list(found.links) == list(links)
    for link, shape in shapes.items():
        again = found.links[link]
        for name in ("sigma", "colors", "looks", "seen"):
            assert getattr(again, name).tobytes() == getattr(shape, name).tobytes()
        np.testing.assert_array_equal(again.mesh.vertices, shape.mesh.vertices)
        np.testing.assert_array_equal(again.mesh.triangles, shape.mesh.triangles)


def test_what_was_never_seen_is_kept_apart_and_has_neither_colour_nor_sigma(tmp_path):
    save_shape(ball_body("head", "chest"), tmp_path / "body")
    found = shape_beside(tmp_path)
    chest = found.links["chest"]
    np.testing.assert_array_equal(chest.seen, chest.mesh.vertices[:, 0] > 0.0)
    assert np.isnan(chest.sigma[~chest.seen]).all()
    assert np.isnan(chest.colors[~chest.seen]).all()
    assert (chest.looks[~chest.seen] == 3).all()
    assert chest.seen_part.seen.all()
    assert 0.3 < len(chest.seen_part.mesh.triangles) / len(chest.mesh.triangles) < 0.6
    np.testing.assert_array_equal(found.X_WF["chest"][:3, 3], [0.2, 0.1, 0.5])


def test_a_self_model_without_a_shape_has_none(tmp_path):
    assert shape_beside(tmp_path) is None
    assert shape_beside(tmp_path / "self_model.yaml") is None


def test_an_empty_folder_is_no_shape(tmp_path):
    (tmp_path / "body").mkdir()
    with pytest.raises(ModelError, match=r"shape\.yaml: there is no such file"):
        shape_beside(tmp_path)


def test_the_same_shape_gives_the_same_bytes_and_replaces_an_older_one(tmp_path):
    save_shape(ball_body("head", "chest"), tmp_path / "a")
    save_shape(ball_body("head"), tmp_path / "b")
    save_shape(ball_body("head", "chest"), tmp_path / "b")
    names = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert names == ["chest.ply", "head.ply", "shape.yaml"]
    for name in names:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert len(list((tmp_path / "b").iterdir())) == 3


def test_a_failure_leaves_the_older_shape(tmp_path, monkeypatch):
    save_shape(ball_body("head"), tmp_path / "body")

    def full(*_):
        raise OSError("no space left on device")

    monkeypatch.setattr("nico_selfmodel.model.shape.shape_folder.yaml_text", full)
    with pytest.raises(OSError, match="no space"):
        save_shape(ball_body("head", "chest"), tmp_path / "body")
    assert list(load_shape(tmp_path / "body").links) == ["head"]
    assert [path.name for path in tmp_path.iterdir()] == ["body"]


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sound") / "body"
    save_shape(ball_body("head", "chest"), folder)
    return folder


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": "nico-shape/7"}, "has format 'nico-shape/7', expected nico-shape/1"),
        ({"units": {"vertices": "mm"}}, "units must be"),
        ({"world": "the chest"}, "world must be"),
        ({"color": "red"}, "unknown key 'color'"),
        ({"links": "head"}, "must be a list of mappings"),
        ({"links.0.file": "../head.ply"}, "must be a name in this folder"),
        ({"links.0.file": "hand.ply"}, "hand.ply: there is no such file"),
        ({"links.0.vertices": 3}, "the index says 3"),
        ({"links.0.seen": 0}, "the index says 0"),
        ({"links.0.link": "chest"}, "a link is named twice"),
        ({"links.0.link": 7}, "must be printable text"),
        ({"links.0.X_WF": [[1.0]]}, "must have shape (4, 4)"),
        ({"links.0.X_WF": np.diag([2.0, 2, 2, 1]).tolist()}, "is not a rigid transform"),
    ],
)
def test_a_bad_index_is_refused_in_one_line(sound, tmp_path, change, words):
    shutil.copytree(sound, tmp_path / "body")
    index = tmp_path / "body" / "shape.yaml"
    document = yaml.safe_load(index.read_text())
    for path, value in change.items():
        *way, last = (int(word) if word.isdigit() else word for word in path.split("."))
        place = document
        for step in way:
            place = place[step]
        place[last] = value
    index.write_text(yaml.safe_dump(document))
    _refused(tmp_path / "body", words)


@pytest.mark.parametrize(
    ("cut", "words"), [(-1, "it was cut off"), (20, "not a PLY"), (0, "not a PLY")]
)
def test_a_bad_mesh_is_refused_in_one_line(sound, tmp_path, cut, words):
    shutil.copytree(sound, tmp_path / "body")
    mesh = tmp_path / "body" / "head.ply"
    mesh.write_bytes(mesh.read_bytes()[:cut])
    _refused(tmp_path / "body", words)


def _refused(folder, words):
    with pytest.raises(ModelError) as raised:
        load_shape(folder)
    message = str(raised.value)
    assert words in message
    assert str(folder) in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"sigma": np.zeros(3)}, "sigma must have shape"),
        ({"sigma": None}, "sigma must be positive"),
        ({"colors": 2.0}, "colors must be from 0 to 1"),
        ({"colors": np.nan}, "colors must be finite"),
        ({"looks": 0.5}, "looks must be whole numbers"),
        ({"seen": 1.0}, "seen must be truth values"),
    ],
)
def test_a_shape_that_no_body_has_is_refused(wrong, words):
    shape = ball_shape("head")
    ((name, value),) = wrong.items()
    if not isinstance(value, np.ndarray):
        value = np.full_like(getattr(shape, name), value or 0.0, dtype=float)
    with pytest.raises(ValueError, match=words):
        replace(shape, **{name: value})

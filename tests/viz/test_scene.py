import base64
import json

import numpy as np
import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.viz.live.meshing import mesh_of
from nico_selfmodel.viz.live.picture_mesh import picture_gltf
from nico_selfmodel.viz.scene.scene import Camera, LegendEntry, Scene, path_names
from nico_selfmodel.viz.scene.scene_items import (
    ITEM_KINDS,
    Box,
    Capsule,
    Markers,
    Needles,
    Picture,
    Surface,
    Triad,
    Tube,
)

from .every_item import BLUE, every_item


def scene_of(*items):
    camera = Camera(np.array([1.0, 2.0, 3.0]), np.zeros(3))
    legend = (LegendEntry("blue", BLUE), LegendEntry("scale", BLUE, (BLUE, BLUE)))
    return Scene("title", items, camera, legend)


def test_a_scene_survives_the_round_trip_exactly():
    scene = scene_of(*every_item())
    again = Scene.from_json(scene.to_json())
    assert again.to_json() == scene.to_json()
    assert again.paths == scene.paths
    assert again.legend == scene.legend
    for item, copy in zip(scene.items, again.items, strict=True):
        assert type(copy) is type(item)
        assert copy.color == item.color
        np.testing.assert_array_equal(copy.X_WI, item.X_WI)
    np.testing.assert_array_equal(again.items[0].centers, scene.items[0].centers)
    np.testing.assert_array_equal(again.items[0].colors, scene.items[0].colors)


def test_the_scene_of_every_kind_has_every_kind():
    assert {type(item) for item in every_item()} == set(ITEM_KINDS.values())


def test_a_picture_survives_the_round_trip_to_the_last_byte():
    (picture,) = [item for item in every_item() if isinstance(item, Picture)]
    again = Scene.from_json(scene_of(picture).to_json()).items[0]
    assert again.image == picture.image
    assert again.image_kind == "image/jpeg"
    np.testing.assert_array_equal(again.corners, picture.corners)


def test_drakes_turn_of_a_picture_leaves_it_in_its_own_frame():
    (picture,) = [item for item in every_item() if isinstance(item, Picture)]
    document = json.loads(picture_gltf(picture))
    buffer = base64.b64decode(document["buffers"][0]["uri"].partition(",")[2])
    assert len(buffer) == document["buffers"][0]["byteLength"]
    x, y, z = np.frombuffer(buffer, "<f4", 12).reshape(4, 3).T
    np.testing.assert_allclose(np.stack([x, -z, y], axis=1), picture.corners, atol=1e-7)
    texture = np.frombuffer(buffer, "<f4", 8, offset=48).reshape(4, 2)
    right_down = picture.corners[:, :2] / [picture.width, picture.height] + 0.5
    np.testing.assert_allclose(texture, right_down)


def test_what_was_drawn_cannot_be_changed():
    (markers,) = [item for item in every_item() if item.path == "points/coloured"]
    with pytest.raises(ValueError, match="read-only"):
        markers.centers[0, 0] = 5.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"path": "a//b"}, "path must be names"),
        ({"path": ""}, "path must be names"),
        ({"color": (0.0, 0.0, 2.0, 1.0)}, "from 0 to 1"),
        ({"color": (0.0, 0.0, 1.0)}, "four numbers"),
        ({"centers": np.zeros((0, 3))}, "centers must have shape"),
        ({"centers": [[0.0, np.nan, 0.0]]}, "centers must be finite"),
        ({"colors": np.zeros((3, 3))}, "colors must have shape"),
        ({"radius": 0.0}, "radius must be positive"),
        ({"shape": "cube"}, "shape must be one of sphere, diamond"),
        ({"X_WI": np.eye(3)}, "X_WI must have shape"),
    ],
)
def test_an_item_that_cannot_be_drawn_is_refused(change, message):
    good = {"path": "a/b", "color": BLUE, "centers": np.zeros((2, 3)), "radius": 0.1}
    with pytest.raises(ValueError, match=message):
        Markers(**good | change)


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (Needles, {"starts": np.zeros((2, 3)), "ends": np.zeros((3, 3)), "radius": 0.1}),
        (Tube, {"points": np.zeros((1, 3)), "radius": 0.1}),
        (Capsule, {"radius": 0.1, "length": -1.0}),
        (Box, {"sides": np.array([1.0, 0.0, 1.0])}),
        (Triad, {"radius": 0.1, "length": np.nan}),
        (Surface, {"vertices": np.eye(3), "faces": [[0, 1, 3]]}),
        (Surface, {"vertices": np.eye(3), "faces": [[0, 1]]}),
        (Picture, {"width": 0.1, "height": 0.1, "image": b"GIF89a"}),
        (Picture, {"width": 0.0, "height": 0.1, "image": b"\x89PNG"}),
    ],
)
def test_a_shape_without_a_size_is_refused(kind, values):
    with pytest.raises(ValueError, match=r"must|at least"):
        kind(path="a", color=BLUE, **values)


def test_two_items_cannot_share_a_path():
    box = Box(path="a/b", color=BLUE, sides=np.ones(3))
    with pytest.raises(ValueError, match="a/b more than once"):
        scene_of(box, box)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not valid JSON"),
        ("[]", "must have format nico-scene/1, got None"),
        ('{"format": "nico-scene/2"}', "got 'nico-scene/2'"),
        ('{"format": "nico-scene/1", "title": "x"}', "damaged"),
    ],
)
def test_what_is_no_scene_is_refused(text, message):
    with pytest.raises(ModelError, match=message):
        Scene.from_json(text)


def test_an_unknown_item_in_a_file_is_refused():
    document = json.loads(scene_of(*every_item()).to_json())
    document["items"][0]["kind"] = "teapot"
    with pytest.raises(ModelError, match="no item 'teapot'; there are tube"):
        Scene.from_json(json.dumps(document))


def test_names_in_paths_are_plain_and_different():
    names = path_names(["elbow", "a/b", "a b", "a_b_2", "", "ä"])
    assert names[:3] == ["elbow", "a_b", "a_b_2"]
    assert len(set(names)) == 6
    assert not any("/" in name or " " in name or not name for name in names)


def test_the_items_under_a_path_are_found():
    scene = scene_of(*every_item())
    assert [item.path for item in scene.under("points")] == ["points/coloured", "points/plain"]
    assert scene.under("point") == ()


def volume(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0


def test_meshes_are_closed_to_the_outside_and_of_the_right_size():
    centers = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
    balls = mesh_of(Markers(path="a", color=BLUE, centers=centers, radius=0.5))
    ball = 4.0 / 3.0 * np.pi * 0.5**3
    assert 0.85 * 2 * ball < volume(balls) < 2 * ball
    diamond = Markers(path="a", color=BLUE, centers=centers[:1], radius=0.5, shape="diamond")
    assert volume(mesh_of(diamond)) == pytest.approx(8.0 / 6.0 * 0.5**3)
    needle = Needles(path="a", color=BLUE, starts=centers[:1], ends=centers[1:], radius=0.1)
    cone = np.pi * 0.1**2 * np.linalg.norm(centers[1]) / 3.0
    assert 0.7 * cone < volume(mesh_of(needle)) < cone


def test_a_tube_keeps_its_radius_around_a_circle():
    angle = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(60)], axis=1)
    mesh = mesh_of(Tube(path="a", color=BLUE, points=rim, radius=0.05, closed=True))
    around = np.linalg.norm(mesh.vertices[:, :2], axis=1) - 1.0
    np.testing.assert_allclose(np.hypot(around, mesh.vertices[:, 2]), 0.05, atol=1e-9)
    assert 0.7 < volume(mesh) / (2.0 * np.pi * np.pi * 0.05**2) < 1.0


def test_a_vector_of_no_length_is_still_drawn():
    point = np.array([[1.0, 2.0, 3.0]])
    mesh = mesh_of(Needles(path="a", color=BLUE, starts=point, ends=point, radius=0.1))
    assert np.isfinite(mesh.vertices).all()


def test_a_shape_that_viewers_know_is_not_meshed():
    box = Box(path="a", color=BLUE, sides=np.ones(3), X_WI=transform(np.eye(3), np.ones(3)))
    with pytest.raises(TypeError, match="Box is no mesh"):
        mesh_of(box)

"""The learned shape of links in a scene."""

import base64
import json
from dataclasses import replace

import numpy as np

from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.shape.link_shape import BodyShape
from nico_selfmodel.viz.live.static_page import static_html
from nico_selfmodel.viz.live.surface_mesh import surface_gltf
from nico_selfmodel.viz.scene.robot.shape_items import NEVER_SEEN, with_shape
from nico_selfmodel.viz.scene.scene import Camera, Scene
from nico_selfmodel.viz.scene.scene_items import Box

from ..learned_ball import ball_body

BLUE = (0.1, 0.3, 0.9, 1.0)
X_SW = transform(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 1.0])


def scene():
    paths = ("robot/head/0", "robot/head/1", "robot/header/0", "arm/link")
    boxes = tuple(Box(path=path, color=BLUE, sides=np.full(3, 0.1)) for path in paths)
    return Scene("nico", boxes, Camera(np.array([1.0, 1.0, 1.0]), np.zeros(3)))


def test_learned_links_take_the_place_of_described_ones_where_they_were_seen():
    shape = ball_body("head", "chest")
    found = with_shape(scene(), shape, X_SW)
    assert found.paths == ("robot/header/0", "arm/link", "shape/head", "shape/chest")
    chest = found.items[-1]
    np.testing.assert_array_equal(chest.X_WI, X_SW @ shape.X_WF["chest"])
    np.testing.assert_array_equal(chest.vertices, shape.links["chest"].mesh.vertices)


def test_what_was_never_seen_is_grey_and_the_rest_has_its_colours():
    shape = ball_body("head")
    (head,) = with_shape(scene(), shape, X_SW).under("shape")
    own = shape.links["head"]
    np.testing.assert_array_equal(head.colors[own.seen], own.colors[own.seen])
    assert (head.colors[~own.seen] == NEVER_SEEN).all()
    assert np.ptp(NEVER_SEEN) < 0.06  # grey
    labels = [entry.label for entry in with_shape(scene(), shape, X_SW).legend]
    assert labels == ["head as learned, in the colours seen", "parts of head that were never seen"]


def test_the_legend_of_a_grey_body_tells_what_was_seen_from_what_was_not():
    shape = ball_body("head")
    head = shape.links["head"]
    colors = np.where(np.arange(len(head.seen))[:, None] % 3, NEVER_SEEN, [0.9, 0.88, 0.82])
    grey = replace(head, colors=np.where(head.seen[:, None], colors, head.colors))
    told, never = with_shape(scene(), BodyShape({"head": grey}, shape.X_WF), X_SW).legend
    assert np.abs(np.subtract(told.color, never.color)).max() > 0.2


def test_a_scene_with_a_shape_survives_the_round_trip_and_is_drawn():
    found = with_shape(scene(), ball_body("head"), X_SW)
    again = Scene.from_json(found.to_json())
    np.testing.assert_array_equal(again.items[-1].colors, found.items[-1].colors)
    assert len(static_html(found)) > len(static_html(scene()))


def test_a_coloured_surface_is_a_gltf_whose_light_is_in_proportion():
    (head,) = with_shape(scene(), ball_body("head"), X_SW).under("shape")
    document = json.loads(surface_gltf(head, head.colors))
    (primitive,) = document["meshes"][0]["primitives"]
    assert set(primitive["attributes"]) == {"POSITION", "NORMAL", "COLOR_0"}
    content = base64.b64decode(document["buffers"][0]["uri"].split(",")[1])
    size, view = len(head.vertices), document["bufferViews"][primitive["attributes"]["COLOR_0"]]
    found = np.frombuffer(content, "<f4", 3 * size, view["byteOffset"]).reshape(-1, 3)
    # Of a screen's 0.2 there is 0.033 of the light.
    red = (head.colors == [204 / 255, 51 / 255, 26 / 255]).all(axis=1)
    np.testing.assert_allclose(found[red][0], [0.604, 0.0331, 0.0103], rtol=0.01)
    x, y, z = np.frombuffer(content, "<f4", 3 * size, 0).reshape(-1, 3).T
    np.testing.assert_allclose(np.stack([x, -z, y], axis=1), head.vertices, atol=1e-6)

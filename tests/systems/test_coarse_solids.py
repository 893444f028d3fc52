"""What renderers see in place of round solids is as large as they are, and of the same colour."""

import numpy as np
import pytest
from pydrake.geometry import (
    Box,
    Capsule,
    Ellipsoid,
    GeometryFrame,
    GeometryInstance,
    PerceptionProperties,
    ProximityProperties,
    RenderLabel,
    Rgba,
    Role,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform

from nico_selfmodel.systems.rendering.coarse_solids import draw_coarsely

TENTH = 1e-4  # [m]


def mesh_of(shape):
    """Return corners and outward normals of the triangles that a shape is drawn by."""
    scene, _, frame, _ = drawn(shape)
    inspector = scene.model_inspector()
    (geometry,) = inspector.GetGeometries(frame, Role.kPerception)
    text = inspector.GetShape(geometry).source().in_memory().mesh_file.contents().decode()
    rows = [line.split() for line in text.splitlines()]
    points = np.array([row[1:] for row in rows if row[0] == "v"], dtype=float)
    normals = np.array([row[1:] for row in rows if row[0] == "vn"], dtype=float)
    faces = np.array([[c.split("//")[0] for c in row[1:]] for row in rows if row[0] == "f"])
    faces = faces.astype(int) - 1
    return points[faces], normals[faces]


def drawn(shape):
    scene = SceneGraph()
    source = scene.RegisterSource("body")
    frame = scene.RegisterFrame(source, GeometryFrame("link"))
    one = GeometryInstance(RigidTransform([0.0, 0.1, 0.0]), shape, "solid")
    properties = PerceptionProperties()
    properties.AddProperty("label", "id", RenderLabel(7))
    properties.AddProperty("phong", "diffuse", Rgba(0.1, 0.2, 0.3, 1.0))
    one.set_perception_properties(properties)
    one.set_proximity_properties(ProximityProperties())
    geometry = scene.RegisterGeometry(source, frame, one)
    draw_coarsely(scene, source)
    return scene, source, frame, geometry


def distance(shape, p):
    """Return how far points are outside of a ball or capsule [m]."""
    half = 0.5 * shape.length() if isinstance(shape, Capsule) else 0.0
    along = np.clip(p[..., 2], -half, half)
    axis = np.stack([0.0 * along, 0.0 * along, along], axis=-1)
    return np.linalg.norm(p - axis, axis=-1) - shape.radius()


@pytest.mark.parametrize("shape", [Sphere(0.0225), Sphere(0.002), Capsule(0.0205, 0.037)])
def test_no_place_of_a_mesh_is_an_eighth_of_a_millimetre_from_its_solid(shape):
    corners, normals = mesh_of(shape)
    outside = distance(shape, corners)
    assert np.ptp(outside) < 1e-8
    assert 0.0 < outside.min() < 1.25 * TENTH
    for a, b in ((0.5, 0.5), (0.5, 0.0), (0.0, 0.5), (1 / 3, 1 / 3)):
        within = a * corners[:, 0] + b * corners[:, 1] + (1.0 - a - b) * corners[:, 2]
        depth = distance(shape, within)
        assert depth.max() < outside.min() + 1e-8
        assert depth.min() > -1.25 * TENTH
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.sum(facing * normals.mean(axis=1), axis=1) > 0.0).all()


@pytest.mark.parametrize(
    ("shape", "volume"),
    [
        (Sphere(0.02), 4.0 / 3.0 * np.pi * 0.02**3),
        (Ellipsoid(0.05, 0.04, 0.03), 4.0 / 3.0 * np.pi * 0.05 * 0.04 * 0.03),
        (Capsule(0.02, 0.05), 4.0 / 3.0 * np.pi * 0.02**3 + np.pi * 0.02**2 * 0.05),
    ],
)
def test_meshes_are_closed_and_hold_as_much_as_their_solids(shape, volume):
    corners, _ = mesh_of(shape)
    edges = np.sort(np.round(corners[:, [[0, 1], [1, 2], [2, 0]]], 9).reshape(-1, 2, 3), axis=1)
    _, counts = np.unique(edges.reshape(-1, 6), axis=0, return_counts=True)
    assert (counts == 2).all()
    filled = np.sum(corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])) / 6.0
    assert filled == pytest.approx(volume, rel=1e-3)


def test_colour_label_place_and_other_roles_stay():
    scene, _, frame, geometry = drawn(Sphere(0.02))
    inspector = scene.model_inspector()
    (mesh,) = inspector.GetGeometries(frame, Role.kPerception)
    assert mesh != geometry
    properties = inspector.GetPerceptionProperties(mesh)
    assert int(properties.GetProperty("label", "id")) == 7
    assert properties.GetProperty("phong", "diffuse") == Rgba(0.1, 0.2, 0.3, 1.0)
    assert inspector.GetPoseInFrame(mesh).IsExactlyEqualTo(inspector.GetPoseInFrame(geometry))
    assert inspector.GetGeometries(frame, Role.kProximity) == [geometry]


def test_what_has_few_triangles_is_left_as_it_is():
    scene, _, frame, geometry = drawn(Box(0.1, 0.1, 0.1))
    assert scene.model_inspector().GetGeometries(frame, Role.kPerception) == [geometry]

"""Surfaces on grids: where a distance is zero, and how far points are from triangles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nico_selfmodel.geometry.surface_nets import surface_nets
from nico_selfmodel.geometry.triangle_mesh import TriangleMesh
from nico_selfmodel.geometry.voxel_grid import VoxelGrid

PITCH = 0.01


def sphere(center, radius, pitch=PITCH):
    grid = VoxelGrid.about(np.array([center]), radius + 3.0 * pitch, pitch)
    distance = np.linalg.norm(grid.points - center, axis=1) - radius
    return grid, distance.reshape(grid.shape)


@given(
    st.tuples(*[st.floats(-0.004, 0.004)] * 3), st.floats(0.05, 0.1),
)  # fmt: skip
@settings(max_examples=8, deadline=None)
def test_a_spheres_surface_is_right_to_a_tenth_of_a_voxel(center, radius):
    mesh = surface_nets(*sphere(np.array(center), radius))
    off = np.linalg.norm(mesh.vertices - center, axis=1) - radius
    assert np.abs(off).max() < 0.1 * PITCH


def test_a_closed_surface_has_eulers_number_one_part_and_outward_normals():
    mesh = surface_nets(*sphere(np.zeros(3), 0.08))
    assert len(mesh.vertices) - len(mesh.edges) + len(mesh.triangles) == 2
    assert (mesh.parts == 0).all()
    outward = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    assert np.sum(mesh.normals * outward, axis=1).min() > 0.99


def area_of(mesh):
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()


def test_half_of_the_voxel_spacing_makes_a_quarter_of_the_areas_error():
    errors = []
    for pitch in (0.02, 0.01):
        area = area_of(surface_nets(*sphere(np.zeros(3), 0.08, pitch)))
        errors.append(abs(area / (4.0 * np.pi * 0.08**2) - 1.0))
    assert errors[1] == pytest.approx(0.25 * errors[0], rel=0.3)


def test_where_the_distance_is_not_known_the_surface_ends():
    grid, distance = sphere(np.zeros(3), 0.08)
    unknown = (grid.points[:, 0] > 0.02).reshape(grid.shape)
    mesh = surface_nets(grid, np.where(unknown, np.nan, distance))
    assert mesh.vertices[:, 0].max() < 0.02 + PITCH
    assert mesh.vertices[:, 0].min() < -0.075


def test_without_a_change_of_sign_there_is_no_surface():
    grid = VoxelGrid(np.zeros(3), PITCH, (4, 5, 6))
    assert not len(surface_nets(grid, np.ones(grid.shape)).vertices)


def test_two_spheres_are_two_parts_and_one_of_them_can_be_kept():
    grid = VoxelGrid.about(np.array([[-0.1, 0, 0], [0.1, 0, 0]]), 0.08, PITCH)
    apart = np.abs(grid.points[:, :1]) - 0.1
    distance = np.linalg.norm(np.hstack([apart, grid.points[:, 1:]]), axis=1) - 0.05
    mesh = surface_nets(grid, distance.reshape(grid.shape))
    assert set(mesh.parts) == {0, 1}
    kept = mesh.parts == mesh.parts[0]
    one = mesh.of_vertices(kept)
    assert len(one.vertices) == np.count_nonzero(kept)
    np.testing.assert_array_equal(one.vertices, mesh.vertices[mesh.used(kept)])


def test_distances_to_triangles_are_those_to_faces_edges_and_corners():
    mesh = TriangleMesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    points = np.array([[0.2, 0.2, 0.5], [0.5, -2.0, 0.0], [-3.0, -4.0, 0.0], [1.0, 1.0, 0.0]])
    np.testing.assert_allclose(mesh.distance(points), [0.5, 2.0, 5.0, np.sqrt(0.5)])


def test_points_are_as_far_from_a_meshed_sphere_as_from_the_sphere():
    mesh = surface_nets(*sphere(np.zeros(3), 0.08))
    points = np.random.default_rng(0).uniform(-0.15, 0.15, (200, 3))
    far = np.abs(np.linalg.norm(points, axis=1) - 0.08)
    # A triangle with sides of 10 to 20 mm is so far inside of the arc in its middle.
    np.testing.assert_allclose(mesh.distance(points), far, atol=8e-4)


@given(st.tuples(*[st.floats(-1, 1)] * 4), st.tuples(*[st.floats(0.001, 0.04)] * 3))
def test_a_linear_function_is_interpolated_exactly_with_its_slope(weights, place):
    grid = VoxelGrid(np.zeros(3), PITCH, (5, 6, 7))
    slope = np.array(weights[:3])
    values = (grid.points @ slope + weights[3]).reshape(grid.shape)
    value, found = grid.interpolated(values, np.array([place]))
    assert value[0] == pytest.approx(np.array(place) @ slope + weights[3], abs=1e-9)
    np.testing.assert_allclose(found[0], slope, atol=1e-7)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: VoxelGrid(np.zeros(3), 0.0, (3, 3, 3)), "pitch must be a positive length"),
        (lambda: VoxelGrid(np.zeros(3), 0.1, (3, 1, 3)), "at least 2"),
        (lambda: TriangleMesh(np.zeros((3, 2)), np.zeros((0, 3))), "shape \\(V, 3\\)"),
        (lambda: TriangleMesh(np.zeros((3, 3)), np.array([[0, 1, 3]])), "from 0 to 2"),
        (lambda: TriangleMesh(np.zeros((3, 3)), np.zeros((0, 3))).distance([[0, 0, 0]]), "nowhere"),
        (lambda: surface_nets(VoxelGrid(np.zeros(3), 1.0, (2, 2, 2)), np.zeros(8)), "must have"),
    ],
)
def test_what_is_no_grid_and_no_mesh_is_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()

"""Distances to simple solids, and where lines meet them."""

import numpy as np
import pytest

from nico_selfmodel.geometry.solids.solid import (
    Solid,
    distance_to_solids,
    normals_of_solids,
    onto_solids,
)
from nico_selfmodel.geometry.transform import transform

HERE = np.eye(4)


@pytest.mark.parametrize(
    ("kind", "size", "point", "distance"),
    [
        ("ellipsoid", (2.0, 2.0, 2.0), (5.0, 0.0, 0.0), 3.0),
        ("ellipsoid", (2.0, 1.0, 1.0), (0.0, 0.0, 1.0), 0.0),
        ("capsule", (1.0, 4.0), (0.0, 0.0, 4.5), 1.5),
        ("capsule", (1.0, 4.0), (3.0, 0.0, 1.0), 2.0),
        ("cylinder", (1.0, 4.0), (4.0, 0.0, 6.0), 5.0),
        ("cylinder", (1.0, 4.0), (0.0, 0.0, 1.5), -0.5),
        ("box", (2.0, 4.0, 6.0), (1.0 + 3.0, 0.0, 3.0 + 4.0), 5.0),
    ],
)
def test_distances_are_those_of_geometry(kind, size, point, distance):
    found = Solid(kind, size, HERE).distance(np.array([point]))
    assert found[0] == pytest.approx(distance, abs=1e-9)


def test_a_solid_is_where_it_was_put():
    X_FS = transform(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), [1.0, 2.0, 3.0])
    moved = Solid("capsule", (0.5, 2.0), X_FS)
    # Its z axis is the frame's x.
    assert moved.distance(np.array([[3.0, 2.0, 3.0]]))[0] == pytest.approx(0.5)


def test_the_nearest_of_several_counts_and_its_normal_points_out_of_it():
    X_FS = transform(np.eye(3), [3.0, 0.0, 0.0])
    solids = [Solid("ellipsoid", (1.0, 1.0, 1.0), HERE), Solid("box", (1.0, 1.0, 1.0), X_FS)]
    points = np.array([[0.0, 1.1, 0.0], [2.3, 0.0, 0.0]])
    distances, nearest = distance_to_solids(solids, points)
    assert nearest.tolist() == [0, 1]
    assert distances == pytest.approx([0.1, 0.2])
    assert normals_of_solids(solids, points) == pytest.approx(
        np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]), abs=1e-6
    )


def test_lines_end_on_the_surface_or_nowhere():
    solids = [Solid("ellipsoid", (0.085, 0.07, 0.06), HERE)]
    starts = np.array([[0.3, 0.01, 0.02], [0.3, 0.2, 0.0]])
    met = onto_solids(solids, starts, [-1.0, 0.0, 0.0])
    assert np.sum(np.square(met[0] / solids[0].size)) == pytest.approx(1.0, abs=1e-5)
    assert met[0, 1:] == pytest.approx([0.01, 0.02])
    assert np.isnan(met[1]).all()


def test_other_shapes_and_sizes_are_refused():
    with pytest.raises(ValueError, match="ellipsoid, capsule, cylinder, box, got 'cone'"):
        Solid("cone", (1.0, 1.0), HERE)
    with pytest.raises(ValueError, match="2 positive numbers"):
        Solid("capsule", (1.0, 0.0), HERE)

"""Boxes tell where in a picture anything is, as a whole picture would."""

import weakref

import numpy as np
from pydrake.geometry import Box
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from nico_selfmodel.systems.rendering.outlines import Outlines, bounds_before

CUBE = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)], dtype=float)


def test_a_box_that_is_cut_is_bounded_by_what_is_before_the_camera():
    corners = CUBE[None] + [5.0, 0.0, 0.0]
    low, high = bounds_before(corners, 0.5)
    inside = np.random.default_rng(0).uniform(
        corners[0].min(axis=0), corners[0].max(axis=0), (4000, 3)
    )
    rays = inside[inside[:, 2] > 0.5]
    rays = rays[:, :2] / rays[:, 2:]
    assert (low[0] <= rays.min(axis=0)).all()
    assert (high[0] >= rays.max(axis=0)).all()
    np.testing.assert_allclose(low[0], [4.0, -2.0])
    np.testing.assert_allclose(high[0], [12.0, 2.0])


def test_a_box_beside_the_camera_does_not_reach_into_the_picture():
    low, _ = bounds_before(CUBE[None] + [5.0, 0.0, 0.0], 0.01)
    assert low[0, 0] > 3.0


def test_outlines_keep_no_query_and_no_context_alive():
    """A freed context's wrapper would be taken for whatever stands at its address later."""
    builder = DiagramBuilder()
    plant, scene = AddMultibodyPlantSceneGraph(builder, 0.0)
    plant.RegisterVisualGeometry(
        plant.world_body(), RigidTransform(), Box(1, 1, 1), "box", [1.0] * 4
    )
    plant.Finalize()
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    query = scene.get_query_output_port().Eval(scene.GetMyContextFromRoot(root))
    outlines = Outlines()
    outlines.before(query, RigidTransform([0.0, 0.0, -5.0]), 0.01, 10.0)
    held = weakref.ref(query)
    del query
    assert held() is None

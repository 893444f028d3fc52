"""A part of a picture is rendered; what stands in the near plane has a depth, too."""

import numpy as np
from pydrake.geometry import MakeRenderEngineVtk, RenderEngineVtkParams, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from nico_selfmodel.systems.rendering.cropped_render import CroppedRender

K = np.array([[100.0, 0.0, 31.5], [0.0, 100.0, 23.5], [0.0, 0.0, 1.0]])


class _InTheNearPlane:
    """A scene of which a surface lies in the near plane: Drake says 0 of what rounds to nearer."""

    def __init__(self, query):
        self._query = query

    def __getattr__(self, name):
        return getattr(self._query, name)

    def RenderDepthImage(self, *args):
        found = self._query.RenderDepthImage(*args)
        found.mutable_data[10:12, 10:12] = 0.0
        return found


def test_what_lies_in_the_near_plane_is_as_far_as_it():
    """Nothing may be divided by Drake's 0."""
    builder = DiagramBuilder()
    plant, scene = AddMultibodyPlantSceneGraph(builder, 0.0)
    scene.AddRenderer("vtk", MakeRenderEngineVtk(RenderEngineVtkParams()))
    X_WB = RigidTransform([0.0, 0.0, 0.02])
    red = np.array([1.0, 0.0, 0.0, 1.0])
    plant.RegisterVisualGeometry(plant.world_body(), X_WB, Sphere(0.015), "ball", red)
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    query = scene.get_query_output_port().Eval(scene.GetMyContextFromRoot(context))
    frame = query.inspector().world_frame_id()
    camera = CroppedRender("vtk", (64, 48), K, frame, RigidTransform(), near=0.004)
    _, depth = camera.with_depth(_InTheNearPlane(query))
    assert (depth == np.float32(0.004)).sum() == 4
    assert np.nanmin(depth) >= np.float32(0.004)

"""A card floating before two cameras, in a diagram of a user's own."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import FramePoseVector, GeometryFrame, SceneGraph
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from nico_selfmodel.systems.image_values import bgr_of
from nico_selfmodel.systems.rendering.station_scene import add_renderer
from nico_selfmodel.systems.rendering.stereo_cameras import StereoCameras
from nico_selfmodel.systems.rendering.textured_card import textured_card
from nico_selfmodel.vision.printed_pattern import chessboard_png, fiducial_png, printed_size

# The room's light falls from above: the cameras look down.
X_WE = np.diag([1.0, -1.0, -1.0, 1.0])
FIDUCIAL, CARD = 7, 0.036


class CardWorld:
    """Shows a fiducial, or a board, to a rig that is given in its own frame."""

    def __init__(self, rig, quality, board=None, renderer="cameras", seed=0):
        builder = DiagramBuilder()
        scene = builder.AddNamedSystem("scene", SceneGraph())
        add_renderer(scene)
        source = scene.RegisterSource("card")
        self.frame = scene.RegisterFrame(source, GeometryFrame("card"))
        if board is None:
            card = textured_card("card", fiducial_png(FIDUCIAL), (CARD, CARD), RigidTransform(), 5)
        else:
            center = RigidTransform(p=board.points.mean(axis=0))
            card = textured_card("card", chessboard_png(board), printed_size(board), center, 5)
        scene.RegisterGeometry(source, self.frame, card)
        frames = (scene.world_frame_id(),) * 2
        self.cameras = StereoCameras(rig.moved(X_WE), frames, quality, seed=seed, renderer=renderer)
        builder.AddNamedSystem("cameras", self.cameras)
        builder.Connect(scene.get_query_output_port(), self.cameras.get_input_port())
        for camera in ("left", "right"):
            builder.ExportOutput(self.cameras.GetOutputPort(f"{camera}_image"), camera)
        builder.ExportInput(scene.get_source_pose_port(source), "pose")
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()

    def place(self, X_EC):
        poses = FramePoseVector()
        poses.set_value(self.frame, RigidTransform(pose=X_WE @ X_EC))
        self.diagram.GetInputPort("pose").FixValue(self.context, AbstractValue.Make(poses))

    def look(self, X_EC, time=0.0):
        """Return the pictures of both cameras, BGR."""
        self.context.SetTime(time)
        self.place(X_EC)
        return [bgr_of(self.diagram.GetOutputPort(e).Eval(self.context)) for e in ("left", "right")]

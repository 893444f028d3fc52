"""A fiducial, a box and a mirror before two cameras, in a diagram of a user's own."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import (
    Box,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    PerceptionProperties,
    RenderLabel,
    Rgba,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.systems.image_values import bgr_of
from nico_selfmodel.systems.rendering.mirror_scene import AWAY, MirrorPlate, MirrorScene
from nico_selfmodel.systems.rendering.station_scene import add_renderer
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality, StereoCameras
from nico_selfmodel.systems.rendering.textured_card import textured_card
from nico_selfmodel.vision.printed_pattern import fiducial_png

CARD, BLOCK = 0.036, 0.04
GONE = np.diag([1.0, 1.0, 1.0, 1.0])
GONE[:3, 3] = [0.0, 0.0, -40.0]
PLATE = MirrorPlate()


class MirrorWorld:
    """Shows what it is told to show, at poses in the frame of the left camera."""

    def __init__(self, rig, quality=None, mirror=True, plate=PLATE):
        self.X_WL = rig.left.X_WC
        builder = DiagramBuilder()
        scene = builder.AddNamedSystem("scene", SceneGraph())
        add_renderer(scene)
        self.source = scene.RegisterSource("things")
        self.frames = [self._card(scene), self._box(scene)]
        self.mirror, glasses = mirror, ()
        if mirror:
            mirrors = builder.AddNamedSystem("mirrors", MirrorScene(scene, [plate]))
            glasses = mirrors.glasses
            builder.Connect(mirrors.get_output_port(), scene.get_source_pose_port(mirrors.source))
            builder.ExportInput(mirrors.GetInputPort("mirror_pose"), "mirror")
        cameras = builder.AddNamedSystem(
            "cameras",
            StereoCameras(
                rig,
                (scene.world_frame_id(),) * 2,
                quality or ImageQuality(noise=0.0),
                glasses=glasses,
            ),
        )
        builder.Connect(scene.get_query_output_port(), cameras.get_input_port())
        builder.ExportInput(scene.get_source_pose_port(self.source), "poses")
        for camera in ("left", "right"):
            builder.ExportOutput(cameras.GetOutputPort(f"{camera}_image"), camera)
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()

    def _card(self, scene):
        """A fiducial that is seen along z, with a back."""
        frame = scene.RegisterFrame(self.source, GeometryFrame("card"))
        card = textured_card("card", fiducial_png(7), (CARD, CARD), RigidTransform(), 5)
        scene.RegisterGeometry(self.source, frame, card)
        behind = RigidTransform(p=[0.0, 0.0, 0.0015])
        scene.RegisterGeometry(
            self.source, frame, _painted(Box(CARD, CARD, 0.002), behind, "back", 6)
        )
        return frame

    def _box(self, scene):
        frame = scene.RegisterFrame(self.source, GeometryFrame("block"))
        block = _painted(Box(BLOCK, BLOCK, BLOCK), RigidTransform(), "block", 7)
        scene.RegisterGeometry(self.source, frame, block)
        return frame

    def look(self, X_LM=None, X_LC=None, X_LB=None):
        """Return both cameras' pictures, BGR, with mirror M, card C, block B where told."""
        poses = FramePoseVector()
        for frame, X in zip(self.frames, (X_LC, X_LB), strict=True):
            X_WF = GONE if X is None else self.X_WL @ X
            poses.set_value(frame, RigidTransform(pose=X_WF))
        self.diagram.GetInputPort("poses").FixValue(self.context, AbstractValue.Make(poses))
        if self.mirror:
            X_WM = AWAY if X_LM is None else RigidTransform(pose=self.X_WL @ X_LM)
            self.diagram.GetInputPort("mirror").FixValue(self.context, AbstractValue.Make(X_WM))
        return [bgr_of(self.diagram.GetOutputPort(e).Eval(self.context)) for e in ("left", "right")]


def plate_pose(mirror, x=0.035):
    """Return the pose of a plate in the left camera's frame, its middle before both cameras."""
    into = -mirror.normal
    right = np.cross([0.0, 1.0, 0.0], into)
    right /= np.linalg.norm(right)
    depth = -(mirror.distance + mirror.normal[0] * x) / mirror.normal[2]
    return transform(np.stack([right, np.cross(into, right), into], axis=1), [x, 0.0, depth])


def facing(p, to):
    """Return the pose of a card at p whose picture is seen from a point."""
    into = (p - to) / np.linalg.norm(p - to)
    right = np.cross([0.0, 1.0, 0.0], into)
    right /= np.linalg.norm(right)
    return transform(np.stack([right, np.cross(into, right), into], axis=1), p)


def _painted(shape, X, name, label):
    instance = GeometryInstance(X, shape, name)
    properties = PerceptionProperties()
    properties.AddProperty("label", "id", RenderLabel(label))
    properties.AddProperty("phong", "diffuse", Rgba(0.9, 0.6, 0.1, 1.0))
    instance.set_perception_properties(properties)
    return instance

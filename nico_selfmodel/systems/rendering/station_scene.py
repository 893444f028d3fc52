"""The world that a simulated robot's cameras look at: its body, what it is marked with, a board."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.geometry import (
    Box,
    FrameId,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    LightParameter,
    MakeRenderEngineVtk,
    PerceptionProperties,
    RenderEngineVtkParams,
    RenderLabel,
    Rgba,
    Role,
    SceneGraph,
    SourceId,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from nico_selfmodel.plant.model_in_plant import ModelInPlant
from nico_selfmodel.systems.closing import Closable
from nico_selfmodel.systems.rendering.mounted_camera import Sight
from nico_selfmodel.systems.rendering.renderer import check_renderer
from nico_selfmodel.systems.rendering.stereo_cameras import RENDERER
from nico_selfmodel.systems.rendering.textured_card import textured_card
from nico_selfmodel.systems.simulated.joint_mechanics import JointMechanics
from nico_selfmodel.vision.boards.chessboard import Board
from nico_selfmodel.vision.printed_pattern import chessboard_png, fiducial_png, printed_size

CARD = 0.036
"""Side of the card that Nico's fiducial is printed on, white zone included [m]."""
ROOM = (0.36, 0.40, 0.43)
"""Colour of the room behind everything."""
_LOOKED_AT = {"fiducial": 0.032, "finger_tip": 0.018}
"""Radius of what a tracker must see of a point to find it, white zone or tape and a little more
[m]."""
_LIGHTS = (
    # Where the light goes, in the world, and how strong it is: from behind the head, from both
    # sides and from the front, so that nothing is black.
    ((0.6, 0.1, -0.8), 0.55),
    ((0.2, 0.6, -0.4), 0.30),
    ((0.2, -0.6, -0.4), 0.30),
    ((-0.7, 0.0, -0.2), 0.25),
)
_LAMPS = (((0.8, 0.0, 0.6), 0.3), ((0.5, 0.8, 0.3), 0.3), ((0.5, -0.8, 0.3), 0.3))
"""Of a room with cards: they light what hangs about the robot and faces it."""
_GLARE = ((-0.8, 0.0, -0.35), 0.7)
"""What a mirror before the robot throws back of the light from behind its head."""
_TAPE = (0.0104, 0.0104, 0.0145)
"""Sides of the tape around a finger of 10 mm: the thesis' 14 x 9 x 8 mm, but not inside it [m]."""
_RED = (0.85, 0.08, 0.08, 1.0)
_FIDUCIAL_LABEL, _BOARD_LABEL, _TAPE_LABEL = 1001, 1002, 1003
_AWAY = RigidTransform(p=[0.0, 0.0, -50.0])
"""Where a board is that nobody holds."""


def add_renderer(
    scene_graph: SceneGraph,
    *,
    glare: bool = False,
    lamps: bool = False,
    R_WR: NDArray | None = None,
    context: Context | None = None,
) -> None:
    """Add a renderer with lights that stand still in the room.

    Args:
        scene_graph: Where to add it.
        glare: Whether a mirror before the robot throws light back at it.
        lamps: Whether lamps light what hangs about the robot.
        R_WR: How the room stands in the scene graph's world; as its robot if omitted. Shape (3, 3).
        context: The scene graph's, if it takes the place of the one that it has there.

    Raises:
        RobotError: If nothing can be rendered here.
    """
    turned = np.eye(3) if R_WR is None else R_WR
    lights = [
        LightParameter(
            type="directional", frame="world", direction=turned @ way, intensity=intensity
        )
        for way, intensity in (*_LIGHTS, *([_GLARE] if glare else []), *(_LAMPS if lamps else ()))
    ]
    parameters = RenderEngineVtkParams(default_clear_color=np.array(ROOM), lights=lights)
    check_renderer()
    renderer = MakeRenderEngineVtk(parameters)
    if context is None:
        scene_graph.AddRenderer(RENDERER, renderer)
    else:
        scene_graph.RemoveRenderer(context, RENDERER)
        scene_graph.AddRenderer(context, RENDERER, renderer)


def remove_scene(scene_graph: SceneGraph) -> None:
    """Take a renderer and everything that is to be seen out of a scene graph that is done with.

    Args:
        scene_graph: Nothing may look at it any more.
    """
    if scene_graph.HasRenderer(RENDERER):
        scene_graph.RemoveRenderer(RENDERER)
    inspector = scene_graph.model_inspector()
    fixed = inspector.world_frame_id()
    for source in inspector.GetAllSourceIds():
        for frame in (*inspector.FramesForSource(source), fixed):
            for geometry in inspector.GetGeometries(frame):
                if inspector.BelongsToSource(geometry, source):
                    scene_graph.RemoveGeometry(source, geometry)


def print_fiducial(
    scene_graph: SceneGraph,
    built: ModelInPlant,
    mount: str,
    marker: int,
    ball: str | None,
    at: str | None = None,
) -> None:
    """Put a real marker where the robot's file draws a rough one; take the tracker's ball off.

    Args:
        scene_graph: Where the robot is drawn.
        mount: Frame of the fiducial: z points out of the card, y to the picture's top.
        ball: Frame of the motion tracker's ball, which would hide a part of the fiducial.
        at: Frame where the marker really is, if not at its mount.
    """
    plant = built.plant
    frame = plant.GetFrameByName(at or mount, built.instance)
    X_MF = frame.GetFixedPoseInBodyFrame()
    _erase(scene_graph, built, mount, 0.006, 0.031)
    if ball is not None:
        _erase(scene_graph, built, ball, 0.015, 0.025)
    # Whoever looks at the card looks along -z of its mount.
    X_MC = X_MF @ RigidTransform(RotationMatrix.MakeXRotation(np.pi))
    body = plant.GetBodyFrameIdOrThrow(frame.body().index())
    card = textured_card(f"{mount}_card", fiducial_png(marker), (CARD, CARD), X_MC, _FIDUCIAL_LABEL)
    scene_graph.RegisterGeometry(plant.get_source_id(), body, card)


def wrap_tape(scene_graph: SceneGraph, built: ModelInPlant, tip: str) -> None:
    """Wrap red tape around a finger tip: the file's own is thinner than the finger within it.

    Args:
        scene_graph: Where the robot is drawn.
        tip: Frame in the middle of the tape, z along the finger.
    """
    plant = built.plant
    frame = plant.GetFrameByName(tip, built.instance)
    tape = GeometryInstance(frame.GetFixedPoseInBodyFrame(), Box(*_TAPE), f"{tip}_tape")
    properties = PerceptionProperties()
    properties.AddProperty("label", "id", RenderLabel(_TAPE_LABEL))
    properties.AddProperty("phong", "diffuse", Rgba(*_RED))
    tape.set_perception_properties(properties)
    body = plant.GetBodyFrameIdOrThrow(frame.body().index())
    scene_graph.RegisterGeometry(plant.get_source_id(), body, tape)


def sights_on(built: ModelInPlant, points: Mapping[str, str]) -> tuple[Sight, ...]:
    """Return what trackers of a robot's points look at.

    Args:
        points: Point -> its frame; those that nothing finds in a picture have no sight.
    """
    plant, found = built.plant, []
    for point, radius in _LOOKED_AT.items():
        if point in points:
            frame = plant.GetFrameByName(points[point], built.instance)
            body = plant.GetBodyFrameIdOrThrow(frame.body().index())
            p_FS = frame.GetFixedPoseInBodyFrame().translation()
            found.append(Sight(body, np.array(p_FS), radius))
    return tuple(found)


def _erase(
    scene_graph: SceneGraph, built: ModelInPlant, mount: str, reach: float, largest: float
) -> None:
    """Hide from the renderers the small shapes about a frame, of the bodies welded to it."""
    plant = built.plant
    frame = plant.GetFrameByName(mount, built.instance)
    inspector = scene_graph.model_inspector()
    context = plant.CreateDefaultContext()
    for body in plant.GetBodiesWeldedTo(frame.body()):
        X_MB = plant.CalcRelativeTransform(context, frame, body.body_frame())
        identifier = plant.GetBodyFrameIdIfExists(body.index())
        if identifier is None:
            continue
        for geometry in inspector.GetGeometries(identifier, Role.kPerception):
            center = (X_MB @ inspector.GetPoseInFrame(geometry)).translation()
            shape = inspector.GetShape(geometry)
            size = max(shape.size()) if isinstance(shape, Box) else _diameter(shape)
            if np.linalg.norm(center) < reach and size < largest:
                scene_graph.RemoveRole(plant.get_source_id(), geometry, Role.kPerception)


def _diameter(shape: object) -> float:
    radius = getattr(shape, "radius", None)
    return np.inf if radius is None else 2.0 * float(radius())


class BoardHolder(LeafSystem):
    """A chessboard that somebody holds up, or has put away.

    | port | | carries |
    |---|---|---|
    | `geometry_pose` | out | pose of the board for the scene graph |
    """

    def __init__(self, scene_graph: SceneGraph, board: Board) -> None:
        """Print the board and put it away."""
        super().__init__()
        self.board = board
        self.source: SourceId = scene_graph.RegisterSource("board")
        self._frame: FrameId = scene_graph.RegisterFrame(self.source, GeometryFrame("board"))
        center = RigidTransform(p=board.points.mean(axis=0))
        card = textured_card(
            "board", chessboard_png(board), printed_size(board), center, _BOARD_LABEL
        )
        scene_graph.RegisterGeometry(self.source, self._frame, card)
        self._pose = self.DeclareAbstractState(AbstractValue.Make(_AWAY))
        self.DeclareAbstractOutputPort(
            "geometry_pose",
            lambda: AbstractValue.Make(FramePoseVector()),
            self._tell,
            {self.all_state_ticket()},
        )

    def hold(self, context: Context, X_WG: NDArray | None) -> None:
        """Hold the board at a pose, None to put it away. Shape (4, 4)."""
        pose = _AWAY if X_WG is None else RigidTransform(pose=np.asarray(X_WG, dtype=float))
        context.SetAbstractState(self._pose, pose)

    def _tell(self, context: Context, value: AbstractValue) -> None:
        poses = FramePoseVector()
        poses.set_value(self._frame, context.get_abstract_state(self._pose).get_value())
        value.set_value(poses)


class BodyPoses(Closable, LeafSystem):
    """Where the robot and its tracked points are; joints that nobody commands stand still.

    | port | | carries |
    |---|---|---|
    | `q_true` | in | of the commanded joints [rad] |
    | `geometry_pose` | out | poses of the robot's bodies for the scene graph |
    | `p_BH_true` | out | x y z of each tracked point in turn, in the frame of the base [m] |
    """

    def __init__(
        self, built: ModelInPlant, held: Mapping[str, float], mechanics: JointMechanics
    ) -> None:
        """Take the robot, where its other joints stand [rad], and its joints as they are built."""
        super().__init__()
        plant, joints = built.plant, mechanics.servos.joints
        self.__mechanics, self.__rest = mechanics, plant.GetDefaultPositions()
        for joint, value in held.items():
            start = plant.GetJointByName(joint, built.instance).position_start()
            self.__rest[start] = value
        self._columns = built.columns_of(joints)
        # As a system of the diagram the plant could not be given back.
        self.__plant: MultibodyPlant | None = plant
        self.__context: Context | None = plant.CreateDefaultContext()
        self._angles = self.DeclareVectorInputPort("q_true", len(joints))
        needs = {self._angles.ticket()}
        self.DeclareAbstractOutputPort(
            "geometry_pose", lambda: AbstractValue.Make(FramePoseVector()), self._pose, needs
        )
        size = 3 * len(mechanics.markers)
        self.DeclareVectorOutputPort("p_BH_true", BasicVector(size), self._place, needs)

    def _pose(self, context: Context, value: AbstractValue) -> None:
        self.require_open()
        plant, inner = self.__plant, self.__context
        assert plant is not None
        q = self.__rest.copy()
        q[self._columns] = self._angles.Eval(context)
        plant.SetPositions(inner, q)
        value.set_value(plant.get_geometry_pose_output_port().Eval(inner))

    def _place(self, context: Context, vector: BasicVector) -> None:
        vector.SetFromVector(self.__mechanics.points(self._angles.Eval(context)).ravel())

    def _give_back(self) -> None:
        self.__plant = self.__context = None

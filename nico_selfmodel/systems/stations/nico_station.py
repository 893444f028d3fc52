"""A simulated robot before the world: servos, cameras, trackers, motion capture, in one diagram."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import SceneGraph
from pydrake.systems.framework import Diagram, DiagramBuilder

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import RobotError
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.plant.body_description import BodyDescription
from nico_selfmodel.plant.link_surfaces import LinkSurface
from nico_selfmodel.systems.closing import Closable, free_memory
from nico_selfmodel.systems.image_values import bgr_of
from nico_selfmodel.systems.looking import looking_arm
from nico_selfmodel.systems.nico_cameras import MOUNTS, NICO_CAMERAS
from nico_selfmodel.systems.rendering.coarse_solids import draw_coarsely
from nico_selfmodel.systems.rendering.mark_on_body import Mark, MarkOnBody
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate, MirrorScene
from nico_selfmodel.systems.rendering.paints import paint_otherwise
from nico_selfmodel.systems.rendering.room import hang_cards, paper_walls
from nico_selfmodel.systems.rendering.station_scene import (
    ROOM,
    BoardHolder,
    BodyPoses,
    add_renderer,
    remove_scene,
    sights_on,
)
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality, StereoCameras
from nico_selfmodel.systems.simulated.encoder_model import EncoderModel
from nico_selfmodel.systems.simulated.ground_truth import GroundTruth
from nico_selfmodel.systems.simulated.imperfections import Imperfections, imperfections_named
from nico_selfmodel.systems.simulated.motion_capture import MotionCapture
from nico_selfmodel.systems.stations.hand_marks import mark_hands
from nico_selfmodel.systems.stations.nico_detectors import (
    body_detectors,
    default_detectors,
    room_detectors,
)
from nico_selfmodel.systems.stations.nico_instance import NicoInstance
from nico_selfmodel.systems.stations.other_robot import OTHER, OtherRobot, add_other_robot
from nico_selfmodel.systems.stations.whole_nico import WholeNico
from nico_selfmodel.systems.tracking.hand_tracker import (
    Detectors,
    HandTracker,
    MirrorDetectors,
)
from nico_selfmodel.systems.tracking.mirror_expectation import connect_expectation
from nico_selfmodel.systems.tracking.reflection_detectors import default_mirror_detectors
from nico_selfmodel.vision.boards.chessboard import Board
from nico_selfmodel.vision.markers.tag_card import TagCard

BOARD = Board(9, 6, 0.028)
"""The thesis' chessboard: squares of 28 mm."""


class NicoStation(Closable, Diagram):
    """One robot of Nico, with everything that it can sense.

    | port | | carries |
    |---|---|---|
    | `encoders_commanded` | in | where the `joints` shall go [encoder units] |
    | `encoders` | out | encoder readings [encoder units] |
    | `left_image`, `right_image` | out | pictures of the wide cameras, `ImageRgba8U` |
    | `pixels` | out | left u, v, right u, v of each marker in turn, nan if not seen [px] |
    | `seen` | out | 1 where a camera sees a marker, else 0: left, right of each in turn |
    | `reasons` | out | why a marker was not seen: a tuple of texts |
    | `p_WH_measured` | out | x y z of each point that motion capture sees [m], nan if lost |
    | `frame_number` | out | frames that motion capture has taken |

    A station with a mirror has `mirror_pose` (in: pose of the mirror in the frame of the arm's
    base, a `RigidTransform`; away if not connected) and `reflected_pixels`, `reflected_seen`,
    `reflected_reasons` (out: as `pixels`, `seen` and `reasons`, of the reflections). One with
    another robot has `other_commanded` (in: as `encoders_commanded`, of that robot's servos), which
    must be given.

    A station of real servos and cameras can have the same ports. What only the simulation knows,
    the true geometry, pose and lenses, has none; nor has the light, nor who holds the chessboard.
    Everything random comes from `seed` (the robot) and `session` (what happens to it).

    Use it in a `with` block, or `close` it: its renderer takes 50 MB. A station that was closed
    raises `RobotError`, also from the ports of a diagram that it is part of.
    """

    def __init__(
        self,
        world: Imperfections | str = "thesis",
        seed: int = 0,
        session: int = 0,
        *,
        arm: ArmDescription | BodyDescription | None = None,
        detectors: Detectors | MirrorDetectors | None = None,
        quality: ImageQuality | None = None,
        mirror: MirrorPlate | None = None,
        knows: SelfModel | None = None,
        other: bool = False,
        room: Sequence[TagCard] = (),
        near_marks: bool | None = None,
    ) -> None:
        """Build the robot and its surroundings.

        Args:
            world: What is wrong with the body, or the name of a documented world.
            seed: Which robot.
            session: Which day: play, noise, drop-outs.
            arm: The robot and its arm, head turned to where it looks; `looking_arm()` by default.
                Of a whole body (`looking_body`) the joints that it names are commanded, the head's
                and both arms' alike; one seed is one robot whichever they are.
            detectors: Marker -> what finds it in a picture; `fiducial` and `finger_tip` by default,
                of a whole body the fiducials of both hands and the right finger's tip.
                Before a mirror, what tells each from its reflection (`reflection_detectors`).
            mirror: A mirror that can be put somewhere, if any.
            knows: What the body has learned of arm and cameras; before a mirror it tells a patch of
                colour on the hand from the reflection by where it expects its hand.
            other: Whether there is a second robot that can be put somewhere (`stand_other`).
            room: Cards of markers that hang about it, W the frame of its root link.
            near_marks: Show the detectors only what is about the arm's own fiducial and finger tip,
                pixel by pixel as in the whole picture, which takes a third of the time; by default
                where they are the default ones of an arm, and nothing else could be taken for these
                points. `left_image` and `right_image` always show everything.

        Raises:
            ModelError: If the robot lacks a link that carries a camera.
        """
        super().__init__()
        world = imperfections_named(world)
        arm = arm or looking_arm()
        body = _built(arm, world, seed, NICO_CAMERAS)
        quality = quality or ImageQuality()
        if near_marks is None:
            near_marks = detectors is None and not (room or other)
        near_marks &= mirror is None and quality.exposures == 1
        if detectors is None and isinstance(arm, BodyDescription) and mirror is None:
            detectors = {**body_detectors(), **room_detectors(room)} if room else body_detectors()
        elif detectors is None:
            detectors = default_detectors() if mirror is None else default_mirror_detectors()
        self.arm, self.world, self.seed, self.session = arm, world, seed, session
        self.tracked = tuple(detectors)
        self.image_size = NICO_CAMERAS.left.image_size
        self.board = BOARD
        self.__instance = body
        builder = DiagramBuilder()
        noise = (seed, session)
        start = body.mechanics.servos.to_encoder(np.zeros(len(arm.joints)))
        servos = EncoderModel(body.mechanics, start, seed=noise)
        builder.AddNamedSystem("servos", servos)
        self.__holder, cameras, poses, self.__marks = _add_scene(
            builder, servos, arm, body, BOARD, quality, noise, mirror, room, near_marks, world
        )
        scene: Any = builder.GetMutableSubsystemByName("scene")
        self.__scene: SceneGraph = scene
        if world.papered and mirror is not None:  # else they are behind the cameras
            paper_walls(scene)
        self.__other: OtherRobot | None = None
        if other:  # of the description's colours
            self.__other, second = add_other_robot(builder, self.__scene, body, noise)
            mark_hands(self.__scene, second, arm)
            self.__marks.on_links(second, OTHER)
        _add_motion_capture(builder, poses, body, world, noise)
        tracker = HandTracker(detectors, before_mirror=mirror is not None)
        builder.AddNamedSystem("tracker", tracker)
        shown = "sight" if cameras.HasOutputPort("left_sight") else "image"
        for camera in ("left", "right"):
            port = cameras.GetOutputPort(f"{camera}_image")
            seen = cameras.GetOutputPort(f"{camera}_{shown}")
            builder.Connect(seen, tracker.GetInputPort(f"{camera}_image"))
            builder.ExportOutput(port, f"{camera}_image")
        for port in ("pixels", "seen", "reasons"):
            builder.ExportOutput(tracker.GetOutputPort(port), port)
            if mirror is not None:
                reflected = f"reflected_{port}"
                builder.ExportOutput(tracker.GetOutputPort(reflected), reflected)
        if mirror is not None and knows is not None:
            connect_expectation(builder, servos.GetOutputPort("encoders"), tracker, knows)
        builder.ExportInput(servos.GetInputPort("encoders_commanded"), "encoders_commanded")
        builder.ExportOutput(servos.GetOutputPort("encoders"), "encoders")
        builder.BuildInto(self)
        self.set_name("nico")

    def _give_back(self) -> None:
        for part in self.GetSystems():
            if isinstance(part, Closable):
                part.close()
            elif isinstance(part, SceneGraph):
                remove_scene(part)
        free_memory()

    @property
    def joints(self) -> tuple[JointInfo, ...]:
        """Names, units and stops of the joints that are commanded, as a data set states them."""
        return self.__instance.mechanics.joints

    @property
    def ground_truth(self) -> GroundTruth:
        """What only the simulation knows: for judging and for tests, never for learning."""
        return self.__instance.ground_truth

    def ground_truth_in(self, context: Any) -> GroundTruth:
        """Say the same with the cameras where a whole body's joints stand: never for learning.

        Args:
            context: The station's context, or that of a diagram it is part of.
        """
        if not isinstance(self.__instance, WholeNico):
            return self.ground_truth
        servos = self.GetSubsystemByName("servos")
        own = servos.GetMyContextFromRoot(context)
        return self.__instance.standing(np.array(servos.GetOutputPort("q_true").Eval(own)))

    def hold_board(self, context: Any, X_BG: NDArray | None) -> None:
        """Hold the chessboard before the robot.

        Args:
            context: The station's context, or that of a diagram it is part of.
            X_BG: Pose of the board in the frame of the arm's base: corners in the plane z = 0,
                the first one at the origin, seen along z; None puts it away. Shape (4, 4).
        """
        self.require_open()
        self.__holder.hold(self.__holder.GetMyMutableContextFromRoot(context), X_BG)

    def stand_other(self, context: Any, X_WO: NDArray | None) -> None:
        """Let the second robot stand somewhere.

        Args:
            context: The station's context, or that of a diagram it is part of.
            X_WO: Pose of its root in that of the first robot; None puts it away. Shape (4, 4).

        Raises:
            RobotError: If the station was closed, or was built without a second robot.
        """
        self.require_open()
        if self.__other is None:
            raise RobotError("there is no second robot: build the station with other=True")
        self.__other.stand(self.__other.GetMyMutableContextFromRoot(context), X_WO)

    def paint(self, context: Any, mark: Mark) -> None:
        """Put a mark on the robot, on the second robot (`OTHER` and a link) or on the mirror.

        Args:
            context: The station's context, or that of a diagram it is part of.
            mark: What and where.

        Raises:
            RobotError: If the station was closed, or there is nothing to paint there.
        """
        self.require_open()
        self.__marks.paint(self.__scene.GetMyMutableContextFromRoot(context), mark)

    def wipe(self, context: Any) -> None:
        """Take all marks off.

        Args:
            context: The station's context, or that of a diagram it is part of.

        Raises:
            RobotError: If the station was closed.
        """
        self.require_open()
        self.__marks.wipe(self.__scene.GetMyMutableContextFromRoot(context))

    def surfaces_true(self, context: Any) -> dict[str, tuple[LinkSurface, NDArray]]:
        """Say where all surfaces really are: for who paints marks and judges, never for learning.

        Args:
            context: The station's context, or that of a diagram it is part of.

        Returns:
            Link -> its surface, and its pose in the left camera's frame, shape (4, 4).

        Raises:
            RobotError: If the station was closed.
        """
        self.require_open()
        query: Any = self.__scene.get_query_output_port().Eval(
            self.__scene.GetMyContextFromRoot(context)
        )
        surfaces = {k: v for k, v in self.__marks.places.items() if v is not None}
        poses = {k: query.GetPoseInWorld(v.frame).GetAsMatrix4() for k, v in surfaces.items()}
        X_LW = self.ground_truth_in(context).X_LB  # the base's frame is the scene's world
        return {link: (surface, X_LW @ poses[link]) for link, surface in surfaces.items()}

    def picture(self, context: Any, camera: str) -> NDArray:
        """Return what a camera sees, BGR of shape (h, w, 3), in the station's own context.

        Raises:
            RobotError: If the station was closed, or nothing can be rendered.
        """
        self.require_open()
        return bgr_of(self.GetOutputPort(f"{camera}_image").Eval(context))


def _built(
    arm: ArmDescription | BodyDescription, world: Imperfections, seed: int, cameras: StereoRig
) -> NicoInstance | WholeNico:
    """Return the robot of a seed."""
    if isinstance(arm, BodyDescription):
        return WholeNico.build(arm, world, seed, cameras)
    return NicoInstance.build(arm, world, seed, cameras)


def _add_scene(
    builder: DiagramBuilder,
    servos: EncoderModel,
    arm: ArmDescription | BodyDescription,
    body: NicoInstance | WholeNico,
    board: Board,
    quality: ImageQuality,
    seed: tuple[int, int],
    mirror: MirrorPlate | None,
    room: Sequence[TagCard],
    near_marks: bool,
    world: Imperfections,
) -> tuple[BoardHolder, StereoCameras, BodyPoses, MarkOnBody]:
    """Add what is to be seen, and what sees it."""
    scene_graph = SceneGraph()
    builder.AddNamedSystem("scene", scene_graph)
    built = body.in_scene(scene_graph)
    if world.paint_sigma > 0.0:
        paint_otherwise(scene_graph, built, world.paint_sigma, np.random.default_rng((seed[0], 51)))
    add_renderer(scene_graph, glare=mirror is not None, lamps=bool(room))
    mark_hands(scene_graph, built, arm)
    hang_cards(scene_graph, room)
    frames = tuple(
        built.plant.GetBodyFrameIdOrThrow(built.plant.GetBodyByName(link).index())
        for link in MOUNTS
    )
    poses = BodyPoses(built, body.held, body.mechanics)
    builder.AddNamedSystem("poses", poses)
    holder = BoardHolder(scene_graph, board)
    mirrors = None if mirror is None else MirrorScene(scene_graph, [mirror])
    glasses = () if mirrors is None else mirrors.glasses
    points = arm.points if near_marks and isinstance(arm, ArmDescription) else {}
    cameras = StereoCameras(
        body.rig,
        frames,
        quality,
        seed=seed,
        glasses=glasses,
        sights=sights_on(built, points),
        background=ROOM,
        turns=not world.papered,
    )
    builder.AddNamedSystem("board", holder)
    builder.AddNamedSystem("cameras", cameras)
    builder.Connect(servos.GetOutputPort("q_true"), poses.get_input_port())
    builder.Connect(
        poses.GetOutputPort("geometry_pose"),
        scene_graph.get_source_pose_port(built.plant.get_source_id()),
    )
    builder.Connect(holder.get_output_port(), scene_graph.get_source_pose_port(holder.source))
    builder.Connect(scene_graph.get_query_output_port(), cameras.get_input_port())
    marks = MarkOnBody(scene_graph)
    marks.on_links(built)
    if mirrors is not None:
        builder.AddNamedSystem("mirrors", mirrors)
        builder.Connect(mirrors.get_output_port(), scene_graph.get_source_pose_port(mirrors.source))
        builder.ExportInput(mirrors.get_input_port(), "mirror_pose")
        marks.on_glass(mirrors.source, mirrors.glasses[0].frame)
    if mirrors is None:  # what is learned of shapes before a mirror is held against the solids
        draw_coarsely(scene_graph, built.plant.get_source_id())
    return holder, cameras, poses, marks


def _add_motion_capture(
    builder: DiagramBuilder,
    poses: BodyPoses,
    body: NicoInstance | WholeNico,
    world: Imperfections,
    seed: tuple[int, int],
) -> None:
    tracker = builder.AddNamedSystem(
        "motion_capture",
        MotionCapture(
            body.mechanics.markers,
            X_WB=body.X_TB,
            sigma=world.marker_sigma,
            dropout_share=world.dropout_share,
            seed=seed,
        ),
    )
    builder.Connect(poses.GetOutputPort("p_BH_true"), tracker.get_input_port())
    for port in ("p_WH_measured", "frame_number"):
        builder.ExportOutput(tracker.GetOutputPort(port), port)

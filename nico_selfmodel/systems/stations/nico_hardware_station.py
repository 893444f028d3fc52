"""The real robot before the world: servos, cameras, motion capture, with `NicoStation`'s ports."""

from collections.abc import Sequence
from contextlib import ExitStack

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, Diagram, DiagramBuilder, LeafSystem

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import RobotError
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.systems.hardware.camera_driver import CameraDriver
from nico_selfmodel.systems.hardware.motion_capture_link import MotionCaptureReceiver
from nico_selfmodel.systems.hardware.motion_capture_stream import MotionCaptureClient
from nico_selfmodel.systems.hardware.servo_driver import ServoDriver
from nico_selfmodel.systems.image_values import image_value
from nico_selfmodel.systems.looking import MARKER_FRAMES
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.stations.nico_detectors import default_detectors
from nico_selfmodel.systems.stations.station_body import SettleTimeouts, StationBody
from nico_selfmodel.systems.tracking.hand_tracker import Detectors, HandTracker
from nico_selfmodel.with_blocks import OpenedAtStart

REAL = SettleTimeouts(
    settle=0.4, dither=2e-4, astray=0.02, timeout=60.0, look_again=1.0, real_time=True
)
"""How long a body of real servos is waited for."""


class NicoHardwareStation(OpenedAtStart, Diagram):
    """The real Nico, with the ports of the simulated one.

    | port | | carries |
    |---|---|---|
    | `encoders_commanded` | in | where the joints shall go [counts]; one at nan is not commanded |
    | `encoders` | out | encoder readings [counts]; nan where a joint was not read lately |
    | `left_image`, `right_image` | out | pictures of the cameras, `ImageRgba8U` |
    | `pixels` | out | left u, v, right u, v of each marker in turn, nan if not seen [px] |
    | `seen` | out | 1 where a camera sees a marker, else 0: left, right of each in turn |
    | `reasons` | out | why a marker was not seen: a tuple of texts |
    | `p_WH_measured` | out | x y z of each point that motion capture sees [m], nan if lost |
    | `frame_number` | out | frames that motion capture has taken |

    A port of an instrument that is not there can be asked, and then raises `RobotError`: it says
    what is missing. Making a station opens nothing; use it in a `with` block, or call `open` and
    `close`. Joints of the configuration that are not in `joints` hold wherever they stand.
    """

    def __init__(
        self,
        servos: ServoDriver,
        cameras: CameraDriver | None = None,
        motion_capture: MotionCaptureClient | None = None,
        *,
        joints: Sequence[str] | None = None,
        detectors: Detectors | None = None,
    ) -> None:
        """Compose the robot.

        Args:
            cameras: Its cameras, not open yet; none if omitted.
            motion_capture: Connected to whoever tracks markers; closed by who made it.
            joints: Which joints the ports are about; all of the servos if omitted.
            detectors: Marker -> what finds it in a picture; `fiducial` and `finger_tip` by default.

        Raises:
            ValueError: If a joint is not among the servos.
        """
        super().__init__()
        names = servos.joints if joints is None else tuple(joints)
        if strangers := [name for name in names if name not in servos.joints]:
            raise ValueError(
                f"no servo drives {', '.join(strangers)}; the servos are {', '.join(servos.joints)}"
            )
        self.servos, self.cameras, self.motion_capture = servos, cameras, motion_capture
        detectors = default_detectors() if detectors is None else detectors
        self.tracked = tuple(detectors)
        self.image_size = NICO_CAMERAS.left.image_size if cameras is None else cameras.image_size
        chosen = [servos.joints.index(name) for name in names]
        infos = servos.config.joint_infos
        self.joints: tuple[JointInfo, ...] = tuple(infos[k] for k in chosen)
        self.markers = tuple(MARKER_FRAMES) if motion_capture is None else motion_capture.markers
        builder = DiagramBuilder()
        builder.AddNamedSystem("servos", servos)
        _add_arm(builder, servos, chosen)
        _add_cameras(builder, cameras, detectors, self.image_size)
        tracker = (
            _Missing("motion capture", {"p_WH_measured": 3 * len(self.markers)})
            if motion_capture is None
            else MotionCaptureReceiver(motion_capture, _FRAMES)
        )
        builder.AddNamedSystem("motion_capture", tracker)
        for port in ("p_WH_measured", "frame_number"):
            builder.ExportOutput(tracker.GetOutputPort(port), port)
        builder.BuildInto(self)
        self.set_name("nico")

    def open(self) -> tuple[str, ...]:
        """Open servos and cameras. Switches nothing on, moves nothing.

        Returns:
            Joints whose zero is not known.

        Raises:
            RobotError: If one of them cannot be opened; none stays open then.
        """
        with ExitStack() as stack:
            if self.cameras is not None:
                stack.enter_context(self.cameras)
            due = self.servos.open()
            stack.pop_all()
        return due

    def enable(self) -> None:
        """Switch the servos on where the joints stand. Nothing moves.

        Raises:
            RobotError: If one cannot be switched on.
        """
        self.servos.enable()

    def close(self) -> None:
        """Stop what moves and free all devices; never fails."""
        self.servos.close()
        if self.cameras is not None:
            self.cameras.close()

    def body(self, sensor: str = "cameras", *, keep_images: bool = False) -> StationBody:
        """Return what can be sent to poses, with the patience that real servos need.

        Args:
            sensor: `cameras` or `motion-capture`.

        Raises:
            RobotError: If that sensor is not there, or the station is not open.
        """
        there = self.cameras if sensor == "cameras" else self.motion_capture
        if there is None:
            raise RobotError(f"this station has no {sensor}: give it when making the station")
        markers = self.tracked if sensor == "cameras" else self.markers
        return StationBody(
            self, self.joints, markers, sensor=sensor, keep_images=keep_images, patience=REAL
        )


_FRAMES = 10.0
"""How often a station looks for a new frame of motion capture [1/s]."""


def _add_arm(builder: DiagramBuilder, servos: ServoDriver, chosen: list[int]) -> None:
    """Export commands and readings of some joints, in counts."""
    commands = builder.AddNamedSystem("commands", _Commands(len(servos.joints), chosen))
    readings = builder.AddNamedSystem("readings", _Readings(len(servos.joints), chosen))
    builder.Connect(commands.get_output_port(), servos.GetInputPort("encoders_commanded"))
    builder.Connect(servos.GetOutputPort("encoders"), readings.get_input_port())
    builder.ExportInput(commands.get_input_port(), "encoders_commanded")
    builder.ExportOutput(readings.get_output_port(), "encoders")


def _add_cameras(
    builder: DiagramBuilder,
    cameras: CameraDriver | None,
    detectors: Detectors,
    image_size: tuple[int, int],
) -> None:
    """Export pictures, and what is found in them."""
    sides = _Missing("cameras", {}, image_size) if cameras is None else cameras
    builder.AddNamedSystem("cameras", sides)
    tracker = builder.AddNamedSystem("tracker", HandTracker(detectors))
    for camera in SIDES:
        port = sides.GetOutputPort(f"{camera}_image")
        builder.Connect(port, tracker.GetInputPort(f"{camera}_image"))
        builder.ExportOutput(port, f"{camera}_image")
    for port in ("pixels", "seen", "reasons"):
        builder.ExportOutput(tracker.GetOutputPort(port), port)


class _Commands(LeafSystem):
    """Commands of some joints in, of all joints out; the others are at nan."""

    def __init__(self, n: int, chosen: list[int]) -> None:
        super().__init__()
        self._chosen = chosen
        self._command = self.DeclareVectorInputPort("chosen", len(chosen))
        self.DeclareVectorOutputPort("all", BasicVector(n), self._spread)

    def _spread(self, context: Context, vector: BasicVector) -> None:
        readings = np.full(vector.size(), np.nan)
        if self._command.HasValue(context):
            readings[self._chosen] = self._command.Eval(context)
        vector.SetFromVector(readings)


class _Readings(LeafSystem):
    """Picks the readings of some joints."""

    def __init__(self, n: int, chosen: list[int]) -> None:
        super().__init__()
        self._chosen = chosen
        self._all = self.DeclareVectorInputPort("all", n)
        self.DeclareVectorOutputPort("chosen", BasicVector(len(chosen)), self._pick)

    def _pick(self, context: Context, vector: BasicVector) -> None:
        vector.SetFromVector(np.asarray(self._all.Eval(context))[self._chosen])


class _Missing(LeafSystem):
    """The ports of an instrument that is not there."""

    def __init__(
        self, what: str, vectors: dict[str, int], image_size: tuple[int, int] | None = None
    ) -> None:
        super().__init__()
        self._what = what
        if image_size is None:
            for name, size in {**vectors, "frame_number": 1}.items():
                self.DeclareVectorOutputPort(name, BasicVector(size), self._refuse)
            return
        for camera in SIDES:
            self.DeclareAbstractOutputPort(
                f"{camera}_image", lambda: image_value(*image_size), self._refuse
            )

    def _refuse(self, context: Context, value: AbstractValue | BasicVector) -> None:
        raise RobotError(
            f"this station has no {self._what}: give them to NicoHardwareStation to read this port"
        )

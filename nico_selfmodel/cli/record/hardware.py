"""`nico-selfmodel record --port`: the same recording, with real servos."""

import math
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import inputs, options, printer
from nico_selfmodel.cli.interruption import undisturbed
from nico_selfmodel.cli.option_groups import Chain, OptionGroup
from nico_selfmodel.cli.servo.opening import ask, say, speed_of
from nico_selfmodel.names import listed

if TYPE_CHECKING:
    from nico_selfmodel.cli.record.request import Request
    from nico_selfmodel.dataset.dataset import Dataset
    from nico_selfmodel.model.cameras.stereo_rig import StereoRig
    from nico_selfmodel.plant import ArmDescription
    from nico_selfmodel.servos import ServoConfig
    from nico_selfmodel.sessions.hardware_recording import Recording
    from nico_selfmodel.systems.hardware.camera_driver import CameraDriver
    from nico_selfmodel.systems.hardware.motion_capture_stream import MotionCaptureClient
    from nico_selfmodel.systems.hardware.servo_driver import ServoDriver
    from nico_selfmodel.systems.stations.nico_hardware_station import NicoHardwareStation


_PERIOD = 0.05
"""Time between two readings of the joints [s]: poses are waited for, no motion is followed."""
_ATTEMPTS, _SLACK = 5, 0.05
"""A recording takes minutes: a reply may be a second late before a board counts as lost. The arm
stands by then, as no goal lies further ahead than the heartbeat."""


_SOURCE = "Real camera: N of /dev/videoN, a video, or a folder of images."


@dataclass(frozen=True)
class Hardware(OptionGroup):
    """The real robot to record, if one is."""

    port: options.PortOrNone = None
    config: options.ConfigOrNone = None
    baud: options.BaudOrNone = None
    left_camera: Annotated[str | None, typer.Option("--left-camera", help=_SOURCE)] = None
    right_camera: Annotated[str | None, typer.Option("--right-camera", help=_SOURCE)] = None
    motion_capture: Annotated[
        str | None,
        typer.Option(
            "--motion-capture", metavar="HOST:PORT", help="Where real motion capture sends frames."
        ),
    ] = None
    robot: options.Robot = None
    arm: options.Arm = None
    base: options.Base = None
    tip: options.Tip = None
    hold: options.Hold = None
    speed_deg_s: options.Speed = None
    trust_zero: options.TrustZero = False
    yes: options.Yes = False

    @property
    def chain(self) -> Chain:
        """The arm that is moved."""
        return Chain(self.robot, self.arm, self.base, self.tip, self.hold)

    def is_meant(self, imperfections: str, sensor: str) -> bool:
        """Return whether a real robot is to be recorded.

        Raises:
            ValueError: If options contradict each other.
        """
        if self.port is None:
            if given := self._given():
                raise ValueError(
                    f"{given}: for a real robot, whose serial port --port names; a simulated one "
                    "is recorded without, another arm by `simulate motion-capture`"
                )
            return False
        if imperfections != "thesis":
            raise ValueError("--imperfections is about simulated robots: leave it out with --port")
        if sensor == "chessboard":
            raise ValueError(
                "a chessboard before real cameras needs no servos: take the pictures with any "
                "program as left01.png and right01.png, then run calibrate stereo"
            )
        return True

    def _given(self) -> str:
        """Return the options that were given, as a message lists them."""
        names = [field.name for field in fields(self)]
        return listed(
            f"--{name.replace('_', '-')}"
            for name in names
            if getattr(self, name) != getattr(_NOTHING, name)
        )

    def refuse_arm(self, why: str) -> None:
        """Refuse options that choose an arm.

        Raises:
            ValueError: If one was given; it says why they are of no use.
        """
        chosen = {"--robot": self.robot, "--arm": self.arm, "--base": self.base, "--tip": self.tip}
        given = [name for name, value in {**chosen, "--hold": self.hold or None}.items()
                 if value is not None]  # fmt: skip
        if given:
            raise ValueError(f"{', '.join(given)}: {why}, leave it out")


_NOTHING = Hardware()
"""What is there where no option was given."""


def record_hardware(request: "Request", hardware: Hardware) -> "Dataset":
    """Move the real arm and record what is seen; an interrupted recording goes on.

    Raises:
        ValueError: If an option is missing or does not fit.
        SelfModelError: If the robot fails, or a file is not valid.
    """
    import numpy as np

    from nico_selfmodel.dataset.csv_table import CsvTable
    from nico_selfmodel.sessions.hardware_recording import RealRecording

    config = configuration(hardware)
    rng = np.random.default_rng((request.seed, request.session, 2))
    table = None if request.poses is None else CsvTable.read(request.poses)
    planned = RealRecording.planned(
        request.sensor, config.joint_infos, request.circle, request.random, rng, table,
        _arm(hardware, config),
    )  # fmt: skip
    rig = inputs.cameras_of(request.cameras)
    return run_hardware(planned, config, request, hardware, rig)


def run_hardware(
    planned: "Recording",
    config: "ServoConfig",
    request: "Request",
    hardware: Hardware,
    rig: "StereoRig | None",
) -> "Dataset":
    """Open the devices, ask, and visit the poses of a recording.

    Raises:
        ValueError: If an option is missing or does not fit.
        SelfModelError: If the robot fails, or a file is not valid.
    """
    servos = _servos(hardware, config)
    motion_capture = _motion_capture(request.sensor, hardware)
    try:
        cameras = _cameras(request.sensor, hardware)
        station = _station(planned, servos, cameras, motion_capture, rig)
        with station:
            _announce(planned, servos, hardware)
            ask(f"Move {planned.moves} through {len(planned.plan)} poses?", yes=hardware.yes)
            station.enable()
            return _record(planned, station, config.name, request)
    finally:
        if motion_capture is not None:
            motion_capture.close()


def configuration(hardware: Hardware) -> "ServoConfig":
    """Read the servo configuration that was named.

    Raises:
        ValueError: If none was.
        DataError: If the file is not valid.
    """
    from nico_selfmodel.servos.arm.servo_config_file import load_servo_config

    if hardware.config is None:
        raise ValueError("--port needs --config, the servo configuration of this robot")
    config = load_servo_config(hardware.config)
    return config if hardware.baud is None else replace(config, baud=hardware.baud)


def _arm(hardware: Hardware, config: "ServoConfig") -> "ArmDescription | None":
    """Return the arm that was named, its limits those of its servos; None where none was."""
    import numpy as np

    if hardware.robot is None:
        if hardware.chain.names_a_part:
            raise ValueError("--arm, --base, --tip and --hold need --robot")
        return None
    described = inputs.chosen_arm(hardware.chain)
    servos = {joint.name: joint for joint in config.joints}
    missing = [name for name in described.joints if name not in servos]
    if missing:
        raise ValueError(
            f"the servo configuration has no {', '.join(missing)}: the arm of {hardware.robot} has "
            f"the joints {', '.join(described.joints)}"
        )
    limits = np.array([[servos[name].lower, servos[name].upper] for name in described.joints])
    return replace(described, lower=limits[:, 0], upper=limits[:, 1])


def _servos(hardware: Hardware, config: "ServoConfig") -> "ServoDriver":
    from nico_selfmodel.servos.bus_settings import BusSettings
    from nico_selfmodel.systems.hardware.servo_driver import ServoDriver

    largest = max(joint.max_velocity for joint in config.joints)
    assert hardware.port is not None
    return ServoDriver(
        hardware.port,
        config,
        trust_zero=hardware.trust_zero,
        speed=speed_of(hardware.speed_deg_s, largest),
        period=_PERIOD,
        settings=BusSettings(_ATTEMPTS, _SLACK, config.latency),
    )


def _motion_capture(sensor: str, hardware: Hardware) -> "MotionCaptureClient | None":
    from nico_selfmodel.systems.hardware.motion_capture_stream import MotionCaptureClient

    if sensor != "motion-capture":
        if hardware.motion_capture is not None:
            raise ValueError("--motion-capture needs --sensor motion-capture")
        return None
    if hardware.motion_capture is None:
        raise ValueError("--sensor motion-capture with --port needs --motion-capture HOST:PORT")
    host, _, port = hardware.motion_capture.rpartition(":")
    if not (host and port.isdecimal() and int(port) < 65536):
        raise ValueError(f"--motion-capture takes HOST:PORT, got {hardware.motion_capture!r}")
    return MotionCaptureClient((host, int(port)))


def _cameras(sensor: str, hardware: Hardware) -> "CameraDriver | None":
    from nico_selfmodel.systems.hardware.camera_driver import CameraDriver
    from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
    from nico_selfmodel.vision.images.stereo_capture import StereoCapture

    left, right = hardware.left_camera, hardware.right_camera
    if sensor == "motion-capture":
        if left is not None or right is not None:
            raise ValueError("--left-camera and --right-camera need a sensor stereo-...")
        return None
    if left is None or right is None:
        raise ValueError(f"--sensor {sensor} with --port needs --left-camera and --right-camera")
    return CameraDriver(StereoCapture(left, right, NICO_CAMERAS.left.image_size))


def _station(
    planned: "Recording",
    servos: "ServoDriver",
    cameras: "CameraDriver | None",
    motion_capture: "MotionCaptureClient | None",
    rig: "StereoRig | None",
) -> "NicoHardwareStation":
    from nico_selfmodel.systems.stations.nico_hardware_station import NicoHardwareStation

    return NicoHardwareStation(
        servos,
        cameras,
        motion_capture,
        joints=[joint.name for joint in planned.joints],
        detectors=planned.detectors(rig),
    )


def _announce(planned: "Recording", servos: "ServoDriver", hardware: Hardware) -> None:
    """Print where the joints stand and what limits they have."""
    state = servos.state()
    moved = {joint.name for joint in planned.joints}
    rows = []
    for k, joint in enumerate(servos.config.joints):
        q, zero = state.q[k], bool(state.zero_known[k] or hardware.trust_zero)
        rows.append(
            [
                joint.name,
                f"{math.degrees(q):.1f}" if zero else "not homed",
                f"{math.degrees(joint.lower):.1f} to {math.degrees(joint.upper):.1f}",
                f"{min(hardware.speed_deg_s or math.inf, math.degrees(joint.max_velocity)):.0f}",
                "moves" if joint.name in moved else "stays",
            ]
        )
    headings = ("joint", "at (deg)", "limits (deg)", "deg/s", "in this recording")
    printer.table(f"servos of {servos.config.name}", headings, rows)
    due = [
        name
        for name, known in zip(state.joints, state.zero_known, strict=True)
        if name in moved and not known
    ]
    if due and not hardware.trust_zero:
        raise ValueError(
            f"rezero is due: the zero of {', '.join(due)} is not known since the boards were "
            "switched on; run `servo home`, or give --trust-zero"
        )


def _record(
    planned: "Recording",
    station: "NicoHardwareStation",
    servos: str,
    request: "Request",
) -> "Dataset":
    from nico_selfmodel.errors import RobotError

    source = (
        f"{planned.robot}, servos {servos!r}, {planned.sensor}, poses {request.seed}, session "
        f"{request.session}"
    )
    try:
        with printer.progress_bar() as progress:
            return planned.run(
                station,
                inputs.name_after(request.out),
                source=source,
                folder=request.out,
                keep_images=request.images,
                progress=lambda done, total: progress("moving and looking", done, total),
            )
    except KeyboardInterrupt:
        with undisturbed():
            station.close()
            say(f"stopped; {planned.moves} holds. Start again to go on")
        raise
    except RobotError as error:
        if not request.out.exists():
            raise
        raise type(error)(
            f"{error}. What was recorded is in {request.out}: the same command goes on from there"
        ) from error

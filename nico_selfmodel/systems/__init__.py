"""Bodies and what drives and watches them: Drake systems to compose, and bodies ready to use.

`NicoStation` is a whole simulated robot, `NicoHardwareStation` the real one with the same ports, of
`ServoDriver` and `CameraDriver`; `StereoCameras`, `HandTracker`, `SelfModelPredictor`,
`MotionCapture` and `EncoderModel` are its parts, each usable alone. `EncodersToAngles` and
`AnglesToEncoders` stand between what is read and commanded and the angles that Drake speaks of.
`StationBody` drives a station from pose to pose.
"""

from typing import TYPE_CHECKING

from nico_selfmodel.lazy import lazy_names

if TYPE_CHECKING:
    from nico_selfmodel.systems.hardware.camera_driver import CameraDriver
    from nico_selfmodel.systems.hardware.motion_capture_link import (
        MotionCaptureReceiver,
        MotionCaptureSender,
    )
    from nico_selfmodel.systems.hardware.motion_capture_stream import (
        MotionCaptureClient,
        MotionCaptureServer,
    )
    from nico_selfmodel.systems.hardware.servo_driver import ServoDriver
    from nico_selfmodel.systems.looking import looking_arm, looking_body
    from nico_selfmodel.systems.measurements import CameraMeasurement
    from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate, put_mirror
    from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality, StereoCameras
    from nico_selfmodel.systems.simulated.encoder_model import EncoderModel
    from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS, Imperfections
    from nico_selfmodel.systems.simulated.motion_capture import MotionCapture
    from nico_selfmodel.systems.simulated.robot import SimulatedRobot
    from nico_selfmodel.systems.stations.nico_behind_bus import NicoBehindBus
    from nico_selfmodel.systems.stations.nico_hardware_station import NicoHardwareStation
    from nico_selfmodel.systems.stations.nico_station import NicoStation
    from nico_selfmodel.systems.stations.station_body import SettleTimeouts, StationBody
    from nico_selfmodel.systems.tracking.gaze_controller import GazeController
    from nico_selfmodel.systems.tracking.hand_tracker import HandTracker
    from nico_selfmodel.systems.tracking.reflection_detectors import default_mirror_detectors
    from nico_selfmodel.systems.tracking.responding_servos import RespondingServos
    from nico_selfmodel.systems.tracking.self_model_monitor import SelfModelMonitor
    from nico_selfmodel.systems.tracking.self_model_predictor import SelfModelPredictor
    from nico_selfmodel.systems.tracking.servo_maps import (
        AnglesToEncoders,
        EncodersToAngles,
        LoadedAngles,
    )

__all__ = [
    "IMPERFECTIONS",
    "AnglesToEncoders",
    "CameraDriver",
    "CameraMeasurement",
    "EncoderModel",
    "EncodersToAngles",
    "GazeController",
    "HandTracker",
    "ImageQuality",
    "Imperfections",
    "LoadedAngles",
    "MirrorPlate",
    "MotionCapture",
    "MotionCaptureClient",
    "MotionCaptureReceiver",
    "MotionCaptureSender",
    "MotionCaptureServer",
    "NicoBehindBus",
    "NicoHardwareStation",
    "NicoStation",
    "RespondingServos",
    "SelfModelMonitor",
    "SelfModelPredictor",
    "ServoDriver",
    "SettleTimeouts",
    "SimulatedRobot",
    "StationBody",
    "StereoCameras",
    "default_mirror_detectors",
    "looking_arm",
    "looking_body",
    "put_mirror",
]

# Drake's systems are slow to load: each when it is first asked for.
__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "hardware.camera_driver": ("CameraDriver",),
        "hardware.motion_capture_link": (
            "MotionCaptureReceiver",
            "MotionCaptureSender",
        ),
        "hardware.motion_capture_stream": (
            "MotionCaptureClient",
            "MotionCaptureServer",
        ),
        "hardware.servo_driver": ("ServoDriver",),
        "looking": ("looking_arm", "looking_body"),
        "measurements": ("CameraMeasurement",),
        "rendering.mirror_scene": (
            "MirrorPlate",
            "put_mirror",
        ),
        "rendering.stereo_cameras": (
            "ImageQuality",
            "StereoCameras",
        ),
        "simulated.encoder_model": ("EncoderModel",),
        "simulated.imperfections": (
            "IMPERFECTIONS",
            "Imperfections",
        ),
        "simulated.motion_capture": ("MotionCapture",),
        "simulated.robot": ("SimulatedRobot",),
        "stations.nico_behind_bus": ("NicoBehindBus",),
        "stations.nico_hardware_station": ("NicoHardwareStation",),
        "stations.nico_station": ("NicoStation",),
        "stations.station_body": ("SettleTimeouts", "StationBody"),
        "tracking.gaze_controller": ("GazeController",),
        "tracking.hand_tracker": ("HandTracker",),
        "tracking.reflection_detectors": ("default_mirror_detectors",),
        "tracking.responding_servos": ("RespondingServos",),
        "tracking.self_model_monitor": ("SelfModelMonitor",),
        "tracking.self_model_predictor": ("SelfModelPredictor",),
        "tracking.servo_maps": (
            "AnglesToEncoders",
            "EncodersToAngles",
            "LoadedAngles",
        ),
    },
)

"""Bodies and what drives and watches them: Drake systems to compose, and bodies ready to use.

`NicoStation` is a whole simulated robot, `NicoHardwareStation` the real one with the same ports, of
`ServoDriver` and `CameraDriver`; `StereoCameras`, `HandTracker`, `SelfModelPredictor`,
`MotionCapture` and `EncoderModel` are its parts, each usable alone. `StationBody` drives a station
from pose to pose.
"""

from typing import TYPE_CHECKING, Any

from nico_selfmodel.systems.hardware.motion_capture_stream import (
    MarkerFrame,
    MotionCaptureClient,
    MotionCaptureServer,
)
from nico_selfmodel.systems.measurements import CameraMeasurement, Measurement
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.simulated.cameras import SimulatedCameras
from nico_selfmodel.systems.simulated.ground_truth import GroundTruth
from nico_selfmodel.systems.simulated.imperfections import (
    IMPERFECTIONS,
    Imperfections,
    imperfections_named,
)
from nico_selfmodel.systems.simulated.mechanics import Mechanics
from nico_selfmodel.systems.simulated.robot import SimulatedRobot

if TYPE_CHECKING:
    from nico_selfmodel.systems.diagrams import (
        BOARD,
        CameraDriver,
        EncoderModel,
        HandTracker,
        ImageQuality,
        MirrorPlate,
        MotionCapture,
        MotionCaptureReceiver,
        MotionCaptureSender,
        NicoBehindBus,
        NicoHardwareStation,
        NicoStation,
        SelfModelMonitor,
        SelfModelPredictor,
        ServoDriver,
        SettleTimeouts,
        StationBody,
        StereoCameras,
        color_detector,
        default_detectors,
        fiducial_detector,
        looking_arm,
    )

__all__ = [
    "BOARD",
    "IMPERFECTIONS",
    "NICO_CAMERAS",
    "CameraDriver",
    "CameraMeasurement",
    "EncoderModel",
    "GroundTruth",
    "HandTracker",
    "ImageQuality",
    "Imperfections",
    "MarkerFrame",
    "Measurement",
    "Mechanics",
    "MirrorPlate",
    "MotionCapture",
    "MotionCaptureClient",
    "MotionCaptureReceiver",
    "MotionCaptureSender",
    "MotionCaptureServer",
    "NicoBehindBus",
    "NicoHardwareStation",
    "NicoStation",
    "SelfModelMonitor",
    "SelfModelPredictor",
    "ServoDriver",
    "SettleTimeouts",
    "SimulatedCameras",
    "SimulatedRobot",
    "StationBody",
    "StereoCameras",
    "color_detector",
    "default_detectors",
    "fiducial_detector",
    "imperfections_named",
    "looking_arm",
]


def __getattr__(name: str) -> Any:
    """Load the Drake systems when one of them is first asked for: they are slow to load."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from nico_selfmodel.systems import diagrams

    return getattr(diagrams, name)

"""Bodies and what drives and watches them: Drake systems to compose, and bodies ready to use.

`NicoStation` is a whole simulated robot, `NicoHardwareStation` the real one with the same ports, of
`ServoDriver` and `CameraDriver`; `StereoCameras`, `HandTracker`, `SelfModelPredictor`,
`MotionCapture` and `EncoderModel` are its parts, each usable alone. `StationBody` drives a station
from pose to pose.
"""

from typing import TYPE_CHECKING, Any

from nico_selfmodel.systems.eye_sighting import CameraMeasurement
from nico_selfmodel.systems.motion_capture_stream import (
    MarkerFrame,
    MotionCaptureClient,
    MotionCaptureServer,
)
from nico_selfmodel.systems.simulated_arm import Measurement, SimulatedArm
from nico_selfmodel.systems.simulated_body import TRACKERS, HandSighting, SimulatedBody
from nico_selfmodel.systems.simulated_eyes import NICO_CAMERAS, SimulatedEyes
from nico_selfmodel.systems.simulated_mirror import SimulatedMirrors
from nico_selfmodel.systems.worlds import IMPERFECTIONS, Imperfections, imperfections_named

if TYPE_CHECKING:
    from nico_selfmodel.systems.diagrams import (
        BOARD,
        CameraDriver,
        Detector,
        EncoderModel,
        HandTracker,
        ImageQuality,
        Mechanics,
        MirrorPlate,
        MirrorPredictor,
        MirrorScene,
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
        VisibleWorkspace,
        color_detector,
        default_detectors,
        fiducial_detector,
        looking_arm,
    )

__all__ = [
    "BOARD",
    "IMPERFECTIONS",
    "NICO_CAMERAS",
    "TRACKERS",
    "CameraDriver",
    "CameraMeasurement",
    "Detector",
    "EncoderModel",
    "HandSighting",
    "HandTracker",
    "ImageQuality",
    "Imperfections",
    "MarkerFrame",
    "Measurement",
    "Mechanics",
    "MirrorPlate",
    "MirrorPredictor",
    "MirrorScene",
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
    "SimulatedArm",
    "SimulatedBody",
    "SimulatedEyes",
    "SimulatedMirrors",
    "StationBody",
    "StereoCameras",
    "VisibleWorkspace",
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

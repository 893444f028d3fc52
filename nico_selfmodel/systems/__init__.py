"""Bodies and what drives and watches them: Drake systems to compose, and bodies ready to use.

`NicoStation` is a whole simulated robot, `NicoHardwareStation` the real one with the same ports, of
`ServoDriver` and `CameraDriver`; `StereoCameras`, `HandTracker`, `SelfModelPredictor`,
`MotionCapture` and `EncoderModel` are its parts, each usable alone. `StationBody` drives a station
from pose to pose.
"""

from typing import TYPE_CHECKING, Any

from nico_selfmodel.systems.eye_sighting import EyeSighting
from nico_selfmodel.systems.motion_capture_stream import (
    MarkerFrame,
    MotionCaptureClient,
    MotionCaptureServer,
)
from nico_selfmodel.systems.simulated_arm import Sighting, SimulatedArm
from nico_selfmodel.systems.simulated_body import TRACKERS, HandSighting, SimulatedBody
from nico_selfmodel.systems.simulated_eyes import NICO_EYES, SimulatedEyes
from nico_selfmodel.systems.simulated_mirror import SimulatedMirrors
from nico_selfmodel.systems.worlds import WORLDS, World, world_named

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
        Patience,
        Reach,
        SelfModelMonitor,
        SelfModelPredictor,
        ServoDriver,
        StationBody,
        StereoCameras,
        color_detector,
        default_detectors,
        fiducial_detector,
        looking_arm,
    )

__all__ = [
    "BOARD",
    "NICO_EYES",
    "TRACKERS",
    "WORLDS",
    "CameraDriver",
    "Detector",
    "EncoderModel",
    "EyeSighting",
    "HandSighting",
    "HandTracker",
    "ImageQuality",
    "MarkerFrame",
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
    "Patience",
    "Reach",
    "SelfModelMonitor",
    "SelfModelPredictor",
    "ServoDriver",
    "Sighting",
    "SimulatedArm",
    "SimulatedBody",
    "SimulatedEyes",
    "SimulatedMirrors",
    "StationBody",
    "StereoCameras",
    "World",
    "color_detector",
    "default_detectors",
    "fiducial_detector",
    "looking_arm",
    "world_named",
]


def __getattr__(name: str) -> Any:
    """Load the Drake systems when one of them is first asked for: they are slow to load."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from nico_selfmodel.systems import diagrams

    return getattr(diagrams, name)

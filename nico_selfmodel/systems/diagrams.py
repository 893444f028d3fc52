"""The rooms' Drake systems under one roof; `nico_selfmodel.systems` loads it when first asked."""

from nico_selfmodel.systems.hardware.camera_driver import CameraDriver
from nico_selfmodel.systems.hardware.motion_capture_link import (
    MotionCaptureReceiver,
    MotionCaptureSender,
)
from nico_selfmodel.systems.hardware.servo_driver import ServoDriver
from nico_selfmodel.systems.looking import looking_arm
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality, StereoCameras
from nico_selfmodel.systems.simulated.encoder_model import EncoderModel
from nico_selfmodel.systems.simulated.motion_capture import MotionCapture
from nico_selfmodel.systems.stations.nico_behind_bus import NicoBehindBus
from nico_selfmodel.systems.stations.nico_hardware_station import NicoHardwareStation
from nico_selfmodel.systems.stations.nico_station import BOARD, NicoStation, default_detectors
from nico_selfmodel.systems.stations.station_body import SettleTimeouts, StationBody
from nico_selfmodel.systems.tracking.hand_tracker import (
    HandTracker,
    color_detector,
    fiducial_detector,
)
from nico_selfmodel.systems.tracking.self_model_monitor import SelfModelMonitor
from nico_selfmodel.systems.tracking.self_model_predictor import SelfModelPredictor

__all__ = [
    "BOARD",
    "CameraDriver",
    "EncoderModel",
    "HandTracker",
    "ImageQuality",
    "MirrorPlate",
    "MotionCapture",
    "MotionCaptureReceiver",
    "MotionCaptureSender",
    "NicoBehindBus",
    "NicoHardwareStation",
    "NicoStation",
    "SelfModelMonitor",
    "SelfModelPredictor",
    "ServoDriver",
    "SettleTimeouts",
    "StationBody",
    "StereoCameras",
    "color_detector",
    "default_detectors",
    "fiducial_detector",
    "looking_arm",
]

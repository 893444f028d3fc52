"""The rooms' Drake systems under one roof; `nico_selfmodel.systems` loads it when first asked."""

from nico_selfmodel.systems.camera_driver import CameraDriver
from nico_selfmodel.systems.encoder_model import EncoderModel
from nico_selfmodel.systems.hand_tracker import (
    HandTracker,
    color_detector,
    fiducial_detector,
)
from nico_selfmodel.systems.looking import looking_arm
from nico_selfmodel.systems.mirror_scene import MirrorPlate
from nico_selfmodel.systems.motion_capture import MotionCapture
from nico_selfmodel.systems.motion_capture_link import (
    MotionCaptureReceiver,
    MotionCaptureSender,
)
from nico_selfmodel.systems.nico_behind_bus import NicoBehindBus
from nico_selfmodel.systems.nico_hardware_station import NicoHardwareStation
from nico_selfmodel.systems.nico_station import BOARD, NicoStation, default_detectors
from nico_selfmodel.systems.self_model_monitor import SelfModelMonitor
from nico_selfmodel.systems.self_model_predictor import SelfModelPredictor
from nico_selfmodel.systems.servo_driver import ServoDriver
from nico_selfmodel.systems.station_body import SettleTimeouts, StationBody
from nico_selfmodel.systems.stereo_cameras import ImageQuality, StereoCameras

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

"""The rooms' Drake systems under one roof; `nico_selfmodel.systems` loads it when first asked."""

from nico_selfmodel.systems.encoder_model import EncoderModel, Mechanics
from nico_selfmodel.systems.hand_tracker import (
    Detector,
    HandTracker,
    color_detector,
    fiducial_detector,
)
from nico_selfmodel.systems.looking import looking_arm
from nico_selfmodel.systems.mirror_predictor import MirrorPredictor
from nico_selfmodel.systems.motion_capture import MotionCapture
from nico_selfmodel.systems.motion_capture_link import (
    MotionCaptureReceiver,
    MotionCaptureSender,
)
from nico_selfmodel.systems.nico_station import BOARD, NicoStation, default_detectors
from nico_selfmodel.systems.reach import Reach
from nico_selfmodel.systems.self_model_monitor import SelfModelMonitor
from nico_selfmodel.systems.self_model_predictor import SelfModelPredictor
from nico_selfmodel.systems.station_body import StationBody
from nico_selfmodel.systems.stereo_cameras import ImageQuality, StereoCameras

__all__ = [
    "BOARD",
    "Detector",
    "EncoderModel",
    "HandTracker",
    "ImageQuality",
    "Mechanics",
    "MirrorPredictor",
    "MotionCapture",
    "MotionCaptureReceiver",
    "MotionCaptureSender",
    "NicoStation",
    "Reach",
    "SelfModelMonitor",
    "SelfModelPredictor",
    "StationBody",
    "StereoCameras",
    "color_detector",
    "default_detectors",
    "fiducial_detector",
    "looking_arm",
]

"""What a body knows of itself: chain, servo map, cameras, self-model. Plain numpy."""

from nico_selfmodel.model.camera import Camera
from nico_selfmodel.model.chain import Chain
from nico_selfmodel.model.dh_parameters import DhParameters
from nico_selfmodel.model.dh_table import DhTable
from nico_selfmodel.model.mirror import Mirror
from nico_selfmodel.model.mirror_rig import MirrorRig
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel
from nico_selfmodel.model.servo_map import ServoMap
from nico_selfmodel.model.stereo_rig import StereoRig

__all__ = [
    "Camera",
    "Chain",
    "DhParameters",
    "DhTable",
    "Mirror",
    "MirrorRig",
    "ParameterCovariance",
    "SelfModel",
    "ServoMap",
    "StereoRig",
]

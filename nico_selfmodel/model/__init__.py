"""What a body knows of itself: chain, servo map, eyes, self-model. Plain numpy."""

from nico_selfmodel.model.camera import Camera, Projection, Rays
from nico_selfmodel.model.chain import Chain
from nico_selfmodel.model.dh_parameters import DhParameters
from nico_selfmodel.model.dh_table import DhTable
from nico_selfmodel.model.mirror import Mirror, mirror_camera
from nico_selfmodel.model.mirror_location import MirrorLocation, locate_in_mirror
from nico_selfmodel.model.mirror_rig import MirrorRig
from nico_selfmodel.model.self_model import ParameterCovariance, Prediction, SelfModel
from nico_selfmodel.model.servo_map import ServoMap
from nico_selfmodel.model.stereo_rig import StereoRig, Triangulation

__all__ = [
    "Camera",
    "Chain",
    "DhParameters",
    "DhTable",
    "Mirror",
    "MirrorLocation",
    "MirrorRig",
    "ParameterCovariance",
    "Prediction",
    "Projection",
    "Rays",
    "SelfModel",
    "ServoMap",
    "StereoRig",
    "Triangulation",
    "locate_in_mirror",
    "mirror_camera",
]

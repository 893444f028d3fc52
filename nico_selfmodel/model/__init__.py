"""What a body knows of itself: chain, servo map, self-model. Plain numpy."""

from nico_selfmodel.model.chain import Chain
from nico_selfmodel.model.dh_parameters import DhParameters
from nico_selfmodel.model.dh_table import DhTable
from nico_selfmodel.model.self_model import ParameterCovariance, Prediction, SelfModel
from nico_selfmodel.model.servo_map import ServoMap

__all__ = [
    "Chain",
    "DhParameters",
    "DhTable",
    "ParameterCovariance",
    "Prediction",
    "SelfModel",
    "ServoMap",
]

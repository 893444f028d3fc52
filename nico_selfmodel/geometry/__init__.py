"""Circles, planes, lines, rigid transforms and alignment: numpy only, nothing of robots."""

from nico_selfmodel.geometry.alignment import Alignment
from nico_selfmodel.geometry.circle import Circle
from nico_selfmodel.geometry.circle_variants import circle_with_angles, robust_circle

__all__ = [
    "Alignment",
    "Circle",
    "circle_with_angles",
    "robust_circle",
]

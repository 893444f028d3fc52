"""Circles, planes, lines, rigid transforms and alignment: numpy only, nothing of robots."""

from nico_selfmodel.geometry.alignment import Alignment
from nico_selfmodel.geometry.circle import Circle
from nico_selfmodel.geometry.circle_variants import (
    circle_by_appendix_a,
    circle_with_angles,
    robust_circle,
)
from nico_selfmodel.geometry.line import Line, common_normal_feet
from nico_selfmodel.geometry.plane import Plane

__all__ = [
    "Alignment",
    "Circle",
    "Line",
    "Plane",
    "circle_by_appendix_a",
    "circle_with_angles",
    "common_normal_feet",
    "robust_circle",
]

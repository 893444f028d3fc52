"""Sensors that watch a simulated robot: what each says of markers whose true places are known."""

from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.systems.measurements import CameraMeasurement, Measurement
from nico_selfmodel.systems.simulated.cameras import inside_images
from nico_selfmodel.systems.simulated.instance import RobotInstance

_EDGE = 4.0
"""A marker this near to the image's edge is not found [px]."""


class Sensor(Protocol):
    """What watches a robot."""

    @property
    def sigma(self) -> float:
        """Noise of each coordinate that it measures [m or px]."""
        ...

    def measure(
        self,
        robot: RobotInstance,
        encoders: NDArray,
        p_BH: NDArray,
        rng: np.random.Generator,
    ) -> Measurement:
        """Say what is sensed at a pose.

        Args:
            robot: The robot, and where the sensor stands.
            encoders: Its readings. Shape (n,).
            p_BH: True places of its markers in the arm's base [m]. Shape (m, 3).
            rng: Source of noise.
        """
        ...


@dataclass(frozen=True)
class MotionCaptureSensor:
    """Measures markers in a frame of its own, with noise and drop-outs."""

    sigma: float
    """Noise of each measured coordinate [m]."""
    dropout_share: float = 0.0
    """Share of measurements in which a marker is lost."""

    def measure(
        self, robot: RobotInstance, encoders: NDArray, p_BH: NDArray, rng: np.random.Generator
    ) -> Measurement:
        """As `Sensor.measure`."""
        X_TB = robot.X_TB
        assert X_TB is not None
        points: dict[str, NDArray | None] = {}
        for marker, p in zip(robot.mechanics.markers, p_BH, strict=True):
            p_TH = X_TB[:3, :3] @ p + X_TB[:3, 3] + rng.normal(0.0, self.sigma, 3)
            points[marker] = None if rng.random() < self.dropout_share else p_TH
        return Measurement(encoders, MappingProxyType(points))


@dataclass(frozen=True)
class StereoPixels:
    """Finds markers in both images; nothing is rendered, true places are projected."""

    sigma: float
    """Noise of each pixel coordinate, independent in both cameras [px]."""

    def measure(
        self, robot: RobotInstance, encoders: NDArray, p_BH: NDArray, rng: np.random.Generator
    ) -> CameraMeasurement:
        """As `Sensor.measure`; nan where a marker lies outside an image."""
        assert robot.rig is not None
        assert robot.X_BL is not None
        pixels = robot.rig.project(apply(inverse(robot.X_BL), p_BH))
        noisy = pixels + rng.normal(0.0, self.sigma, pixels.shape)
        inside = inside_images(noisy, robot.rig.left.image_size, _EDGE)
        found = np.where(np.repeat(inside, 2, axis=1), noisy, np.nan)
        markers = robot.mechanics.markers
        return CameraMeasurement(
            encoders,
            MappingProxyType(dict.fromkeys(markers)),
            MappingProxyType(dict(zip(markers, found, strict=True))),
        )

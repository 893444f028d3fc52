"""Sensors that watch a simulated robot: what each says of markers whose true places are known."""

from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.systems.measurements import CameraMeasurement, Measurement
from nico_selfmodel.systems.simulated.cameras import inside_images
from nico_selfmodel.systems.simulated.curved_mirror import curved_reflection
from nico_selfmodel.systems.simulated.glass import Glass
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
        found = _pixels(robot, p_BH, self.sigma, rng)
        markers = robot.mechanics.markers
        return CameraMeasurement(
            encoders,
            MappingProxyType(dict.fromkeys(markers)),
            MappingProxyType(dict(zip(markers, found, strict=True))),
        )


@dataclass(frozen=True)
class StereoPixelsBeforeGlass:
    """Finds markers in both images, directly and in a glass; which way they face does not count."""

    sigma: float
    """Noise of each pixel coordinate, independent in both cameras [px]."""
    glass: Glass
    """Where it stands, in the base's frame; the base stands still."""
    radius: float | None = None
    """Of its curvature about its middle [m], positive bulging towards the cameras; None if it is
    flat."""

    def measure(
        self, robot: RobotInstance, encoders: NDArray, p_BH: NDArray, rng: np.random.Generator
    ) -> CameraMeasurement:
        """As `Sensor.measure`; nan where the glass hides a marker, or does not show it."""
        plane, markers = self.glass.plane, robot.mechanics.markers
        virtual, centres = reflect(plane, p_BH), _centres(robot)
        before = plane.distance_to(p_BH) > 0.0
        shown = [~self.glass.between(c, p_BH) for c in centres]
        mirrored = [self.glass.between(c, virtual) & before for c in centres]
        direct, reflected = (
            np.where(np.repeat(np.transpose(where), 2, axis=1), found, np.nan)
            for where, found in (
                (shown, _pixels(robot, p_BH, self.sigma, rng)),
                (mirrored, self._reflected(robot, p_BH, virtual, rng)),
            )
        )
        return CameraMeasurement(
            encoders,
            MappingProxyType(dict.fromkeys(markers)),
            MappingProxyType(dict(zip(markers, direct, strict=True))),
            reflected=MappingProxyType(dict(zip(markers, reflected, strict=True))),
        )

    def _reflected(
        self, robot: RobotInstance, p_BH: NDArray, virtual: NDArray, rng: np.random.Generator
    ) -> NDArray:
        """Return noisy pixels of reflections, nan out of an image. Shape (m, 4)."""
        if self.radius is None:
            return _pixels(robot, virtual, self.sigma, rng)
        assert robot.rig is not None
        assert robot.X_BL is not None
        # Before the middle of the glass, by 1 m: there the sphere touches its plane.
        normal = self.glass.plane.normal
        before = self.glass.X_WM[:3, 3] + normal
        X_GB = transform(np.eye(3), -before)
        shown = [
            curved_reflection(
                camera,
                Mirror(normal, 1.0),
                self.radius,
                p_BH - before,
                X_GB @ robot.X_BL @ camera.X_WC,
            )
            for camera in robot.rig.cameras
        ]
        return _noisy(robot, np.concatenate(shown, axis=1), self.sigma, rng)


def _pixels(robot: RobotInstance, p_BQ: NDArray, sigma: float, rng: np.random.Generator) -> NDArray:
    """Return noisy pixels of points, nan out of an image. Shape (m, 4)."""
    assert robot.rig is not None
    assert robot.X_BL is not None
    pixels = robot.rig.project(apply(inverse(robot.X_BL), p_BQ))
    return _noisy(robot, pixels, sigma, rng)


def _noisy(
    robot: RobotInstance, pixels: NDArray, sigma: float, rng: np.random.Generator
) -> NDArray:
    """Return pixels with noise, nan out of an image. Shape (m, 4)."""
    assert robot.rig is not None
    noisy = pixels + rng.normal(0.0, sigma, pixels.shape)
    inside = inside_images(noisy, robot.rig.left.image_size, _EDGE)
    return np.where(np.repeat(inside, 2, axis=1), noisy, np.nan)


def _centres(robot: RobotInstance) -> list[NDArray]:
    """Return where the cameras are in the base [m]. Shape (3,) each."""
    assert robot.rig is not None
    assert robot.X_BL is not None
    return [apply(robot.X_BL, camera.X_WC[:3, 3]) for camera in robot.rig.cameras]

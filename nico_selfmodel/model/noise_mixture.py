"""What a pose of the hand is uncertain by: a core and a tail of rarer, larger errors.

    f(r) = (1 - e) N(r; 0, S0) + e N(r; 0, S1),  Sk = ss_k^2 I + sq_k^2 A A'

with A the derivatives of all the pose's coordinates by the joint angles: joint noise is one draw
for every marker and every camera of a pose. One normal cannot hold both a robot's usual error and
its rare looseness: as wide as their mean it takes the loose poses for a change of the body.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

SENSORS = {"points": "sensor_sigma_m", "pixels": "sensor_sigma_px"}
"""What measures the hand -> how a file calls its core's sigma, which names the unit."""
LARGEST_SENSOR = {"points": 10.0, "pixels": 1e5}
"""Beyond these nothing is measured [m, px]."""
LARGEST_JOINT = float(np.pi)
"""An angle that errs by more is not known at all [rad]."""
LARGEST_SHARE = 0.5
"""A tail is the rarer part."""


@dataclass(frozen=True)
class NoiseMixture:
    """Core, tail and outliers, and on how many poses these numbers rest."""

    sensor_sigma: float
    """Core of each coordinate's own noise, ss_0 [m, or px for pixels]."""
    joint_sigma: float
    """Core of each joint angle's noise about its encoder, sq_0 [rad]."""
    tail_sensor_sigma: float
    """Tail of the coordinates' noise, ss_1 [m or px]."""
    tail_joint_sigma: float
    """Tail of the joint noise, sq_1 [rad]."""
    tail_share: float
    """Share e of the poses that are of the tail."""
    outlier_share: float
    """Share of the poses that are neither: false detections, larger than any noise."""
    poses: int
    """Poses of the training that told so."""

    def __post_init__(self) -> None:
        """Check that these are standard deviations of something that can be.

        Raises:
            ValueError: If a number is not finite, negative, implausible, or the tail is narrower
                than the core.
        """
        for name in ("sensor_sigma", "joint_sigma", "tail_sensor_sigma", "tail_joint_sigma"):
            largest = LARGEST_JOINT if "joint" in name else max(LARGEST_SENSOR.values())
            _check(name, getattr(self, name), largest)
        for name in ("tail_share", "outlier_share"):
            _check(name, getattr(self, name), LARGEST_SHARE)
        if self.sensor_sigma <= 0.0:
            raise ValueError(f"sensor_sigma must be positive, got {self.sensor_sigma}")
        if isinstance(self.poses, bool) or not isinstance(self.poses, int) or self.poses < 1:
            raise ValueError(f"poses must be a positive whole number, got {self.poses!r}")
        wider = self.tail_sensor_sigma >= self.sensor_sigma
        if not (wider and self.tail_joint_sigma >= self.joint_sigma):
            raise ValueError("the tail of the noise must not be narrower than its core")

    @property
    def rms_joint_sigma(self) -> float:
        """Root of the mean variance of a joint angle, core and tail together [rad]."""
        e = self.tail_share
        return float(np.hypot((1.0 - e) ** 0.5 * self.joint_sigma, e**0.5 * self.tail_joint_sigma))

    def as_document(self, sensor: str) -> dict[str, float | int]:
        """Return it as `fit.noise` of a self-model's file holds it, under the sensor's name."""
        name = SENSORS[sensor]
        return {
            name: self.sensor_sigma,
            "joint_sigma_rad": self.joint_sigma,
            f"tail_{name}": self.tail_sensor_sigma,
            "tail_joint_sigma_rad": self.tail_joint_sigma,
            "tail_share": self.tail_share,
            "outlier_share": self.outlier_share,
            "poses": self.poses,
        }

    @classmethod
    def from_document(cls, entry: Any, sensor: str) -> "NoiseMixture":
        """Read one.

        Raises:
            ValueError: If a number is missing, or is not plausible.
        """
        name = SENSORS[sensor]
        sigmas = (name, "joint_sigma_rad", f"tail_{name}", "tail_joint_sigma_rad")
        keys = (*sigmas, "tail_share", "outlier_share")
        missing = [key for key in (*keys, "poses") if key not in _mapping(entry, sensor)]
        if missing:
            raise ValueError(f"fit.noise.{sensor} lacks {', '.join(missing)}")
        for key in keys:
            _check(f"fit.noise.{sensor}.{key}", entry[key], _largest(key, sensor))
        try:
            sensor_sigma, joint, tail_sensor, tail_joint, tail, outlier = map(entry.get, keys)
            return cls(sensor_sigma, joint, tail_sensor, tail_joint, tail, outlier, entry["poses"])
        except ValueError as error:
            raise ValueError(f"fit.noise.{sensor}: {error}") from error


def mixtures_of(fit: Mapping[str, Any]) -> dict[str, NoiseMixture]:
    """Return what a self-model's `fit` says of noise, by sensor; empty for a model without.

    Raises:
        ValueError: If an entry is not valid.
    """
    noise = fit.get("noise")
    if noise is None:
        return {}
    strangers = sorted(set(map(str, _mapping(noise, ""))) - set(SENSORS))
    if strangers:
        raise ValueError(f"fit.noise is of {', '.join(SENSORS)}, got {', '.join(strangers)}")
    return {sensor: NoiseMixture.from_document(entry, sensor) for sensor, entry in noise.items()}


def _mapping(entry: Any, sensor: str) -> Mapping[str, Any]:
    if not isinstance(entry, Mapping):
        raise ValueError(f"fit.noise{'.' * bool(sensor)}{sensor} must be a mapping, got {entry!r}")
    return entry


def _largest(key: str, sensor: str) -> float:
    if key.endswith("share"):
        return LARGEST_SHARE
    return LARGEST_SENSOR[sensor] if "sensor" in key else LARGEST_JOINT


def _check(name: str, value: Any, largest: float) -> None:
    """Refuse what is no number from zero to a largest."""
    number = not isinstance(value, bool) and isinstance(value, (int, float))
    if not number or not 0.0 <= value <= largest:
        raise ValueError(f"{name} must be between 0 and {largest:g}, got {value!r}")

"""What may be commanded: the limits of the servo configuration, seen through the self-model."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.servos.arm.servo_config import LONGEST_STOP, ServoConfig


class PoseLimits:
    """Limits of joint displacements. The configuration limits encoder angles; a self-model maps."""

    def __init__(self, config: ServoConfig, servos: ServoMap) -> None:
        """Combine a configuration with a map of all its joints."""
        self.config, self.servos = config, servos
        self._readings = np.array([[j.lower_reading, j.upper_reading] for j in config.joints])
        # A stream of poses is checked one by one: the map is worked out once.
        self._at_zero = servos.to_encoder(np.zeros(len(config.joints)))
        self._slope = servos.gear / servos.radians_per_unit
        gear, joints = np.abs(servos.gear), config.joints
        self.positions: NDArray = np.sort(servos.to_joint(self._readings.T).T, axis=1)
        """Lowest and highest joint displacement [rad]. Shape (n, 2)."""
        self.speeds: NDArray = np.array([joint.max_velocity for joint in joints]) / gear
        """Largest joint speeds [rad/s]. Shape (n,)."""
        self.accelerations = np.array([joint.max_acceleration for joint in joints]) / gear
        """Largest joint accelerations [rad/s^2]. Shape (n,)."""
        self.counts_per_radian = np.array([joint.counts_per_radian for joint in joints]) * gear
        """Counts of a radian of each joint. Shape (n,)."""
        self._steps = np.array([(j.make.velocity_step, j.acceleration_step) for j in joints]).T

    def registers(self, q: NDArray, joints: Sequence[int]) -> list[int]:
        """Return the boards' counts at joint displacements.

        Args:
            q: Displacements of all joints [rad]. Shape (n,).
            joints: Which are meant.

        Returns:
            One for each of `joints`.

        Raises:
            ValueError: If one is not finite or beyond its limits.
        """
        readings = self._at_zero + self._slope * q
        registers = []
        for k in joints:
            joint = self.config.joints[k]
            if not math.isfinite(q[k]):
                raise ValueError(f"the target of {joint.name} must be a finite angle, got {q[k]}")
            # A limit given back by `positions` must be accepted: half a count either way.
            if not self._readings[k, 0] - 0.5 <= readings[k] <= self._readings[k, 1] + 0.5:
                low, high = np.degrees(self.positions[k])
                raise ValueError(
                    f"{joint.name} cannot go to {math.degrees(q[k]):.1f} deg: its limits are "
                    f"{low:.1f} to {high:.1f} deg; choose a target between them"
                )
            registers.append(joint.register(readings[k]))
        return registers

    def speed(self, asked: float | None) -> NDArray:
        """Return the speed of each joint when `asked` [rad/s], its limit if None. Shape (n,).

        Raises:
            ValueError: If it is not positive, too slow for a board or beyond every limit.
        """
        speeds = _within(asked, self.speeds, "speed", "rad/s")
        counts = np.maximum(1.0, self._steps[0])
        k = int((counts / self.counts_per_radian).argmax())
        slowest = float(counts[k] / self.counts_per_radian[k])
        if asked is not None and asked < slowest * (1.0 - 1e-9):
            what = "a count a second" if counts[k] == 1.0 else "the slowest of its motors"
            raise ValueError(f"speed must be at least {slowest:.3g} rad/s, {what}, got {asked:g}")
        return speeds

    def motor_speed(self, asked: float | None) -> NDArray:
        """Return the speed of each joint that its motor has [counts/s]. Shape (n,).

        Raises:
            ValueError: As `speed`.
        """
        return _down_to(self.speed(asked) * self.counts_per_radian, self._steps[0])

    def motor_braking(self, speed: float | None, asked: float | None = None) -> NDArray:
        """Return the acceleration of each joint that its motor has [counts/s^2]. Shape (n,).

        Raises:
            ValueError: As `braking`.
        """
        return self.braking(speed, asked) * self.counts_per_radian

    def acceleration(self, asked: float | None) -> NDArray:
        """Return the acceleration of each joint that its motor has when `asked`. Shape (n,).

        Raises:
            ValueError: If it is not positive or beyond every limit.
        """
        largest = _within(asked, self.accelerations, "acceleration", "rad/s^2")
        return _down_to(largest * self.counts_per_radian, self._steps[1]) / self.counts_per_radian

    def braking(self, speed: float | None, asked: float | None) -> NDArray:
        """Return accelerations from which the arm stops in time after the host went silent.

        Args:
            speed: Largest speed of the motion [rad/s]; the limits if None.
            asked: [rad/s^2]; the limits if None.

        Raises:
            ValueError: If what was asked for is beyond a limit, or too little.
        """
        v, a = self.speed(speed), self.acceleration(asked)
        if asked is not None and np.any(1.5 * v / a > LONGEST_STOP + 1e-9):
            raise ValueError(
                f"acceleration {asked:g} rad/s^2 is too little to stop in time from "
                f"{v.max():.3g} rad/s: give a lower speed or at least "
                f"{float((1.5 * v / LONGEST_STOP).max()):.3g} rad/s^2"
            )
        return a


def _down_to(values: NDArray, steps: NDArray) -> NDArray:
    """Return values rounded down to multiples of steps, at least one, where there is a step."""
    safe = np.where(steps > 0.0, steps, 1.0)
    stepped = safe * np.maximum(1.0, np.floor(values / safe + 1e-9))
    return np.where(steps > 0.0, stepped, values)


def _within(asked: float | None, largest: NDArray, what: str, unit: str) -> NDArray:
    if asked is None:
        return largest
    if not (math.isfinite(asked) and asked > 0.0):
        raise ValueError(f"{what} must be a positive number, got {asked}")
    if asked > largest.max() * (1.0 + 1e-9):
        raise ValueError(
            f"{what} must be at most {largest.max():.3g} {unit}, the limit of the servo "
            f"configuration, got {asked:g}"
        )
    return np.minimum(asked, largest)

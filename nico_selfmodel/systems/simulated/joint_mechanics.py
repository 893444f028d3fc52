"""Joints between encoder and link, whatever they carry: stops, backlash, sag, play and wobble."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.systems.simulated.imperfections import Imperfections

GRAVITY = np.array([0.0, 0.0, -1.0])
"""Which way it pulls."""


@dataclass(frozen=True, eq=False, kw_only=True)
class JointMechanics:
    """Joints as they are really built, and what is fixed to the links that they move."""

    servos: ServoMap
    """Their gears and encoder zeros."""
    lower: NDArray
    """Least readings between the stops [encoder units]. Shape (n,)."""
    upper: NDArray
    """Largest readings between the stops [encoder units]. Shape (n,)."""
    imperfections: Imperfections
    """What moves the joints away from where the encoders say they are."""
    largest_torque: float = 1.0
    """Torque that makes a joint sag by `Imperfections.sag`, as `torques` counts it."""

    @property
    def markers(self) -> tuple[str, ...]:
        """Names of the tracked points."""
        raise NotImplementedError

    @property
    def loose(self) -> Sequence[int]:
        """Joints that wobble: those of the shoulder."""
        raise NotImplementedError

    def points(self, q: NDArray) -> NDArray:
        """Return where the tracked points are in the base. Shapes (n,) -> (m, 3)."""
        raise NotImplementedError

    def torques(self, q: NDArray) -> NDArray:
        """Return torques of unit weights at joints and hands [m of unit weight]. Shape (n,)."""
        raise NotImplementedError

    def cameras(self, q: NDArray) -> tuple[NDArray, StereoRig] | None:
        """Return where the joints carry cameras.

        Args:
            q: Joint angles [rad]. Shape (n,).

        Returns:
            Pose of the left camera in the base, shape (4, 4), and both in its frame; None where no
            joint moves them.
        """
        return None

    @property
    def joints(self) -> tuple[JointInfo, ...]:
        """Names, units and stops of the joints, as a data set states them."""
        turn = self.imperfections.counts_per_turn
        return tuple(
            JointInfo(name, "counts", counts_per_turn=turn, lower=float(low), upper=float(high))
            for name, low, high in zip(self.servos.joints, self.lower, self.upper, strict=True)
        )

    def reached(self, command: ArrayLike) -> NDArray:
        """Return the readings at which a command ends: whole counts between the stops.

        Raises:
            ValueError: If the command has another length or is not finite.
        """
        command = np.asarray(command, dtype=float)
        if command.shape != (len(self.servos.joints),) or not np.isfinite(command).all():
            raise ValueError(f"command must be {len(self.servos.joints)} finite counts")
        return np.clip(np.round(command), self.lower, self.upper)

    def dragged(self, encoders: NDArray, q_before: NDArray | None = None) -> NDArray:
        """Return where drives take the joints: no further than to the other end of the backlash.

        Args:
            encoders: Readings [encoder units]. Shape (n,).
            q_before: Where it had them before; in the middle if omitted [rad]. Shape (n,).

        Returns:
            Joint angles [rad]. Shape (n,).
        """
        q, half = self.servos.to_joint(encoders), self.imperfections.backlash
        return q if q_before is None or not half else np.clip(q_before, q - half, q + half)

    def angles(self, q_dragged: NDArray, rng: np.random.Generator) -> NDArray:
        """Return where joints really stand: where drives take them, then sag, play and wobble.

        Args:
            q_dragged: `dragged` there [rad]. Shape (n,).

        Returns:
            Joint angles [rad]. Shape (n,).
        """
        q = q_dragged
        play = rng.uniform(-1.0, 1.0, len(q)) * self.imperfections.play
        wobble = np.zeros(len(q))
        if rng.random() < self.imperfections.wobble_share:
            loose = list(self.loose)
            wobble[loose] = rng.normal(0.0, self.imperfections.wobble, len(loose))
        return q + self._sag(q) + play + wobble

    def expected_angles(self, encoders: ArrayLike) -> NDArray:
        """Return where joints stand in the mean over what is left to chance: sag, but no play.

        Args:
            encoders: Readings [encoder units]. Shape (N, n).

        Returns:
            Joint angles [rad]. Shape (N, n).
        """
        q = self.servos.to_joint(np.atleast_2d(encoders))
        return np.array([row + self._sag(row) for row in q])

    def _sag(self, q: NDArray) -> NDArray:
        if not self.imperfections.sag:
            return np.zeros(len(q))
        return self.imperfections.sag * self.torques(q) / self.largest_torque


def built_servos(
    joints: tuple[str, ...], gear: NDArray, imperfections: Imperfections, rng: np.random.Generator
) -> ServoMap:
    """Return the gears and encoder zeros of one instance.

    Args:
        joints: Names. Length n.
        gear: Gears as designed. Shape (n,).
    """
    n = len(joints)
    return ServoMap(
        joints,
        offset=rng.uniform(-1.0, 1.0, n) * imperfections.encoder_zero,
        gear=gear * (1.0 + imperfections.gear_sigma * rng.normal(size=n)),
        unit=("counts",) * n,
        counts_per_turn=np.full(n, float(imperfections.counts_per_turn)),
        sign=np.ones(n),
    )


def built_stops(
    servos: ServoMap, lower: NDArray, upper: NDArray, spread: float, seed: int
) -> tuple[NDArray, NDArray]:
    """Return where the joints stop, in whole counts inside the limits described.

    Args:
        servos: The gears and encoder zeros.
        lower: Lower limits as described [rad]. Shape (n,).
        upper: Upper limits as described [rad]. Shape (n,).
        spread: How far inside them the stops may lie [rad].
        seed: Which robot; its stops come from this alone.

    Raises:
        ValueError: If a limit is missing or crossed, or a joint has no room to move.
    """
    if not (np.isfinite(lower) & np.isfinite(upper) & (lower < upper)).all():
        raise ValueError("a simulated arm needs finite lower < upper limits of every joint")
    inset = spread * np.random.default_rng((seed, 2)).uniform(0.0, 1.0, (2, len(lower)))
    # On the very limits they would tell gears and zeros to whoever has the description.
    angles = np.stack([lower + inset[0], upper - inset[1]])
    if not (angles[0] < angles[1]).all():
        raise ValueError("a joint's limits are closer together than its stops may lie inside them")
    stops = np.sort(servos.to_encoder(angles), axis=0)
    return np.ceil(stops[0]), np.floor(stops[1])

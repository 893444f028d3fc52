"""An arm as it was really built, and where its joints stand when the encoders say something."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.geometry.rotation import move_on_sphere, tangent_basis
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.systems.simulated.imperfections import Imperfections

if TYPE_CHECKING:
    # The plant is slow to load.
    from nico_selfmodel.plant import ArmDescription

_GRAVITY = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True, eq=False)
class Mechanics:
    """An arm as it is really built."""

    chain: Chain
    """Its axes and tracked points, z up, at its zero."""
    servos: ServoMap
    """Its gears and encoder zeros."""
    lower: NDArray
    """Least readings between the stops [encoder units]. Shape (n,)."""
    upper: NDArray
    """Largest readings between the stops [encoder units]. Shape (n,)."""
    imperfections: Imperfections
    """What moves its joints away from where the encoders say they are."""
    largest_torque: float = 1.0
    """Torque that makes a joint sag by `Imperfections.sag`, as `gravity_torques` counts it."""

    @classmethod
    def build(
        cls,
        arm: "ArmDescription",
        imperfections: Imperfections,
        seed: int,
        rng: np.random.Generator,
    ) -> "Mechanics":
        """Build one instance of an arm.

        Args:
            arm: The arm as described.
            imperfections: How far it may be from that.
            seed: Which one; its stops come from this alone.
            rng: Source of geometry, gears and encoder zeros.

        Raises:
            ValueError: If a limit is missing or crossed, or a joint has no room to move.
        """
        lower, upper = arm.lower, arm.upper
        if not (np.isfinite(lower) & np.isfinite(upper) & (lower < upper)).all():
            raise ValueError("a simulated arm needs finite lower < upper limits of every joint")
        chain = _built_chain(arm.chain, imperfections, rng)
        servos = _built_servos(arm.joints, imperfections, rng)
        inset = np.random.default_rng((seed, 2)).uniform(0.0, 1.0, (2, len(lower)))
        stops = _stops(servos, lower, upper, imperfections.stop_spread * inset)
        return cls(chain, servos, *stops, imperfections)

    def weighed(self, arm: "ArmDescription", rng: np.random.Generator) -> "Mechanics":
        """Return the arm with its largest gravity torque known, from a sample of poses.

        Args:
            arm: The arm as described, between whose limits they lie.
            rng: Source of the poses.
        """
        poses = rng.uniform(arm.lower, arm.upper, (50, len(arm.lower)))
        torque = max(float(np.abs(gravity_torques(self.chain, q)).max()) for q in poses)
        return replace(self, largest_torque=torque or 1.0)

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
            rng: Source of play and wobble.

        Returns:
            Joint angles [rad]. Shape (n,).
        """
        q = q_dragged
        play = rng.uniform(-1.0, 1.0, len(q)) * self.imperfections.play
        wobble = np.zeros(len(q))
        if rng.random() < self.imperfections.wobble_share:
            wobble[:2] = rng.normal(0.0, self.imperfections.wobble, min(2, len(q)))
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
        torque = gravity_torques(self.chain, q)
        return self.imperfections.sag * torque / self.largest_torque


def gravity_torques(chain: Chain, q: NDArray) -> NDArray:
    """Return torques of unit weights at the joints and the hand, tau_i = d_i . ((p - c_i) x g).

    Args:
        chain: The arm, z up.
        q: Joint angles [rad]. Shape (n,).

    Returns:
        Torques in metres of unit weight. Shape (n,).
    """
    at = chain.rezeroed(q)
    weights = np.vstack([at.points, at.p_WH_zero[:1]])
    torque = np.zeros(len(q))
    for i in range(len(q)):
        beyond = weights[i + 1 :] - at.points[i]
        torque[i] = np.sum(np.cross(beyond, _GRAVITY) @ at.directions[i])
    return torque


def _built_chain(nominal: Chain, imperfections: Imperfections, rng: np.random.Generator) -> Chain:
    """Return the axes and points of one instance."""
    n, m = len(nominal.joints), len(nominal.markers)
    tilt = rng.normal(0.0, 1.0, (n, 2)) * imperfections.axis_sigma
    shift = rng.normal(0.0, 1.0, (n, 2)) * imperfections.link_sigma
    directions = move_on_sphere(nominal.directions, tilt)[0]
    points = nominal.points + np.einsum("nij,nj->ni", tangent_basis(nominal.directions), shift)
    return Chain(
        nominal.joints,
        directions / np.linalg.norm(directions, axis=1, keepdims=True),
        points,
        nominal.markers,
        nominal.p_WH_zero + rng.normal(0.0, 1.0, (m, 3)) * imperfections.link_sigma,
    )


def _built_servos(
    joints: tuple[str, ...], imperfections: Imperfections, rng: np.random.Generator
) -> ServoMap:
    """Return the gears and encoder zeros of one instance."""
    n = len(joints)
    gear = np.ones(n)
    gear[-1] = imperfections.extra_gear
    return ServoMap(
        joints,
        offset=rng.uniform(-1.0, 1.0, n) * imperfections.encoder_zero,
        gear=gear * (1.0 + imperfections.gear_sigma * rng.normal(size=n)),
        unit=("counts",) * n,
        counts_per_turn=np.full(n, float(imperfections.counts_per_turn)),
        sign=np.ones(n),
    )


def _stops(
    servos: ServoMap, lower: NDArray, upper: NDArray, inset: NDArray
) -> tuple[NDArray, NDArray]:
    """Return where the joints stop, in whole counts inside the limits described."""
    # On the very limits they would tell gears and zeros to whoever has the description.
    angles = np.stack([lower + inset[0], upper - inset[1]])
    if not (angles[0] < angles[1]).all():
        raise ValueError("a joint's limits are closer together than its stops may lie inside them")
    stops = np.sort(servos.to_encoder(angles), axis=0)
    return np.ceil(stops[0]), np.floor(stops[1])

"""A simulated arm under motion capture, that keeps its true geometry to itself."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.dataset import JointInfo
from nico_selfmodel.geometry.rotation import move_on_sphere, rotation_from_vector, tangent_basis
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model import Chain, ServoMap
from nico_selfmodel.systems.worlds import Imperfections

_GRAVITY = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True, eq=False)
class Measurement:
    """What the body senses at one pose."""

    encoders: NDArray
    """Encoder readings [counts]. Shape (n,)."""
    points: Mapping[str, NDArray | None]
    """Measured position of each marker in the tracker's frame [m], None where it was lost."""


class SimulatedArm:
    """Encoders that can be commanded and a tracker that sees markers; nothing else shows.

    The true lines, gears and zeros, the tracker's place, and what play, sag and wobble do at a
    pose are private: a learner has only what a real robot would give it.
    """

    def __init__(
        self,
        nominal: Chain,
        lower: ArrayLike,
        upper: ArrayLike,
        world: Imperfections,
        seed: int,
        session: int = 0,
    ) -> None:
        """Build one individual of a robot.

        Args:
            nominal: The arm as described, in the base's frame (z up) and zero.
            lower: Lower joint stops [rad]. Shape (n,).
            upper: Upper joint stops [rad]. Shape (n,).
            world: What is wrong with body and tracker.
            seed: Of the individual: its geometry, gears and encoder zeros.
            session: Of the random things that happen to it: play, noise, lost markers.

        Raises:
            ValueError: If a stop is missing or crossed, or a joint has no room to move.
        """
        lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
        if not (np.isfinite(lower) & np.isfinite(upper) & (lower < upper)).all():
            raise ValueError("a simulated arm needs finite lower < upper limits of every joint")
        build = np.random.default_rng(seed)
        self._rng = np.random.default_rng((seed, session, 1))
        self.world = world
        self.__true_chain = _individual(nominal, world, build)
        self.__servos = _servos(nominal.joints, world, build)
        # A tracker's z points up, but for a few degrees; where it stands is anybody's choice.
        turn = build.uniform(-1.0, 1.0, 3) * [0.05, 0.05, 0.6]
        self.__to_tracker = transform(rotation_from_vector(turn), build.uniform(-0.5, 0.5, 3))
        self._stops = _stops(self.__servos, lower, upper, world, np.random.default_rng((seed, 2)))
        self.__largest_torque = _largest_torque(self.__true_chain, lower, upper, build)

    @property
    def joints(self) -> tuple[JointInfo, ...]:
        """Names, units and stops of the joints, as a data set states them."""
        return tuple(
            JointInfo(
                name,
                "counts",
                counts_per_turn=self.world.counts_per_turn,
                lower=float(low),
                upper=float(high),
            )
            for name, low, high in zip(self.__servos.joints, *self._stops, strict=True)
        )

    @property
    def markers(self) -> tuple[str, ...]:
        """Names of the markers that the tracker can see."""
        return self.__true_chain.markers

    def move_and_measure(self, command: ArrayLike) -> Measurement:
        """Move to encoder readings, settle, and look.

        Args:
            command: Where to go [counts]; kept between the stops. Shape (n,).

        Returns:
            What was sensed there.

        Raises:
            ValueError: If the command has another length or is not finite.
        """
        command = np.asarray(command, dtype=float)
        if command.shape != (len(self.__servos.joints),) or not np.isfinite(command).all():
            raise ValueError(f"command must be {len(self.__servos.joints)} finite counts")
        encoders = np.clip(np.round(command), *self._stops)
        q = self.__joint_angles(encoders)
        points: dict[str, NDArray | None] = {}
        for k, marker in enumerate(self.markers):
            p = self.__to_tracker[:3, :3] @ self.__true_chain.forward(q, k)
            p = p + self.__to_tracker[:3, 3] + self._rng.normal(0.0, self.world.marker_sigma, 3)
            lost = self._rng.random() < self.world.dropout_share
            points[marker] = None if lost else p
        return Measurement(encoders, MappingProxyType(points))

    def relive(self, command: ArrayLike) -> None:
        """Go through a visit again: play and noise are drawn one after the other."""
        self.move_and_measure(command)

    def __joint_angles(self, encoders: NDArray) -> NDArray:
        """Return true joint angles: encoder, then sag, play and wobble on the link's side."""
        return disturbed_angles(
            self.__true_chain,
            self.__servos.to_joint(encoders),
            self.world,
            self.__largest_torque,
            self._rng,
        )


def disturbed_angles(
    chain: Chain, q: NDArray, world: Imperfections, largest_torque: float, rng: np.random.Generator
) -> NDArray:
    """Return where joints really stand: what the encoders say, then sag, play and wobble.

    Args:
        chain: The arm, z up.
        q: Joint angles by the encoders [rad]. Shape (n,).
        world: What is wrong with the body.
        largest_torque: That makes a joint sag by `world.sag`, as `gravity_torques` counts it.
        rng: Source of play and wobble.

    Returns:
        Joint angles [rad]. Shape (n,).
    """
    torque = gravity_torques(chain, q) if world.sag else np.zeros(len(q))
    play = rng.uniform(-1.0, 1.0, len(q)) * world.play
    wobble = np.zeros(len(q))
    if rng.random() < world.wobble_share:
        wobble[:2] = rng.normal(0.0, world.wobble, min(2, len(q)))
    return q + world.sag * torque / largest_torque + play + wobble


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


def _individual(nominal: Chain, world: Imperfections, rng: np.random.Generator) -> Chain:
    """Return the arm as this individual was really built."""
    n, m = len(nominal.joints), len(nominal.markers)
    tilt = rng.normal(0.0, 1.0, (n, 2)) * world.axis_sigma
    shift = rng.normal(0.0, 1.0, (n, 2)) * world.link_sigma
    directions = move_on_sphere(nominal.directions, tilt)[0]
    points = nominal.points + np.einsum("nij,nj->ni", tangent_basis(nominal.directions), shift)
    return Chain(
        nominal.joints,
        directions / np.linalg.norm(directions, axis=1, keepdims=True),
        points,
        nominal.markers,
        nominal.p_WH_zero + rng.normal(0.0, 1.0, (m, 3)) * world.link_sigma,
    )


def _servos(joints: tuple[str, ...], world: Imperfections, rng: np.random.Generator) -> ServoMap:
    n = len(joints)
    gear = np.ones(n)
    gear[-1] = world.extra_gear
    return ServoMap(
        joints,
        offset=rng.uniform(-1.0, 1.0, n) * world.encoder_zero,
        gear=gear * (1.0 + world.gear_sigma * rng.normal(size=n)),
        unit=("counts",) * n,
        counts_per_turn=np.full(n, float(world.counts_per_turn)),
        sign=np.ones(n),
    )


def _stops(
    servos: ServoMap, lower: NDArray, upper: NDArray, world: Imperfections, rng: np.random.Generator
) -> tuple[NDArray, NDArray]:
    """Return where the joints stop, in whole counts inside the limits described."""
    # On the very limits they would tell gears and zeros to whoever has the description.
    inset = world.stop_spread * rng.uniform(0.0, 1.0, (2, len(lower)))
    angles = np.stack([lower + inset[0], upper - inset[1]])
    if not (angles[0] < angles[1]).all():
        raise ValueError("a joint's limits are closer together than its stops may lie inside them")
    stops = np.sort(servos.to_encoder(angles), axis=0)
    return np.ceil(stops[0]), np.floor(stops[1])


def _largest_torque(
    chain: Chain, lower: NDArray, upper: NDArray, rng: np.random.Generator
) -> float:
    """Return the largest gravity torque of any joint over its range, from a sample of poses."""
    poses = rng.uniform(lower, upper, (50, len(lower)))
    return max(float(np.abs(gravity_torques(chain, q)).max()) for q in poses) or 1.0

"""An arm as it was really built, and where its joints stand when the encoders say something."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import move_on_sphere, tangent_basis
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.systems.simulated.imperfections import Imperfections
from nico_selfmodel.systems.simulated.joint_mechanics import (
    GRAVITY,
    JointMechanics,
    built_servos,
    built_stops,
)

if TYPE_CHECKING:
    # The plant is slow to load.
    from nico_selfmodel.plant import ArmDescription


@dataclass(frozen=True, eq=False)
class Mechanics(JointMechanics):
    """An arm as it is really built."""

    chain: Chain
    """Its axes and tracked points, z up, at its zero."""

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
            seed: Which one; its stops come from this alone.
            rng: Source of geometry, gears and encoder zeros.

        Raises:
            ValueError: If a limit is missing or crossed, or a joint has no room to move.
        """
        chain = _built_chain(arm.chain, imperfections, rng)
        gear = np.ones(len(arm.joints))
        gear[-1] = imperfections.extra_gear
        servos = built_servos(arm.joints, gear, imperfections, rng)
        low, high = built_stops(servos, arm.lower, arm.upper, imperfections.stop_spread, seed)
        return cls(chain, servos=servos, lower=low, upper=high, imperfections=imperfections)

    def weighed(self, arm: "ArmDescription", rng: np.random.Generator) -> "Mechanics":
        """Return the arm with its largest gravity torque known, from a sample of poses.

        Args:
            arm: The arm as described, between whose limits they lie.
        """
        poses = rng.uniform(arm.lower, arm.upper, (50, len(arm.lower)))
        torque = max(float(np.abs(gravity_torques(self.chain, q)).max()) for q in poses)
        return replace(self, largest_torque=torque or 1.0)

    @property
    def markers(self) -> tuple[str, ...]:
        """Names of the tracked points."""
        return self.chain.markers

    @property
    def loose(self) -> Sequence[int]:
        """The first two joints."""
        return range(min(2, len(self.servos.joints)))

    def points(self, q: NDArray) -> NDArray:
        """As `JointMechanics.points`."""
        m = len(self.markers)
        return np.asarray(self.chain.forward(np.tile(q, (m, 1)), np.arange(m)))

    def torques(self, q: NDArray) -> NDArray:
        """As `JointMechanics.torques`."""
        return gravity_torques(self.chain, q)


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
        torque[i] = np.sum(np.cross(beyond, GRAVITY) @ at.directions[i])
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

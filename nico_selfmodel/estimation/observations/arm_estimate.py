"""An arm as an estimator holds it: lines at a reference reading, and gears."""

from dataclasses import dataclass

from numpy.typing import NDArray

from nico_selfmodel.model.arm.chain import Chain


@dataclass(frozen=True, eq=False)
class ArmEstimate:
    """A chain whose zero configuration is at given encoder angles, with gears.

    The encoder angles at zero are a choice, not an estimate: n lines, n gears and m points hold
    exactly 5n + 3m numbers that measurements determine.
    """

    chain: Chain
    """Lines and tracked points at q = 0."""
    gear: NDArray
    """Encoder radians per joint radian, positive. Shape (n,)."""
    zero: NDArray
    """Encoder angles at q = 0 [rad]. Shape (n,)."""

    def q_of(self, angles: NDArray) -> NDArray:
        """Return joint displacements [rad] at encoder angles. Shape (N, n) -> (N, n)."""
        return (angles - self.zero) / self.gear

    def predict(self, angles: NDArray, marker: NDArray) -> NDArray:
        """Predict tracked points [m]. Shapes (N, n), (N,) -> (N, 3)."""
        return self.chain.forward(self.q_of(angles), marker)

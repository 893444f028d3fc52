"""What an estimator hands to a `CalibrationProgram`: residuals with analytic derivatives."""

from abc import ABC, abstractmethod
from typing import Protocol

from numpy.typing import NDArray

from nico_selfmodel.least_squares import NormalEquations


class ResidualBlock(Protocol):
    """Residuals of N observations of k coordinates each, whitened to a sigma near one.

    Attributes:
        names: The decision variables it depends on, in the order of its argument. Length p.
    """

    names: tuple[str, ...]

    def evaluate(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return residuals and derivatives.

        Args:
            x: Values of `names`. Shape (p,).

        Returns:
            Residuals, shape (k, N), and derivatives, shape (p, k, N).
        """
        ...


class SummedBlock(ABC):
    """A residual block that adds itself up, where that is cheaper than its derivatives are.

    Attributes:
        names: As of a `ResidualBlock`, which it is as well.
    """

    names: tuple[str, ...]

    @abstractmethod
    def evaluate(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return residuals and derivatives, as a `ResidualBlock` does."""

    @abstractmethod
    def normal_equations(self, x: NDArray) -> NormalEquations:
        """Return cost, gradient, shape (p,), and Gauss-Newton matrix, shape (p, p), unweighted."""

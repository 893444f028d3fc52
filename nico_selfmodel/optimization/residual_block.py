"""What an estimator hands to a `CalibrationProgram`: residuals with analytic derivatives."""

from typing import Protocol

from numpy.typing import NDArray


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

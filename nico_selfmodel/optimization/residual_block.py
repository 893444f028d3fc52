"""What an estimator hands to a `CalibrationProgram`: residuals with analytic derivatives."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import wraps
from typing import Any, Protocol, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.least_squares import NormalEquations

Evaluate = TypeVar("Evaluate", bound=Callable[..., tuple[NDArray, ...]])


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


def remembers_last(evaluate: Evaluate) -> Evaluate:
    """Let a block keep what it found last, which nobody may write to then.

    A solver begins where another one ended, and scale and outliers are asked of there, too. A block
    that something changes must `forget_last`.
    """

    @wraps(evaluate)
    def evaluated(block: Any, x: NDArray) -> tuple[NDArray, ...]:
        own = vars(block)
        if "_last" not in own or not np.array_equal(own["_last"][0], x):
            found = evaluate(block, x)
            for array in found:
                array.flags.writeable = False
            own["_last"] = np.array(x), found
        last: tuple[NDArray, ...] = own["_last"][1]
        return last

    return cast(Evaluate, evaluated)


def forget_last(block: object) -> None:
    """Let a block work out anew what it is asked next: it is another one now."""
    vars(block).pop("_last", None)

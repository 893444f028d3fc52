"""What the ladder asks: a body at its rigid solution, be it an arm or a tree, by any sensors."""

from collections.abc import Collection, Iterable
from typing import Any, Protocol, Self

from numpy.typing import NDArray

from nico_selfmodel.model.arm.bending import Bending

GEAR = "gear"
"""Name of the step that frees gears which a unit tells."""


class Posture(Protocol):
    """A body's parameters."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of all of them, those of `bending` included."""
        ...

    @property
    def values(self) -> NDArray:
        """In the order of `names`."""
        ...

    @property
    def bending(self) -> Bending | None:
        """What bends."""
        ...

    @property
    def gears(self) -> NDArray:
        """Of all joints. Shape (n,)."""
        ...

    def with_values(self, values: NDArray) -> Self:
        """Return the same body with other values."""
        ...

    def with_bending(self, bending: Bending | None) -> Self:
        """Return the same body in which something else bends."""
        ...


class Weighed(Protocol):
    """Residuals (measured less predicted) and derivatives about a body, whitened by pose."""

    @property
    def noise(self) -> Any:
        """What disturbs the measurements."""
        ...

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the columns."""
        ...

    @property
    def U(self) -> NDArray:
        """Whitened derivatives, each pose counted once; priors of rigid parameters are rows.

        Columns beyond those of `free` are by errors of N(0, 1) that poses share.
        """
        ...

    @property
    def u(self) -> NDArray:
        """Whitened residuals."""
        ...

    @property
    def row(self) -> NDArray:
        """A row of the same visit that counts, of each whitened one; -1 of what is in no pose."""
        ...

    @property
    def pose(self) -> NDArray:
        """Pose of each row that counts. Shape (K,)."""
        ...

    @property
    def coordinates(self) -> float:
        """How many numbers count."""
        ...

    @property
    def log_determinant(self) -> float:
        """Logarithm of the determinant of their covariance."""
        ...

    def with_noise(self, noise: Any) -> Self:
        """Return the same with other noise."""
        ...

    def likeliest(self, pull: NDArray, variance: NDArray) -> Any:
        """Return the noise that residuals ask for, of effects that are known as well as that.

        Args:
            pull: How far the value without effect is from that of each column; 0 of what is rigid.
                Shape (k,).
            variance: How far from there each number is expected, squared: 0 of what is gone, inf of
                what is rigid. Shape (k,).
        """
        ...

    def errors(self, step: NDArray, rows: NDArray) -> NDArray:
        """Return errors of some rows that count, after a step of `free` [m or px].

        Args:
            step: Shape (k,).
            rows: Boolean, shape (K,).
        """
        ...


class Bendable(Protocol):
    """A body at its rigid solution, and what was measured of it."""

    @property
    def solution(self) -> Any:
        """The rigid one."""
        ...

    @property
    def posture(self) -> Posture:
        """Its parameters."""
        ...

    @property
    def noise(self) -> Any:
        """About it."""
        ...

    def quieter(self, noise: Any) -> Any | None:
        """Return it were joints that are read worse than others read like these; None of none."""
        ...

    @property
    def joints(self) -> tuple[str, ...]:
        """Names."""
        ...

    @property
    def free(self) -> Collection[str]:
        """Names of the rigid parameters that are estimated."""
        ...

    @property
    def known_gears(self) -> tuple[str, ...]:
        """Names of gears that a unit tells and nobody holds."""
        ...

    @property
    def sides(self) -> bool:
        """Whether some joint is known to have come from both sides."""
        ...

    @property
    def enough(self) -> bool:
        """Whether there are enough poses to ask."""
        ...

    @property
    def ups(self) -> tuple[tuple[NDArray, bool], ...]:
        """What may be the vertical in W, and whether its sense is certain."""
        ...

    @property
    def unit(self) -> str:
        """Unit of errors, `mm` or `px`."""
        ...

    def rods(self) -> tuple[NDArray, NDArray]:
        """Return loads and pivots of uniform rods."""
        ...

    def load_sigmas(self) -> NDArray:
        """Return how far each load may be from that, as standard deviations. Shape (n, 3)."""
        ...

    def names_of(self, bending: Bending, effect: str) -> tuple[str, ...]:
        """Return an effect's numbers that this body may have."""
        ...

    def weighed(self, posture: Any, free: tuple[str, ...], noise: Any) -> Weighed:
        """Linearise about a body."""
        ...

    def turns(self, posture: Any) -> NDArray:
        """Return how much joints turn beyond their displacements at all poses. Shape (N, n)."""
        ...

    def moments(self, posture: Any) -> NDArray:
        """Return `Bending.moments` at all poses. Shape (n, N, 3)."""
        ...

    def few(self) -> "Iterable[Bendable]":
        """Return what is asked: some poses, without what is an outlier whatever bends."""
        ...

    def bent(self, posture: Any, free: tuple[str, ...], priors: Any, noise: Any) -> Any:
        """Return the solution of all observations with what stayed, outliers looked for anew."""
        ...

    def log_errors(self, posture: Any) -> NDArray:
        """Return log(error) of each pose, outliers included. Shape (P,)."""
        ...

    def ended(self, solution: Any) -> bool:
        """Return whether the search for a solution came to its end."""
        ...

    def posture_of(self, solution: Any) -> Posture:
        """Return the parameters of a solution."""
        ...

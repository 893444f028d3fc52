"""Cross-validation: each observation predicted by what was learned without its fold."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Learned = TypeVar("Learned")

FOLDS = 5
_TOLD = 1e-11
"""Information without a fold, of the largest, below which nothing is told."""


def fold_of(groups: NDArray, folds: int = FOLDS) -> NDArray:
    """Deal whole groups (poses, boards) out to folds, in turn.

    Args:
        groups: Number of each row's group. Shape (N,).
        folds: How many; fewer where there are fewer groups.

    Returns:
        Fold of each row, from 0. Shape (N,).
    """
    of = np.unique(groups, return_inverse=True)[1].reshape(len(groups))
    return of % min(folds, int(of.max(initial=0)) + 1)


@dataclass(frozen=True, eq=False)
class Fold:
    """Observations that are left out together."""

    number: int
    """From 0."""
    left: NDArray
    """Rows that are left out. Boolean, shape (N,)."""

    @property
    def rest(self) -> NDArray:
        """Rows to learn from. Boolean, shape (N,)."""
        return ~self.left


def splits(fold: NDArray) -> tuple[Fold, ...]:
    """Return the folds of rows, by number; rows of none (-1) are always learned from. (N,)."""
    return tuple(Fold(k, fold == k) for k in range(int(fold.max(initial=-1)) + 1))


def by_fold(
    fold: NDArray,
    learn: Callable[[Fold], Learned],
    predict: Callable[[Learned, Fold], NDArray],
) -> Iterator[tuple[Fold, NDArray]]:
    """Yield each fold beside what is predicted of it by what was learned without it.

    Args:
        fold: Of each row, as from `fold_of`. Shape (N,).
        learn: Return what the rows tell that are not left out.
        predict: Return what that says of the rows that are.
    """
    for part in splits(fold):
        yield part, predict(learn(part), part)


def cross_validate(
    fold: NDArray,
    learn: Callable[[Fold], Learned],
    predict: Callable[[Learned, Fold], NDArray],
) -> NDArray:
    """Predict each row by what was learned without its fold: `by_fold`, row by row.

    Returns:
        The predictions, nan for rows of no fold. Shape (N, ...); (N,) without folds.
    """
    out: NDArray | None = None
    for part, own in by_fold(fold, learn, predict):
        if out is None:
            out = np.full((len(fold), *own.shape[1:]), np.nan)
        out[part.left] = own
    return np.full(len(fold), np.nan) if out is None else out


def told_step(H: NDArray, g: NDArray, unit: NDArray) -> tuple[NDArray, NDArray]:
    """Return the Gauss-Newton step without a fold, and the directions that are then not told.

    With H / (u u') = V diag(h) V', dx = -V h^-1 V' g over the directions whose h is not nothing.

    Args:
        H: Normal matrix of what is not left out. Shape (p, p).
        g: Gradient of the same. Shape (p,).
        unit: By which parameters compare, u: roots of the diagonal of the whole H. Shape (p,).

    Returns:
        The step, shape (p,), and the directions, as columns of shape (p, e).
    """
    unit = np.where(unit > 0.0, unit, 1.0)
    known, vectors = np.linalg.eigh(H / np.outer(unit, unit))
    told = known > _TOLD * known[-1]
    step = -(vectors[:, told] / known[told]) @ (vectors[:, told].T @ (g / unit))
    return step / unit, vectors[:, ~told] / unit[:, None]

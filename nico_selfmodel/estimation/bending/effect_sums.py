"""Normal equations of a rigid body and its effects, fold by fold."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.bending.bendable import Weighed
from nico_selfmodel.estimation.results.folds import fold_of

_LEAST = 1e-12
_UNTOLD = 1e-11
"""Information of a rigid direction, of the largest, below which nothing tells it."""


@dataclass(frozen=True, eq=False)
class Sums:
    """Normal equations of some columns."""

    H: NDArray
    """U'U. Shape (k, k)."""
    g: NDArray
    """U'u. Shape (k,)."""
    squares: float
    """u'u."""
    count: int
    """Rows of U."""
    folds: tuple["tuple[NDArray, NDArray, int]", ...]
    """The same of each fold of poses: parts of H, g and count."""

    @classmethod
    def of(cls, weighed: Weighed) -> "Sums":
        """Add up, fold by fold."""
        U, u, fold = weighed.U, weighed.u, fold_of(weighed.pose)
        of_coordinate = np.where(weighed.row < 0, -1, fold[weighed.row])
        folds = []
        for k in range(int(fold.max(initial=-1)) + 1):
            own, missed = U[of_coordinate == k], u[of_coordinate == k]
            folds.append((own.T @ own, own.T @ missed, len(missed)))
        rest, beside = U[of_coordinate < 0], u[of_coordinate < 0]
        H = sum((part[0] for part in folds), rest.T @ rest)
        g = sum((part[1] for part in folds), rest.T @ beside)
        return cls(H, g, float(u @ u), len(u), tuple(folds))

    def part(self, columns: Sequence[int]) -> "Sums":
        """Return those of some columns."""
        own = np.ix_(columns, columns)
        chosen = list(columns)
        folds = tuple((H[own], g[chosen], count) for H, g, count in self.folds)
        return Sums(self.H[own], self.g[chosen], self.squares, self.count, folds)

    def without(self, k: int) -> "Sums":
        """Return those of the other rows."""
        H, g, count = self.folds[k]
        return Sums(self.H - H, self.g - g, np.nan, self.count - count, ())

    def missed(self, step: NDArray) -> float:
        """Return the sum of squares |u - U step|^2."""
        return float(self.squares - 2.0 * (step @ self.g) + step @ self.H @ step)

    def reduced(self, member: Mapping[str, NDArray], share: NDArray) -> "Reduced":
        """Return those of the effects alone."""
        return Reduced.of(self.H, self.g, member, share)

    def hidden(self, own: NDArray) -> float:
        """Return the variance at which an effect would be as large as the noise, 0 if none."""
        told = float(np.trace(self.H[np.ix_(own, own)]))
        return self.count / told if told > _LEAST * self.count else 0.0


@dataclass(frozen=True, eq=False)
class Reduced:
    """Normal equations of the effects alone, what the rigid parameters would do taken out."""

    rigid: NDArray
    """Columns of the rigid parameters. Shape (r,)."""
    effects: NDArray
    """Columns of the effects. Shape (e,)."""
    member: Mapping[str, NDArray]
    """Where each effect's numbers are among those of the effects."""
    share: NDArray
    """Prior variance of each number, as a multiple of its effect's. Shape (e,)."""
    S: NDArray
    """H_ee - H_er H_rr^-1 H_re. Shape (e, e)."""
    s: NDArray
    """g_e - H_er H_rr^-1 g_r. Shape (e,)."""
    gain: NDArray
    """H_rr^-1 H_re. Shape (r, e)."""
    alone: NDArray
    """H_rr^-1 g_r. Shape (r,)."""

    @classmethod
    def of(cls, H: NDArray, g: NDArray, member: Mapping[str, NDArray], share: NDArray) -> "Reduced":
        """Take out what the rigid parameters would do."""
        effects = np.concatenate([np.zeros(0, dtype=int), *member.values()])
        rigid = np.delete(np.arange(len(g)), effects)
        A = H[np.ix_(rigid, rigid)]
        told = np.diag(A) > 0.0
        # What nothing tells stays where it is: in units of almost nothing it would go anywhere.
        size = np.sqrt(np.where(told, np.diag(A), 1.0))
        known, vectors = np.linalg.eigh(A / np.outer(size, size))
        kept = np.abs(known) > _UNTOLD * np.abs(known).max(initial=0.0)
        vectors = vectors[:, kept] / size[:, None]
        inverse = vectors / known[kept] @ vectors.T
        across = H[np.ix_(rigid, effects)]
        gain, alone = inverse @ across, inverse @ g[rigid]
        ends = np.cumsum([0, *(len(own) for own in member.values())])
        places = {e: np.arange(a, b) for e, a, b in zip(member, ends[:-1], ends[1:], strict=True)}
        S, s = H[np.ix_(effects, effects)] - across.T @ gain, g[effects] - across.T @ alone
        return cls(rigid, effects, places, share[effects], S, s, gain, alone)

    def solve(self, start: NDArray, variance: Mapping[str, float]) -> tuple[NDArray, NDArray]:
        """Return covariance and step of the effects; those that are gone go back to nothing.

        Args:
            start: What each column's number is now, above no effect. Shape (r + e,).
            variance: Of each effect's numbers; 0 where it is gone.
        """
        now = start[self.effects]
        v = np.concatenate([variance[e] * self.share[p] for e, p in self.member.items()] or [now])
        there = v > 0.0
        if there.all():
            C = _posterior(self.S, v)
            return C, C @ (self.s - now / v)
        step, C = np.where(there, 0.0, -now), np.zeros_like(self.S)
        if there.any():
            own = _posterior(self.S[np.ix_(there, there)], v[there])
            right = (self.s - self.S @ step)[there] - now[there] / v[there]
            C[np.ix_(there, there)], step[there] = own, own @ right
        return C, step

    def whole(self, step: NDArray) -> NDArray:
        """Return the step of all columns from that of the effects. Shape (r + e,)."""
        out = np.zeros(len(self.rigid) + len(self.effects))
        out[self.effects], out[self.rigid] = step, self.alone - self.gain @ step
        return out


def _posterior(S: NDArray, v: NDArray) -> NDArray:
    """Return (S + V^-1)^-1, well posed however little is told. Shapes (e, e) and (e,)."""
    root = np.sqrt(v)
    units = root[:, None] * root
    inside = S * units
    inside.flat[:: len(v) + 1] += 1.0
    return np.linalg.inv(inside) * units

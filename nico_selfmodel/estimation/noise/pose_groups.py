"""Which rows belong to one visit of a pose, laid out so that visits are worked on many at once.

A visit has one draw of joint noise, so all its coordinates are whitened together. They stand one
after the other, visit by visit, visits of about as many rows in one bucket: little is padded, and
each bucket is one stack of small matrices.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_ALIKE = 1.5
"""Ratio of the most to the fewest rows of visits that share a bucket."""


@dataclass(frozen=True, eq=False)
class Bucket:
    """Visits of about as many rows."""

    visits: NDArray
    """Their numbers among those that count. Shape (V,)."""
    coordinates: int
    """Of each visit, padded, K."""
    place: slice
    """Where their coordinates stand among all."""

    def stacked(self, flat: NDArray) -> NDArray:
        """Return the bucket's part of coordinates. Shape (T, ...) -> (V, K, ...)."""
        return flat[self.place].reshape(len(self.visits), self.coordinates, *flat.shape[1:])


class PoseGroups:
    """Rows <-> coordinates by visit.

    A visit has one draw of joint noise. Visits of one pose share besides what only that pose has
    (play, bending), so that all of them together count as one: `weight`.
    """

    def __init__(
        self, visit: NDArray, keep: NDArray, coordinates: int, pose: NDArray | None = None
    ) -> None:
        """Group rows.

        Args:
            visit: Number of each row's visit. Shape (N,).
            keep: Rows that count. Boolean, shape (N,).
            coordinates: How many coordinates a row has, k.
            pose: Number of each row's pose; every visit a pose of its own if omitted. Shape (N,).
        """
        self.rows, self.k = np.flatnonzero(keep), coordinates
        self.numbers, lead, of = np.unique(visit[self.rows], return_index=True, return_inverse=True)
        """Number of each visit that counts, ascending. Shape (visits,)."""
        self._all = visit
        self.place = np.arange(len(lead)) if pose is None else pose[self.rows][lead]
        """Number of each visit's pose. Shape (visits,)."""
        _, same, visits = np.unique(self.place, return_inverse=True, return_counts=True)
        self.weight = 1.0 / visits[same]
        """What each visit counts. Shape (visits,)."""
        self.alike = bool((self.weight == 1.0).all())
        """Whether each visit is a pose of its own."""
        self.pose = of
        """Index among the visits that count, of each row that counts. Shape (K,)."""
        self.poses, self.count = len(lead), len(visit)
        self._lay_out(np.bincount(of, minlength=len(lead)))

    def _lay_out(self, counts: NDArray) -> None:
        """Deal the visits out to buckets, and their rows to places."""
        order = np.argsort(self.pose, kind="stable")
        first = np.cumsum(counts) - counts
        buckets, rows, ends = [], [], 0
        for visits, most in _alike(counts):
            slot = np.arange(most)
            at = np.minimum(first[visits][:, None] + slot, len(order) - 1)
            rows.append(np.where(slot < counts[visits][:, None], order[at], -1).ravel())
            size = len(visits) * most * self.k
            buckets.append(Bucket(visits, most * self.k, slice(ends, ends + size)))
            ends += size
        self.buckets: tuple[Bucket, ...] = tuple(buckets)
        place = np.concatenate([np.zeros(0, dtype=int), *rows])
        """Index among the rows that count of each row's place, -1 where it is empty."""
        self._filled = np.flatnonzero(place >= 0)
        self._row = self.rows[place] if len(self.rows) else place
        self._all_filled = len(self._filled) == len(place)
        in_order = self._all_filled and len(place) == self.count
        self._as_they_are = in_order and bool((self._row == np.arange(self.count)).all())
        self.visit = np.concatenate(
            [np.zeros(0, dtype=int), *(np.repeat(b.visits, b.coordinates) for b in buckets)]
        )
        """Index among the visits that count, of each coordinate. Shape (T,)."""

    def of(self, rows: NDArray) -> NDArray:
        """Return the index of the pose of any rows; the number of poses where none counts.

        Args:
            rows: Boolean, shape (N,).
        """
        wanted = self._all[rows]
        at = np.minimum(np.searchsorted(self.numbers, wanted), len(self.numbers) - 1)
        return np.where(self.numbers[at] == wanted, at, len(self.numbers))

    def gather(self, values: NDArray) -> NDArray:
        """Return values by visit. Shape (N, k, ...) -> (T, ...), zero where nothing stands."""
        rest = values.shape[2:]
        if self._as_they_are:
            return np.ascontiguousarray(values).reshape(-1, *rest)
        if self._all_filled:
            return values.take(self._row, axis=0).reshape(-1, *rest)
        out = np.zeros((len(self._row), *values.shape[1:]), dtype=values.dtype)
        out[self._filled] = values.take(self._row[self._filled], axis=0)
        return out.reshape(-1, *rest)

    def scatter(self, flat: NDArray) -> NDArray:
        """Return values by row. Shape (T, ...) -> (N, k, ...), zero for rows left out."""
        parts = flat.reshape(-1, self.k, *flat.shape[1:])
        if self._as_they_are:
            return parts
        out = np.zeros((self.count, *parts.shape[1:]))
        out[self._row[self._filled]] = parts[self._filled]
        return out

    def stacks(self, *flat: NDArray) -> Iterator[tuple[Bucket, tuple[NDArray, ...]]]:
        """Yield each bucket with its parts of some values. Shape (T, ...) -> (V, K, ...)."""
        for bucket in self.buckets:
            yield bucket, tuple(bucket.stacked(one) for one in flat)

    def products(self, one: NDArray, other: NDArray) -> NDArray:
        """Return A'B of each visit's coordinates. Shapes (T, a), (T, b) -> (visits, a, b)."""
        out = np.zeros((self.poses, one.shape[1], other.shape[1]))
        for bucket, (A, B) in self.stacks(one, other):
            across = np.swapaxes(A, 1, 2)
            if len(self.buckets) == 1:  # of all visits, in order
                return across @ B
            out[bucket.visits] = across @ B
        return out


def _alike(counts: NDArray) -> Iterator[tuple[NDArray, int]]:
    """Yield visits of about as many rows, and the most that one of them has."""
    left = np.arange(len(counts))
    while len(left):
        most = int(counts[left].max())
        near = _ALIKE * counts[left] > most
        yield left[near], most
        left = left[~near]

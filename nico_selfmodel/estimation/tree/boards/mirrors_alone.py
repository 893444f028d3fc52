"""Mirrors and boards from boards that were seen in mirrors alone.

A board at (R, T) is seen in mirror a, n_a.x + d_a = 0, S_a = I - 2 n_a n_a', as one at R'_a = S_a R
diag(1, 1, -1), t'_a = S_a T - 2 d_a n_a. With the normals known, R is the polar part of the sum of
S_a R'_a diag(1, 1, -1), and T and d are linear: T + 2 d_a n_a = S_a t'_a. Two mirrors turn a board
by R'_a R'_b' = S_a S_b, about n_a x n_b by twice the angle between them, so that every normal is at
right angles to its axes with two others (Rodrigues, Barreto, Nunes 2010). Where three normals
nearly lie in one plane that leaves them nearly open, and turns about the common axis are tried.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import NotIdentifiableError
from nico_selfmodel.estimation.tree.boards.board_pose import mirrored_back
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.rotation import (
    move_on_sphere,
    nearest_rotation,
    rotation_vectors_of,
    tangent_basis,
)
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.least_squares import NormalEquations, levenberg_marquardt
from nico_selfmodel.names import listed

_FLAT = 2e-3
"""Largest |det| of three normals below which they lie in one plane, and leave the mirrors open."""
_APART = 1e-3
"""Least spread of a mirror's axes with the others, smaller singular value to the larger."""
_TURN_SIGMA, _PLACE_SIGMA = 0.01, 5e-3
"""What the pose of a single view is about known to [rad, m]."""
_TURNS, _TRIED = 36, 4
"""Turns about the common axis, and how many of the best starts are followed."""
_MOST_BOARDS = 8
"""Boards that a start looks at."""
_FEWEST_BOARDS, _BETTER = 3, 4.0
"""Boards that are kept at least, and times less that is left without a board that contradicts them:
its rows may name another mirror."""


def mirrors_alone(
    virtual: Mapping[str, Mapping[int, NDArray]],
) -> tuple[dict[str, Plane], dict[int, NDArray]]:
    """Place mirrors and the boards that were seen in them.

    Args:
        virtual: By mirror and number of the board, where its mirror image is, (4, 4) each.

    Returns:
        The glasses, n either way, and the boards' poses, (4, 4) each.

    Raises:
        NotIdentifiableError: If there are no three mirrors whose normals point three ways.
    """
    views, aside = _Views.of(virtual), set[int]()
    best, least = views.solved()
    while least > 1.0 and len(views.boards) > _FEWEST_BOARDS:
        others = [(*views.without(board).solved(), board) for board in views.boards]
        normals, misfit, board = min(others, key=lambda one: one[1])
        if misfit * _BETTER > least:
            break
        best, least, views = normals, misfit, views.without(board)
        aside.add(board)
    triples = combinations(range(len(best)), 3)
    if max((abs(np.linalg.det(best[list(t)])) for t in triples), default=0.0) < _FLAT:
        raise NotIdentifiableError(
            f"boards were seen in {listed(views.names)}, never beside them: three mirrors or more "
            "must show the same boards, and their normals must not lie in one plane; turn one of "
            "them, or show the board directly, too"
        )
    every = _Views.of(virtual, None)
    for board in aside:
        every = every.without(board)
    return every.placed(best)


@dataclass(frozen=True, eq=False)
class _Views:
    """Single views of mirror images, V of them."""

    names: tuple[str, ...]
    """The mirrors."""
    mirror: NDArray
    """Of each view. Shape (V,)."""
    board: NDArray
    """Of each view, as an index into `boards`. Shape (V,)."""
    boards: tuple[int, ...]
    X: NDArray
    """Where the image is. Shape (V, 4, 4)."""

    @classmethod
    def of(
        cls, virtual: Mapping[str, Mapping[int, NDArray]], most: int | None = _MOST_BOARDS
    ) -> "_Views":
        """Take the boards that most mirrors show."""
        counts: dict[int, int] = {}
        for images in virtual.values():
            for board in images:
                counts[board] = counts.get(board, 0) + 1
        chosen = sorted(counts, key=lambda board: (-counts[board], board))[:most]
        rows = [
            (m, chosen.index(board), X)
            for m, images in enumerate(virtual.values())
            for board, X in images.items()
            if board in chosen
        ]
        mirror, board, X = zip(*rows, strict=True)
        return cls(tuple(virtual), np.array(mirror), np.array(board), tuple(chosen), np.stack(X))

    def without(self, board: int) -> "_Views":
        """Return the views of all boards but one, which is no index into `boards`."""
        k = self.boards.index(board)
        kept = self.board != k
        number = self.board[kept] - (self.board[kept] > k)
        boards = (*self.boards[:k], *self.boards[k + 1 :])
        return _Views(self.names, self.mirror[kept], number, boards, self.X[kept])

    def solved(self) -> tuple[NDArray, float]:
        """Return the normals that fit best, (M, 3), and their mean square, in about its sigma."""
        best, least = np.zeros((len(self.names), 3)), np.inf
        starts = sorted(self.starts(), key=self.misfit) if len(self.names) > 2 else []
        for normals in starts[:_TRIED]:
            normals = self.refined(normals)
            misfit = self.misfit(normals) / max(len(self.X), 1)
            if misfit < least:
                best, least = normals, misfit
        return best, least

    def starts(self) -> Iterator[NDArray]:
        """Yield normals to begin with. Shape (M, 3)."""
        turns = {pair: turn for pair in combinations(range(len(self.names)), 2)
                 if (turn := self._turn(*pair)) is not None}  # fmt: skip
        normals = [
            self._normal([t for p, t in turns.items() if m in p]) for m in range(len(self.names))
        ]
        if all(n is not None for n in normals):
            yield np.stack([n for n in normals if n is not None])
        if not turns:
            return
        axes = np.stack(list(turns.values()))
        common = np.linalg.svd(axes)[2][0]
        # n_m is n_0 turned about the common axis by half of what the two turn a board.
        zero = np.zeros(3)
        turn = np.stack([turns.get((0, m), zero) for m in range(len(self.names))])
        angle = -0.5 * turn @ common
        e = tangent_basis(common)
        for first in np.pi / _TURNS * np.arange(_TURNS):
            for way in (angle, -angle):
                at = first + way
                yield np.cos(at)[:, None] * e[:, 0] + np.sin(at)[:, None] * e[:, 1]

    def _turn(self, a: int, b: int) -> NDArray | None:
        """Return the rotation vector of R'_a R'_b', the mean over boards that both show. (3,)."""
        one, other = (
            dict(zip(self.board[self.mirror == m].tolist(), self.X[self.mirror == m], strict=True))
            for m in (a, b)
        )
        both = set(one) & set(other)
        if not both:
            return None
        return np.asarray(
            rotation_vectors_of(
                nearest_rotation(sum(one[k][:3, :3] @ other[k][:3, :3].T for k in both))
            )
        )

    @staticmethod
    def _normal(axes: list[NDArray]) -> NDArray | None:
        """Return what is at right angles to all axes; None where they are one. Shape (3,)."""
        if len(axes) < 2:
            return None
        unit = np.array([axis / max(float(np.linalg.norm(axis)), 1e-12) for axis in axes])
        _, size, vt = np.linalg.svd(unit)
        return None if size[1] < _APART * size[0] else np.asarray(vt[-1])

    @cached_property
    def _turned(self) -> NDArray:
        return mirrored_back(self.X)[:, :3, :3]

    def residuals(self, normals: NDArray) -> NDArray:
        """Return what normals leave of turns and places, in about their sigmas. Shape (12 V,)."""
        across = np.eye(3) - 2.0 * normals[:, :, None] * normals[:, None, :]
        turned = across[self.mirror] @ self._turned
        sums = np.zeros((len(self.boards), 3, 3))
        np.add.at(sums, self.board, turned)
        off = turned - nearest_rotation(sums)[self.board]
        A, b = self._linear(normals, across)
        left = A @ np.linalg.lstsq(A, b, rcond=None)[0] - b
        return np.append(off.ravel() / (np.sqrt(2.0) * _TURN_SIGMA), left / _PLACE_SIGMA)

    def _linear(self, normals: NDArray, across: NDArray) -> tuple[NDArray, NDArray]:
        """Return the equations of boards' places and mirrors' distances."""
        views, boards = len(self.X), len(self.boards)
        A = np.zeros((views, 3, 3 * boards + len(normals)))
        for axis in range(3):
            A[np.arange(views), axis, 3 * self.board + axis] = 1.0
        A[np.arange(views), :, 3 * boards + self.mirror] = 2.0 * normals[self.mirror]
        b = (across[self.mirror] @ self.X[:, :3, 3, None])[:, :, 0]
        return A.reshape(3 * views, -1), b.ravel()

    def misfit(self, normals: NDArray) -> float:
        """Return the sum of squares of `residuals`."""
        r = self.residuals(normals)
        return float(r @ r)

    def refined(self, normals: NDArray) -> NDArray:
        """Return normals at the nearest minimum of the misfit. Shape (M, 3)."""

        def at(x: NDArray) -> NDArray:
            steps = x.reshape(-1, 2)
            return np.stack([move_on_sphere(n, s)[0] for n, s in zip(normals, steps, strict=True)])

        def evaluate(x: NDArray) -> NormalEquations:
            r, h = self.residuals(at(x)), 1e-6
            J = np.stack([(self.residuals(at(x + d)) - r) / h for d in h * np.eye(len(x))], axis=1)
            return 0.5 * float(r @ r), J.T @ r, J.T @ J

        start = np.zeros(2 * len(normals))
        return at(levenberg_marquardt(evaluate, start, max_iterations=25, tolerance=1e-6).x)

    def placed(self, normals: NDArray) -> tuple[dict[str, Plane], dict[int, NDArray]]:
        """Return planes and boards' poses where the normals are known."""
        across = np.eye(3) - 2.0 * normals[:, :, None] * normals[:, None, :]
        sums = np.zeros((len(self.boards), 3, 3))
        np.add.at(sums, self.board, across[self.mirror] @ self._turned)
        A, b = self._linear(normals, across)
        found = np.linalg.lstsq(A, b, rcond=None)[0]
        places, offsets = found[: 3 * len(sums)].reshape(-1, 3), found[3 * len(sums) :].tolist()
        unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        planes = {name: Plane(n, d) for name, n, d in zip(self.names, unit, offsets, strict=True)}
        X_WB = transform(nearest_rotation(sums), places)
        return planes, dict(zip(self.boards, X_WB, strict=True))

"""Turns that were written in one convention and taken for another."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import (
    rotation_about,
    rotation_from_quaternion,
    rotation_from_vector,
    rotation_vectors_of,
)

SMALLER = 0.2
"""Part of the misfit that poses may leave as they were meant: other ways leave 0.4 to 1."""
_AS_WELL = 2.0
"""Times the least misfit that another way may leave to be named beside it."""
AS_CONVENTIONS = (
    "write them as CONVENTIONS.md has them (rx, ry, rz: axis times angle in radians; or qx, qy, "
    "qz, qw)"
)
"""What is to be done of turns that were taken for others."""
_VECTORS = "rotation vectors"


class _WrittenTurns(NamedTuple):
    """What turns may have been meant to be."""

    words: str
    """What was taken for what."""
    R: NDArray
    """The rotations. Shape (K, 3, 3)."""


class _Angles(NamedTuple):
    """Three angles of R = R_i(a) R_j(b) R_k(c), each axis moved by those before it."""

    i: int
    j: int
    k: int
    last_first: bool = False
    """Whether the angle written first turns last."""

    def rotations(self, written: NDArray) -> NDArray:
        """Return the rotations of written angles. Shape (K, 3) -> (K, 3, 3)."""
        a, b, c = (written[:, ::-1] if self.last_first else written).T
        x, y, z = np.eye(3)[[self.i, self.j, self.k]]
        return _about(x, a) @ _about(y, b) @ _about(z, c)

    def written(self, R: NDArray) -> NDArray:
        """Return the angles of rotations about three different axes, b within a quarter turn.

        With s the sign of the permutation i, j, k: R_ik = s sin b, R_jk = -s sin a cos b,
        R_ij = -s cos b sin c. Shape (K, 3, 3) -> (K, 3).
        """
        i, j, k = self.i, self.j, self.k
        s = 1.0 if (j - i) % 3 == 1 else -1.0
        a = np.arctan2(-s * R[:, j, k], R[:, k, k])
        b = np.arcsin(np.clip(s * R[:, i, k], -1.0, 1.0))
        c = np.arctan2(-s * R[:, i, j], R[:, i, i])
        return np.stack([c, b, a] if self.last_first else [a, b, c], axis=1)


_ANGLES = {
    "angles about fixed x, y, z (roll, pitch, yaw)": _Angles(2, 1, 0, last_first=True),
    "angles about moving x, y, z": _Angles(0, 1, 2),
    "angles about moving z, y, x (A, B, C)": _Angles(2, 1, 0),
    "angles about moving z, y, z": _Angles(2, 1, 2),
}
"""What controllers tell."""


def meant_turns(off: float, misfit: Callable[..., float], *told: NDArray) -> list[str]:
    """Return as what turns were taken, where they fit as they were meant and not as told.

    Args:
        off: Misfit of what was told.
        misfit: That of any rotations (K, 3, 3), of each of `told` some.
        told: Turns that were all written alike, as rotation vectors [rad]. Shape (K, 3) each.

    Returns:
        What was taken for what, best first; nothing where no other way of writing fits.
    """
    ways = zip(*map(_written_otherwise, told), strict=True)
    tried = [(misfit(*(one.R for one in way)), way[0].words) for way in ways]
    most = min(SMALLER * off, _AS_WELL * min(tried)[0])
    return [words for left, words in sorted(tried) if left <= most]


def _written_otherwise(vectors: NDArray) -> Iterator[_WrittenTurns]:
    """Yield what turns are if they were written in one convention and taken for another."""
    R = rotation_from_vector(vectors)
    v = rotation_vectors_of(R)
    angle = np.linalg.norm(v, axis=1, keepdims=True)
    q = np.hstack([0.5 * np.sinc(angle / (2.0 * np.pi)) * v, np.cos(angle / 2.0)])
    for words, shift in (("w, x, y, z were taken for x, y, z, w", -1),
                         ("x, y, z, w were taken for w, x, y, z", 1)):  # fmt: skip
        yield _WrittenTurns(f"quaternions {words}", rotation_from_quaternion(np.roll(q, shift, 1)))
    yield _WrittenTurns("inverse turns were taken beside places as they are", np.swapaxes(R, 1, 2))
    angles = {name: one for name, one in _ANGLES.items() if one.i != one.k}
    read = {_VECTORS: vectors, **{name: one.written(R) for name, one in angles.items()}}
    for taken, numbers in read.items():
        if taken != _VECTORS:
            yield _WrittenTurns(f"{_VECTORS} were taken for {taken}", rotation_from_vector(numbers))
        for meant, one in _ANGLES.items():
            if meant != taken:
                yield _WrittenTurns(f"{meant} were taken for {taken}", one.rotations(numbers))


def _about(axis: NDArray, angles: NDArray) -> NDArray:
    return rotation_about(np.broadcast_to(axis, (len(angles), 3)), angles)

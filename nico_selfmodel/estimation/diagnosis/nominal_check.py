"""Whether a learned arm is the described robot: its size, its mirror image, axes that are far off.

How neighbouring axes lie to each other does not depend on where joints have their zeros, nor on
which way they count: their angle, how far they pass each other, and how far apart on one axis the
common normals with its two neighbours are (Denavit, Hartenberg 1955).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import nearest_rotation
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.names import listed

_NEAR_RAD = np.radians(15.0)
"""Directions of axes must agree this well (rms), or the two arms cannot be compared."""
_LEAST_SIZE, _LARGE_SIZE = 0.01, 0.05
"""Distances between axes that a comparison of sizes needs, and from which on, in the description or
as learned, what scaling leaves of them may be as large as of any [m]; less may be what the axes are
not known by."""
_SAME_SIZE = 1.3
"""Ratio of sizes up to which a robot may differ from its description."""
_ALL_ALIKE, _LEAST_OFF, _FEWEST_MORE = 4.0, 0.01, 4
"""A robot of nearly its size is told to be larger or smaller where that leaves this many times less
of the distances between axes, by this part at least, and there are so many more of these than it
takes to place it: of lengths that are off one by one it is so by chance once in 600."""
_CLEARLY_LESS = 0.5
"""Ratio of what two readings of the zeros leave, from which on the second is taken."""
_LEFT_OVER, _LEFT_OF_SMALL = 0.3, 0.2
"""Part of the distances between axes that may remain after scaling, and of small ones."""
_TURNED, _SHIFTED = np.radians(10.0), 0.03
"""Angles of axes, and distances, that are off by more are no tolerance [rad, m]."""
_PARALLEL, _CROSSED = np.radians(2.0), np.radians(10.0)
"""Angles of axes up to which they are as far apart anywhere, and from which on it is told where
their common normal lies; between the two neither is."""


@dataclass(frozen=True)
class RobotSize:
    """How large a learned robot is beside its description."""

    scale: float
    """Times as large; negative for its mirror image."""
    left: float
    """Part of the distances between axes that scaling leaves."""
    unscaled: float
    """Part that is left without."""
    more: int
    """Equations beyond those that it takes to place and scale it."""

    @property
    def reason(self) -> str | None:
        """What is said of another size, or of a mirror image; None where it may be the robot."""
        if self.scale < 0.0:
            return (
                "the learned robot is a mirror image of its description: the points are in "
                "left-handed coordinates; negate one of x, y, z (or exchange two of them) in all "
                "points"
            )
        if 1.0 / _SAME_SIZE <= self.scale <= _SAME_SIZE:
            return None
        return (
            f"the learned robot is {self.scale:.4g} times as large as its description: check the "
            "unit of length of what was measured, and that this is the robot"
        )

    @property
    def warning(self) -> str | None:
        """What is said of nearly the same size, if all lengths are off alike."""
        alike = self.more >= _FEWEST_MORE and self.unscaled > _ALL_ALIKE * self.left
        if self.reason is not None or not alike or abs(np.log(self.scale)) < _LEAST_OFF:
            return None
        return (
            f"the learned robot is {self.scale:.4g} times as large as its description, in "
            "all of its lengths alike: check the size of what lengths are measured by (the "
            "tracker's scale, squares of a board, a known distance), or the description"
        )


def compare_sizes(
    nominal: tuple[NDArray, NDArray], learned: tuple[NDArray, NDArray]
) -> RobotSize | None:
    """Return the scale that takes a described robot's axes to the learned ones, both at one zero.

    A mirror turns the sense of every rotation: with points p -> S p, directions go to -S d, so a
    mirrored arm is a rotated one whose distances are scaled by a negative number.

    Args:
        nominal: Directions and points of the axes. Shape (n, 3) each.
        learned: Those of the learned robot.

    Returns:
        None where the axes do not tell: they meet in one point, are all parallel, or are not those
        of the described robot.
    """
    (directions, points), (d, at) = nominal, learned
    if len(d) < 2 or np.linalg.svd(directions, compute_uv=False)[1] < 0.1:
        return None
    rotation = nearest_rotation(d.T @ directions)
    apart = np.arccos(np.clip(np.sum((directions @ rotation.T) * d, axis=1), -1.0, 1.0))
    if np.sqrt(np.mean(apart**2)) > _NEAR_RAD:
        return None
    # A point of the described axis, scaled and moved, lies on the learned one.
    across = np.eye(3) - d[:, :, None] * d[:, None, :]
    lengths = (across @ (points @ rotation.T)[:, :, None]).ravel()
    moves, target = across.reshape(-1, 3), (across @ at[:, :, None]).ravel()
    columns = np.column_stack([lengths, moves])
    solution, _, rank, _ = np.linalg.lstsq(columns, target, rcond=1e-9)
    # How far described axes pass each other, whatever the place of the arm [m].
    reach = _left(moves, lengths)
    scale, left = float(solution[0]), float(np.linalg.norm(columns @ solution - target))
    size = abs(scale) * reach
    part = _LEFT_OVER if max(size, reach) >= _LARGE_SIZE else _LEFT_OF_SMALL
    if rank < 4 or reach < _LEAST_SIZE or left > part * size:
        return None
    unscaled = _left(moves, target - lengths)
    return RobotSize(scale, left / size, unscaled / size, 2 * len(d) - 4)


def _left(columns: NDArray, target: NDArray) -> float:
    """Return what linear least squares leave."""
    return float(np.linalg.norm(target - columns @ np.linalg.lstsq(columns, target)[0]))


def robot_size(nominal: Chain, learned: DhTable, zero_known: NDArray) -> RobotSize | None:
    """Compare a learned arm with the described one.

    Args:
        nominal: The described arm, at its zero.
        learned: The learned arm, at the same zero where that is known.
        zero_known: Joints whose encoders read the description's angles. Shape (n,).

    Returns:
        None where the axes do not tell.
    """
    found = []
    for sign in (1.0, -1.0):
        like = Chain(
            nominal.joints,
            nominal.directions,
            sign * nominal.points,
            nominal.markers,
            sign * nominal.p_WH_zero,
        )
        # An unknown zero is where theta is that of the description, or of its mirror image.
        theta = np.where(zero_known, learned.theta_zero, DhTable.from_chain(like).theta_zero)
        chain = replace(learned, theta_zero=theta).to_chain()
        described = (nominal.directions, nominal.points)
        size = compare_sizes(described, (chain.directions, chain.points))
        if size is not None:
            found.append(size)
    if not found:
        return None
    return found[-1] if found[-1].left < _CLEARLY_LESS * found[0].left else found[0]


def odd_axes(described: Chain, learned: Chain) -> str | None:
    """Say between which neighbouring axes a description is off; None where it is nowhere.

    Args:
        described: The arm as described.
        learned: The same joints as they were learned.
    """
    found = []
    for words, (there, now), least, unit in _compared(described, learned):
        if abs(there - now) > least:
            scale = np.degrees(1.0) if unit == "deg" else 1e3
            found.append(f"{words} {scale * there:.3g} {unit} there, {scale * now:.3g} as learned")
    if not found:
        return None
    return (
        f"the robot's description is far off: {listed(found)}; check axes and origins of these "
        "joints, and that it is this robot"
    )


def _compared(one: Chain, other: Chain) -> Iterator[tuple[str, list[float], float, str]]:
    """Yield what is compared, as described and learned, by how much it may be off, its unit."""
    n, alike = (
        len(one.joints),
        (_Axes(one.directions, one.points), _Axes(other.directions, other.points)),
    )
    for i in range(n - 1):
        pair = f"axes of {one.joints[i]!r} and {one.joints[i + 1]!r}"
        angles = [axes.angle(i) for axes in alike]
        yield f"{pair} enclose", angles, _TURNED, "deg"
        if max(angles) <= _PARALLEL or min(angles) > _CROSSED:
            yield f"{pair} pass each other by", [a.distance(i) for a in alike], _SHIFTED, "mm"
    for i in range(1, n - 1):
        if all(min(a.angle(i - 1), a.angle(i)) > _CROSSED for a in alike):
            along = f"along {one.joints[i]!r} its neighbours are"
            yield along, [a.offset(i) for a in alike], _SHIFTED, "mm"


class _Axes:
    """Lines in space, each with its next."""

    def __init__(self, directions: NDArray, points: NDArray) -> None:
        """Take unit directions and a point of each [m]. Shapes (n, 3)."""
        self._d, self._p = directions, points

    def angle(self, i: int) -> float:
        """Return the angle of an axis and the next, whichever way they count [rad]."""
        a, b = self._d[i], self._d[i + 1]
        return float(np.arctan2(np.linalg.norm(np.cross(a, b)), abs(a @ b)))

    def distance(self, i: int) -> float:
        """Return how far an axis and the next pass each other [m]."""
        apart, normal = self._p[i + 1] - self._p[i], np.cross(self._d[i], self._d[i + 1])
        if self.angle(i) <= _PARALLEL:
            return float(np.linalg.norm(apart - (apart @ self._d[i]) * self._d[i]))
        return abs(float(apart @ normal / np.linalg.norm(normal)))

    def offset(self, i: int) -> float:
        """Return how far apart on an axis its normals with the one before and after are [m]."""
        return abs(self._foot(i, i + 1) - self._foot(i, i - 1))

    def _foot(self, i: int, other: int) -> float:
        """Return where on an axis its common normal with another is, from its point on [m]."""
        a, b, apart = self._d[i], self._d[other], self._p[other] - self._p[i]
        cos = float(a @ b)
        return float((apart @ a - (apart @ b) * cos) / (1.0 - cos**2))

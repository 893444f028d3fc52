"""Where cameras are that look at one body, from what they see of it together.

Two cameras tell their relative pose but for its scale by the essential matrix of the markers that
both saw (Longuet-Higgins 1981); further ones stand where the points reconstructed by these two ask
for (resection).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.guesses.point_guess import SeenPoints
from nico_selfmodel.estimation.tree.tree_observations import SensorRows
from nico_selfmodel.geometry.epipolar import (
    RelativePose,
    essential,
    homogeneous,
    poses_of_essential,
    two_view_depths,
)
from nico_selfmodel.geometry.resection import FEWEST, robust_camera_pose
from nico_selfmodel.geometry.rotation import (
    move_on_sphere,
    rotation_from_vector,
    rotation_vector_slope,
    skew,
)
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.least_squares import NormalEquations, levenberg_marquardt
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.names import listed

FEWEST_TOGETHER = 12
"""Markers that two cameras must have seen together."""
_DRAWS, _BATCHES = 100, 3
_POLISHED = 8
"""Poses of a batch of draws that are refined: the best."""
_ROUNDS = 5
_PLENTY = 0.9
"""Share of pairs that agree with a pose beside which no more are drawn."""
_TRIED = 200
"""Pairs by which poses are drawn and refined: enough to tell one from another."""
_WITHIN_PX = 4.0
"""Distance from the epipolar line within which a pair agrees [px]."""
_SHARE = 0.5
"""Share of pairs that must agree, or the cameras contradict each other."""


def relative_pose(
    first: NDArray, second: NDArray, within: float, rng: np.random.Generator
) -> tuple[NDArray, NDArray]:
    """Return the second camera's pose in the first's frame, baseline 1, and which pairs agree.

    Args:
        first: Ideal image coordinates in the first camera. Shape (N, 2), N >= 8.
        second: In the second. Shape (N, 2).
        within: Sampson distance within which a pair agrees.

    Returns:
        X_AB, shape (4, 4), and boolean, shape (N,).

    Raises:
        DataError: If no relative pose agrees with half of the pairs, or all points lie in a plane.
    """
    best: _Pose | None = None
    few = rng.permutation(len(first))[:_TRIED] if len(first) > _TRIED else slice(None)
    a, b = first[few], second[few]
    for _ in range(_BATCHES):
        drawn = sorted(_drawn(a, b, within, rng), key=lambda pose: pose.cost)
        polished = [pose.polished(a, b, within) for pose in drawn[:_POLISHED]]
        best = min(
            (best, *polished) if best else polished, key=lambda pose: pose.cost, default=None
        )
        if best is not None and best.agree.mean() > _PLENTY:
            break
    if best is None:
        raise DataError(
            "all markers that two cameras saw together lie in one plane, which leaves their "
            "relative pose open: let the markers move in depth, or say where the cameras are"
        )
    best = _Pose.of(best.R, best.t, first, second, within).polished(first, second, within)
    if best.agree.mean() < _SHARE:
        raise DataError(
            "two cameras contradict each other: no relative pose puts more than "
            f"{best.agree.mean():.0%} of the markers that both saw on their epipolar lines; check "
            "their lenses, that neither moved, and that their pictures belong together"
        )
    return inverse(transform(best.R, best.t)), best.agree


@dataclass(frozen=True, eq=False)
class _Pose:
    """A relative pose, p_B = R p_A + t, and what speaks for it."""

    R: NDArray
    t: NDArray
    agree: NDArray
    """Pairs that are before both cameras and within reach of their epipolar lines. Shape (N,)."""
    cost: float
    """Sum of squared distances of these; of all others that of one out of reach (MSAC, Torr 2000).
    How many agree does not tell a pose from one that leaves ten times as much."""

    @classmethod
    def of(cls, R: NDArray, t: NDArray, a: NDArray, b: NDArray, within: float) -> "_Pose":
        """Hold a pose against pairs."""
        off = _sampson(essential(R, t), a, b)[0]
        agree = (np.abs(off) < within) & (two_view_depths(R, t, a, b) > 0.0).all(axis=1)
        return cls(R, t, agree, float(np.sum(np.where(agree, off**2, within**2))))

    def polished(self, a: NDArray, b: NDArray, within: float) -> "_Pose":
        """Refine by what agrees, while that costs less.

        Eight pairs of little depth tell a pose badly: the best that is drawn is not yet one that
        most agree with (locally optimised RANSAC, Chum 2003).
        """
        best = self
        for _ in range(_ROUNDS):
            if best.agree.sum() < 8:
                break
            refined = _refined(best.R, best.t, a[best.agree], b[best.agree])
            found = _Pose.of(*_before_both(*refined, a, b), a, b, within)
            if found.cost >= best.cost:
                break
            best = found
        return best


def _drawn(
    first: NDArray, second: NDArray, within: float, rng: np.random.Generator
) -> Iterator[_Pose]:
    """Yield poses of eight pairs each, but of those that lie in one plane."""
    for _ in range(_DRAWS):
        chosen = rng.choice(len(first), 8, replace=False)
        try:
            pose = RelativePose.from_points(first[chosen], second[chosen])
        except ValueError:
            continue
        yield _Pose.of(pose.rotation, pose.translation, first, second, within)


def _refined(R: NDArray, t: NDArray, a: NDArray, b: NDArray) -> tuple[NDArray, NDArray]:
    """Minimise Sampson's distances by turn (3) and baseline direction (2)."""

    def evaluate(x: NDArray) -> NormalEquations:
        turned, (moved, along) = rotation_from_vector(x[:3]) @ R, move_on_sphere(t, x[3:])
        # exp([v + dv]) = exp([J dv]) exp([v]), so that dE = [t]x [J e_i]x R, and [dt]x R.
        turns = skew(moved) @ skew(rotation_vector_slope(x[:3]).T) @ turned
        r, J = _sampson(
            essential(turned, moved), a, b, np.concatenate([turns, skew(along.T) @ turned])
        )
        return 0.5 * float(r @ r), J.T @ r, J.T @ J

    found = levenberg_marquardt(evaluate, np.zeros(5), max_iterations=15, tolerance=1e-8)
    moved = move_on_sphere(t, found.x[3:])[0]
    return rotation_from_vector(found.x[:3]) @ R, moved / np.linalg.norm(moved)


def _before_both(R: NDArray, t: NDArray, a: NDArray, b: NDArray) -> tuple[NDArray, NDArray]:
    """Return the pose of the same essential matrix that has most points before both cameras.

    Sampson's distances do not tell the four apart, and a step of theirs may lead from one to
    another.
    """
    return max(
        poses_of_essential(essential(R, t)),
        key=lambda pose: int((two_view_depths(*pose, a, b) > 0.0).all(axis=1).sum()),
    )


def _sampson(
    E: NDArray, a: NDArray, b: NDArray, dE: NDArray | None = None
) -> tuple[NDArray, NDArray]:
    """Return first-order distances from the epipolar lines, and their derivatives.

    r = e / s with e = y' E x and s^2 = (E x)_1^2 + (E x)_2^2 + (E' y)_1^2 + (E' y)_2^2 (Sampson
    1982; Hartley and Zisserman 2004, 11.4.3), and dr = de / s - r ds / s.

    Args:
        E: Essential matrix. Shape (3, 3).
        a: Ideal image coordinates x in the first camera. Shape (N, 2).
        b: y in the second. Shape (N, 2).
        dE: Derivatives of E; none if omitted. Shape (P, 3, 3).

    Returns:
        r, shape (N,), and dr, shape (N, P).
    """
    x, y = homogeneous(a), homogeneous(b)
    lines = np.hstack([(x @ E.T)[:, :2], (y @ E)[:, :2]])
    s = np.sqrt(np.maximum(np.einsum("ni,ni->n", lines, lines), 1e-300))
    r = np.einsum("ni,ni->n", y, x @ E.T) / s
    changes = np.zeros((0, 3, 3)) if dE is None else dE
    forth, back = x @ changes.swapaxes(1, 2), y @ changes
    ds = np.einsum("pni,ni->pn", forth[..., :2], lines[:, :2])
    ds = (ds + np.einsum("pni,ni->pn", back[..., :2], lines[:, 2:])) / s
    return r, ((np.einsum("pni,ni->pn", forth, y) - r * ds) / s).T


def cameras_from_markers(
    seen: Mapping[str, SensorRows], lenses: Mapping[str, Camera], seed: int
) -> tuple[dict[str, NDArray], SeenPoints]:
    """Place cameras that stand in the world, the first at the origin, and what they saw.

    Args:
        seen: Rows of each camera, by name.
        lenses: Their intrinsics.

    Returns:
        X_WC by camera, shape (4, 4), of those that saw what others saw, and the markers that two of
        them saw, in units of the first baseline.

    Raises:
        DataError: If no two cameras saw enough together, or they contradict each other.
    """
    rng = np.random.default_rng((seed, 3))
    a, b, rows_a, rows_b = _best_pair(seen)
    first = lenses[a].undistort(seen[a].measured[rows_a])
    second = lenses[b].undistort(seen[b].measured[rows_b])
    within = _WITHIN_PX / lenses[a].fx
    X_AB, agree = relative_pose(first, second, within, rng)
    R, t = inverse(X_AB)[:3, :3], inverse(X_AB)[:3, 3]
    depth = two_view_depths(R, t, first, second)[:, 0]
    p = homogeneous(first) * depth[:, None]
    points = SeenPoints(seen[a].pose[rows_a][agree], seen[a].marker[rows_a][agree], p[agree])
    places = {a: np.eye(4), b: X_AB}
    while left := [name for name in seen if name not in places]:
        counts = {name: len(together(seen[name], points)[0]) for name in left}
        name = max(left, key=lambda one: counts[one])
        if counts[name] < FEWEST_TOGETHER:
            break
        places[name] = resected(seen[name], lenses[name], points, name, rng)
        points = _more(points, seen, lenses, places, name)
    X_NA = inverse(places[next(name for name in seen if name in places)])
    places = {name: X_NA @ X for name, X in places.items()}
    moved = points.p_WM @ X_NA[:3, :3].T + X_NA[:3, 3]
    return places, SeenPoints(points.pose, points.marker, moved)


def _best_pair(seen: Mapping[str, SensorRows]) -> tuple[str, str, NDArray, NDArray]:
    """Return the two cameras that saw most together, and their common rows."""
    names, best = list(seen), None
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            common = together(seen[a], seen[b])
            if best is None or len(common[0]) > len(best[2]):
                best = (a, b, *common)
    if best is None or len(best[2]) < FEWEST_TOGETHER:
        count = 0 if best is None else len(best[2])
        raise DataError(
            f"no two of the cameras {listed(names)} saw {FEWEST_TOGETHER} markers together (at "
            f"most {count}), which would tell where they are: give the robot's description, or "
            "record more poses in view of both"
        )
    return best


def _more(
    points: SeenPoints,
    seen: Mapping[str, SensorRows],
    lenses: Mapping[str, Camera],
    places: Mapping[str, NDArray],
    new: str,
) -> SeenPoints:
    """Add what a camera that was placed and one before it both saw, and nobody has located."""
    for other in (name for name in places if name != new):
        i, j = together(seen[new], seen[other])
        fresh = ~np.isin(np.arange(len(seen[new].rows)), together(seen[new], points)[0])[i]
        i, j = i[fresh], j[fresh]
        X_NO = inverse(places[new]) @ places[other]
        X_ON = inverse(X_NO)
        x = lenses[new].undistort(seen[new].measured[i])
        y = lenses[other].undistort(seen[other].measured[j])
        depth = two_view_depths(X_ON[:3, :3], X_ON[:3, 3], x, y)
        p = homogeneous(x) * depth[:, :1]
        p_O = apply(X_ON, p)
        with np.errstate(divide="ignore", invalid="ignore"):
            off = np.abs(p_O[:, :2] / p_O[:, 2:] - y).max(axis=1, initial=0.0)
            good = (depth > 0.0).all(axis=1) & (off < _WITHIN_PX / lenses[other].fx)
        points = SeenPoints(
            np.append(points.pose, seen[new].pose[i[good]]),
            np.append(points.marker, seen[new].marker[i[good]]),
            np.vstack([points.p_WM, apply(places[new], p[good])]),
        )
    return points


def together(a: SensorRows, b: SensorRows | SeenPoints) -> tuple[NDArray, NDArray]:
    """Return rows of a sensor, and of another or of points, of one marker in one sample."""
    most = int(max(a.marker.max(initial=0), b.marker.max(initial=0))) + 1
    _, i, j = np.intersect1d(
        a.pose * most + a.marker, b.pose * most + b.marker, return_indices=True
    )
    return i, j


def resected(
    rows: SensorRows, lens: Camera, points: SeenPoints, name: str, rng: np.random.Generator,
    within: float = 0.05,
) -> NDArray:  # fmt: skip
    """Return where a camera stands that saw points whose places are known. Shape (4, 4).

    Raises:
        DataError: If it saw fewer than six of them.
    """
    i, j = together(rows, points)
    rays = lens.directions(rows.measured[i])
    # At a fold of its lens a camera may have no ray for a pixel.
    told = np.isfinite(rays).all(axis=1)
    if told.sum() < FEWEST:
        raise DataError(
            f"camera {name!r} saw {told.sum()} markers whose places are known, {FEWEST} are needed"
        )
    return robust_camera_pose(points.p_WM[j[told]], rays[told], within, rng)[0]

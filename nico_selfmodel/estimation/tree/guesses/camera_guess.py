"""Where cameras are that look at one body, from what they see of it together.

Two cameras tell their relative pose but for its scale by the essential matrix of the markers that
both saw (Longuet-Higgins 1981); further ones stand where the points reconstructed by these two ask
for (resection).
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.guesses.point_guess import SeenPoints
from nico_selfmodel.estimation.tree.tree_observations import SensorRows
from nico_selfmodel.geometry.epipolar import RelativePose, essential, homogeneous, two_view_depths
from nico_selfmodel.geometry.resection import FEWEST, robust_camera_pose
from nico_selfmodel.geometry.rotation import move_on_sphere, rotation_from_vector
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.least_squares import NormalEquations, levenberg_marquardt
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.names import listed

FEWEST_TOGETHER = 12
"""Markers that two cameras must have seen together."""
_DRAWS = 300
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
        rng: Of the draws.

    Returns:
        X_AB, shape (4, 4), and boolean, shape (N,).

    Raises:
        DataError: If no relative pose agrees with half of the pairs, or all points lie in a plane.
    """
    best: tuple[int, RelativePose] | None = None
    for _ in range(_DRAWS):
        chosen = rng.choice(len(first), 8, replace=False)
        try:
            pose = RelativePose.from_points(first[chosen], second[chosen])
        except ValueError:  # these eight lie in one plane
            continue
        agree = int(_agreeing(pose.rotation, pose.translation, first, second, within).sum())
        if best is None or agree > best[0]:
            best = (agree, pose)
            if agree > 0.9 * len(first):
                break
    if best is None:
        raise DataError(
            "all markers that two cameras saw together lie in one plane, which leaves their "
            "relative pose open: let the markers move in depth, or say where the cameras are"
        )
    R, t = best[1].rotation, best[1].translation
    for _ in range(3):
        agree = _agreeing(R, t, first, second, within)
        if agree.sum() < 8:
            break
        R, t = _refined(R, t, first[agree], second[agree])
    agree = _agreeing(R, t, first, second, within)
    if agree.mean() < _SHARE:
        raise DataError(
            f"two cameras contradict each other: no relative pose puts more than {agree.mean():.0%}"
            " of the markers that both saw on their epipolar lines; check their lenses, that "
            "neither moved, and that their pictures belong together"
        )
    return inverse(transform(R, t)), agree


def _refined(R: NDArray, t: NDArray, a: NDArray, b: NDArray) -> tuple[NDArray, NDArray]:
    """Minimise Sampson's distances by turn (3) and baseline direction (2)."""

    def at(x: NDArray) -> tuple[NDArray, NDArray]:
        return rotation_from_vector(x[:3]) @ R, move_on_sphere(t, x[3:])[0]

    def evaluate(x: NDArray) -> NormalEquations:
        r = _sampson(*at(x), a, b)
        steps = 1e-7 * np.eye(5)
        J = np.stack(
            [(_sampson(*at(x + d), a, b) - _sampson(*at(x - d), a, b)) / 2e-7 for d in steps],
            axis=1,
        )
        return 0.5 * float(r @ r), J.T @ r, J.T @ J

    found = levenberg_marquardt(evaluate, np.zeros(5), max_iterations=15, tolerance=1e-8)
    turned, moved = at(found.x)
    return turned, moved / np.linalg.norm(moved)


def _sampson(R: NDArray, t: NDArray, a: NDArray, b: NDArray) -> NDArray:
    """Return x_2' E x_1 / |its slope|, first-order distances from the epipolar lines. (N,)."""
    E = essential(R, t)
    x, y = homogeneous(a), homogeneous(b)
    forth, back = x @ E.T, y @ E
    slope = np.sum(forth[:, :2] ** 2, axis=1) + np.sum(back[:, :2] ** 2, axis=1)
    return np.sum(y * forth, axis=1) / np.sqrt(np.maximum(slope, 1e-300))


def _agreeing(R: NDArray, t: NDArray, a: NDArray, b: NDArray, within: float) -> NDArray:
    near = np.abs(_sampson(R, t, a, b)) < within
    return near & (two_view_depths(R, t, a, b) > 0.0).all(axis=1)


def cameras_from_markers(
    seen: Mapping[str, SensorRows], lenses: Mapping[str, Camera], seed: int
) -> tuple[dict[str, NDArray], SeenPoints]:
    """Place cameras that stand in the world, the first at the origin, and what they saw.

    Args:
        seen: Rows of each camera, by name.
        lenses: Their intrinsics.
        seed: Of the draws.

    Returns:
        X_WC by camera, shape (4, 4), and the markers that two of them saw, in units of the first
        baseline.

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
    for name in seen:
        if name not in places:
            places[name] = resected(seen[name], lenses[name], points, name, rng)
    names = list(seen)
    X_NA = inverse(places[names[0]])
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


def together(a: SensorRows, b: SensorRows) -> tuple[NDArray, NDArray]:
    """Return rows of two sensors that are of one marker in one sample."""
    most = int(max(a.marker.max(), b.marker.max())) + 1
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
    most = int(max(rows.marker.max(), points.marker.max())) + 1
    _, i, j = np.intersect1d(
        rows.pose * most + rows.marker, points.pose * most + points.marker, return_indices=True
    )
    rays = lens.directions(rows.measured[i])
    # At a fold of its lens a camera may have no ray for a pixel.
    told = np.isfinite(rays).all(axis=1)
    if told.sum() < FEWEST:
        raise DataError(
            f"camera {name!r} saw {told.sum()} markers whose places are known, {FEWEST} are needed"
        )
    return robust_camera_pose(points.p_WM[j[told]], rays[told], within, rng)[0]

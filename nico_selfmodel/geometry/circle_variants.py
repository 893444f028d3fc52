"""Circles fitted in other ways: with known angles, against outliers, by the thesis' own steps."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.geometry.circle import Circle, covariance_of
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.rotation import frame_along, rotation_from_vector, skew
from nico_selfmodel.least_squares import NormalEquations, levenberg_marquardt

_CANDIDATES = 6


def circle_with_angles(
    points: ArrayLike, angles: ArrayLike, *, sigma: float | None = None
) -> Circle:
    """Fit P = c + R (cos q, sin q, 0) r with known angles q: far better on short arcs.

    With a 30 deg arc the centre's error within the plane falls to a sixth to a tenth of that of a
    free circle. Across the plane angles tell nothing, so that in all it falls by a quarter only.

    Args:
        points: Shape (n, 3), n >= 3.
        angles: Joint angles, up to a common offset [rad]. Shape (n,).
        sigma: Known standard deviation of a coordinate [m].

    Returns:
        The circle; its normal is the axis about which `angles` count positive.

    Raises:
        ValueError: If the points are not finite, collinear or coincide, or the angles are not
            one finite number a point or do not move.
    """
    points, angles = np.asarray(points, dtype=float), np.asarray(angles, dtype=float)
    Plane.from_points(points)  # refuses points that do not span a plane
    if angles.shape != (len(points),) or not np.isfinite(angles).all():
        raise ValueError(
            f"angles must be finite and of shape ({len(points)},), one a point, got {angles}"
        )
    design = np.column_stack([np.ones_like(angles), np.cos(angles), np.sin(angles)])
    if np.linalg.matrix_rank(design) < 3:
        raise ValueError("a circle needs at least three different angles")
    center, along, across = np.linalg.lstsq(design, points, rcond=None)[0]
    radius = 0.5 * float(np.linalg.norm(along) + np.linalg.norm(across))
    normal = np.cross(along, across)
    normal /= np.linalg.norm(normal)
    along -= (along @ normal) * normal
    along /= np.linalg.norm(along)
    frame = np.column_stack([along, np.cross(normal, along), normal])
    return _refine_with_angles(points, angles, center, frame, radius, sigma)


def _refine_with_angles(
    points: NDArray,
    angles: NDArray,
    center: NDArray,
    frame: NDArray,
    radius: float,
    sigma: float | None,
) -> Circle:
    """Refine centre (3), orientation (3) and radius from the linear start."""
    ring = np.column_stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)])

    def residuals(x: NDArray, frame: NDArray) -> tuple[NDArray, NDArray]:
        arms = ring @ (rotation_from_vector(x[3:6]) @ frame).T
        predicted = x[:3] + x[6] * arms
        jacobian = np.zeros((len(points), 3, 7))
        jacobian[:, :, :3] = np.eye(3)
        jacobian[:, :, 3:6] = -skew(x[6] * arms)
        jacobian[:, :, 6] = arms
        return (predicted - points).ravel(), jacobian.reshape(-1, 7)

    x = np.concatenate([center, np.zeros(3), [radius]])
    for _ in range(3):  # re-based, as the derivative above is exact at zero rotation only

        def evaluate(y: NDArray, frame: NDArray = frame) -> NormalEquations:
            r, jacobian = residuals(y, frame)
            return 0.5 * float(r @ r), jacobian.T @ r, jacobian.T @ jacobian

        x = levenberg_marquardt(evaluate, x, max_iterations=50, tolerance=1e-13).x
        frame = rotation_from_vector(x[3:6]) @ frame
        x[3:6] = 0.0
    r, jacobian = residuals(x, frame)
    normal = frame[:, 2]
    basis = frame_along(normal)
    # A turn w moves the normal by w x n: along u by w.v, along v by -w.u.
    select = np.zeros((6, 7))
    select[:3, :3], select[3, 3:6], select[4, 3:6] = basis.T, basis[:, 1], -basis[:, 0]
    select[5, 6] = 1.0
    covariance = covariance_of(r, jacobian, sigma)
    covariance = None if covariance is None else select @ covariance @ select.T
    circle = Circle(x[:3], normal, abs(float(x[6])), 0.0, float(np.ptp(angles)), covariance)
    rms = float(np.sqrt(np.mean(np.sum(circle.residuals_to(points) ** 2, axis=1))))
    return Circle(circle.center, normal, circle.radius, rms, circle.arc, covariance)


def robust_circle(
    points: ArrayLike, rng: np.random.Generator, *, draws: int = 200, sigma: float | None = None
) -> tuple[Circle, NDArray]:
    """Fit a circle that up to a third of the points may disagree with.

    Random triples are scored by the median squared distance (RANSAC without a threshold); points
    within 3.5 robust standard deviations of the best are refitted.

    Args:
        points: Shape (n, 3), n >= 3. Fewer than six points are used as they are.
        draws: Number of triples.
        sigma: Known standard deviation of a coordinate [m].

    Returns:
        The circle and the boolean inlier mask, shape (n,).

    Raises:
        ValueError: If the points are collinear or coincide.
    """
    points = np.asarray(points, dtype=float)
    Plane.from_points(points)  # refuses points that do not span a plane
    if len(points) < 6:
        return Circle.from_points(points, sigma=sigma), np.ones(len(points), dtype=bool)
    triples = points[rng.permuted(np.tile(np.arange(len(points)), (draws, 1)), axis=1)[:, :3]]
    centers, normals, radii = circles_through(triples)
    offset = points - centers[:, None]
    height = np.einsum("dni,di->dn", offset, normals)
    rho = np.sqrt(np.maximum(np.sum(offset**2, axis=2) - height**2, 0.0))
    squared = (rho - radii[:, None]) ** 2 + height**2
    scores = np.median(squared, axis=1)
    if not np.isfinite(scores).any():
        raise ValueError("the points are collinear or coincide: no circle passes through them")
    # Where points disagree, the best triple may be a lucky one: the next best get a chance too.
    tried = []
    for draw in np.argsort(scores)[:_CANDIDATES]:
        circle, inliers = _refit_inliers(points, np.sqrt(squared[draw]), sigma)
        if inliers.all():
            return circle, inliers
        distances = np.linalg.norm(circle.residuals_to(points), axis=1)
        tried.append((float(np.median(distances)) / inliers.sum(), circle, inliers))
    return min(tried, key=lambda entry: entry[0])[1:]


def _refit_inliers(
    points: NDArray, distances: NDArray, sigma: float | None
) -> tuple[Circle, NDArray]:
    """Refit to the points that a first circle explains until the set of them settles."""
    floor = 1e-12 * np.abs(points).max()
    inliers = _inliers(distances, floor)
    circle = Circle.from_points(points[inliers], sigma=sigma)
    for _ in range(4):
        chosen = _inliers(np.linalg.norm(circle.residuals_to(points), axis=1), floor)
        if np.array_equal(chosen, inliers):
            break
        inliers = chosen
        circle = Circle.from_points(points[inliers], sigma=sigma)
    return circle, inliers


def _inliers(distances: NDArray, floor: float) -> NDArray:
    """Return what lies within 3.5 robust standard deviations; half the points always do."""
    median = float(np.median(distances))
    # The median of a Rayleigh variable is 1.1774 sigma; few points fit too well (Rousseeuw 1987).
    few = 1.0 + 5.0 / max(len(distances) - 3, 1)
    return distances <= max(3.5 / 1.1774 * few * median, floor)


def circles_through(triples: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Return the circles through point triples, (d, 3, 3) -> centres, normals, radii.

    Triples that are collinear to ten digits, each for itself, give nan.
    """
    a, b = triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0]
    normal = np.cross(a, b)
    area = np.sum(normal**2, axis=1, keepdims=True)
    square_a, square_b = np.sum(a * a, axis=1, keepdims=True), np.sum(b * b, axis=1, keepdims=True)
    area = np.where(area > 1e-20 * square_a * square_b, area, np.nan)
    offset = np.cross(square_a * b - square_b * a, normal) / (2.0 * area)
    return triples[:, 0] + offset, normal / np.sqrt(area), np.linalg.norm(offset, axis=1)

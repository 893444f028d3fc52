"""Circles in space fitted to points: plane by SVD, Pratt in the plane, geometric refinement."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.rotation import frame_along, signed_angle, tangent_basis
from nico_selfmodel.least_squares import NormalEquations, levenberg_marquardt


@dataclass(frozen=True, eq=False)
class Circle:
    """A circle in space with the covariance of its six parameters.

    The basis (u, v, normal) that the covariance refers to is `tangent_basis(normal)` and `normal`.
    """

    center: NDArray
    """Centre [m]. Shape (3,)."""
    normal: NDArray
    """Unit normal of the plane; its sign has no meaning. Shape (3,)."""
    radius: float
    """Radius [m]."""
    rms: float
    """Root of the mean squared distance of the fitted points to the circle [m]."""
    arc: float
    """Angle between the outermost fitted points, 2 pi minus the largest gap [rad]."""
    covariance: NDArray | None
    """Of (centre along u, v, normal; normal along u, v; radius). Shape (6, 6). None where neither
    redundant points nor a known sigma say how noisy the points are."""

    @property
    def sagitta(self) -> float:
        """Height of the fitted arc over its chord, R (1 - cos(arc / 2)) [m].

        A plane is only known where this is well above the noise: below about five sigma the normal
        is wrong by tens of degrees.
        """
        return self.radius * (1.0 - np.cos(0.5 * self.arc))

    @classmethod
    def from_points(cls, points: ArrayLike, *, sigma: float | None = None) -> "Circle":
        """Fit a circle to points in the geometric least squares sense.

        Args:
            points: Shape (n, 3) with n >= 3.
            sigma: Known standard deviation of a coordinate [m]; estimated from the residuals where
                omitted and n > 3.

        Returns:
            The circle nearest to the points.

        Raises:
            ValueError: If the shape is wrong, a point is not finite, or the points are collinear or
                coincide.
        """
        points = np.asarray(points, dtype=float)
        plane = Plane.from_points(points)
        start = _pratt_circle(points, plane.normal)
        return _refine_circle(points, *start, sigma=sigma)

    def residuals_to(self, points: ArrayLike) -> NDArray:
        """Return (in-plane distance - radius, height over the plane) [m]. (n, 3) -> (n, 2)."""
        offset = np.asarray(points, dtype=float) - self.center
        height = offset @ self.normal
        in_plane = np.linalg.norm(offset - height[..., None] * self.normal, axis=-1)
        return np.stack([in_plane - self.radius, height], axis=-1)

    def angles_of(self, points: ArrayLike) -> NDArray:
        """Return angles about the normal from the first point [rad], in (-pi, pi]. (n, 3) -> (n,).

        The caller unwraps them in the order of the encoder, never in the order of the angle.
        """
        offset = np.asarray(points, dtype=float) - self.center
        offset = offset - (offset @ self.normal)[:, None] * self.normal
        return signed_angle(offset[0], offset, self.normal)


def _pratt_circle(points: NDArray, normal: NDArray) -> tuple[NDArray, NDArray, float]:
    """Fit a circle algebraically in the plane through the centroid (Pratt 1987, SVD form).

    Unlike Kasa's fit it does not shrink short arcs. Three points, or points without noise, make
    the generalised eigenproblem singular: the null vector is the answer then. Returns centre, shape
    (3,), the normal, and the radius.

    Raises:
        ValueError: If the points lie on a straight line.
    """
    basis, centroid = tangent_basis(normal), points.mean(axis=0)
    xy = (points - centroid) @ basis
    scale = np.sqrt(np.mean(np.sum(xy**2, axis=1)))
    xy = xy / scale
    z = np.column_stack([np.sum(xy**2, axis=1), xy, np.ones(len(xy))])
    _, values, vt = np.linalg.svd(z, full_matrices=len(z) < 4)
    if len(values) < 4 or values[3] < 1e-11 * values[0]:
        a, b, c, d = vt[3]
    else:
        w = (vt.T * values) @ vt
        # Pratt's constraint B^2 + C^2 - 4 A D = 1, inverted
        inverse = np.array([[0, 0, 0, -0.5], [0, 1, 0, 0], [0, 0, 1, 0], [-0.5, 0, 0, 0]])
        eigenvalues, vectors = np.linalg.eigh(w @ inverse @ w)
        smallest_positive = np.argmax(eigenvalues > 0.0)
        a, b, c, d = np.linalg.solve(w, vectors[:, smallest_positive])
    discriminant = b * b + c * c - 4.0 * a * d
    if abs(a) < 1e-12 * np.sqrt(max(discriminant, 0.0)) or discriminant <= 0.0:
        raise ValueError("the points lie on a straight line: no circle passes through them")
    center = centroid + basis @ (-0.5 * scale / a * np.array([b, c]))
    return center, normal, float(0.5 * scale * np.sqrt(discriminant) / abs(a))


def _refine_circle(
    points: NDArray,
    center: NDArray,
    normal: NDArray,
    radius: float,
    *,
    sigma: float | None = None,
) -> Circle:
    """Minimise squared distances to the circle, (rho - R)^2 + h^2, from a start [m]."""
    frame = frame_along(normal)
    offset = (points - center) @ frame

    def evaluate(x: NDArray) -> NormalEquations:
        r, jacobian = _residuals(offset, radius, x)
        return 0.5 * float(r @ r), jacobian.T @ r, jacobian.T @ jacobian

    x = levenberg_marquardt(evaluate, np.zeros(6), max_iterations=200, tolerance=1e-10).x
    center, radius = center + frame @ x[:3], radius + x[5]
    normal = frame @ np.array([x[3], x[4], 1.0])
    normal = normal / np.linalg.norm(normal)
    return _measured_circle(points, center, normal, float(radius), sigma)


def _measured_circle(
    points: NDArray, center: NDArray, normal: NDArray, radius: float, sigma: float | None
) -> Circle:
    """Complete a fitted circle with its arc, rms and covariance."""
    frame = frame_along(normal)
    offset = (points - center) @ frame
    r, jacobian = _residuals(offset, radius, np.zeros(6))
    angles = np.sort(np.arctan2(offset[:, 1], offset[:, 0]))
    gaps = np.diff(angles, append=angles[0] + 2.0 * np.pi)
    rms = float(np.sqrt(r @ r / len(points)))
    covariance = covariance_of(r, jacobian, sigma)
    return Circle(center, normal, radius, rms, float(2.0 * np.pi - gaps.max()), covariance)


def covariance_of(residuals: NDArray, jacobian: NDArray, sigma: float | None) -> NDArray | None:
    """Return s^2 (J'J)^-1, with s known or from redundancy; None where neither is there."""
    redundancy = len(residuals) - jacobian.shape[1]
    if sigma is None and redundancy <= 0:
        return None
    variance = sigma**2 if sigma is not None else float(residuals @ residuals) / redundancy
    return variance * np.linalg.pinv(jacobian.T @ jacobian, hermitian=True)


def _residuals(offset: NDArray, radius: float, x: NDArray) -> tuple[NDArray, NDArray]:
    """Return stacked (rho - R, h) and their derivatives by (centre, tilt, radius).

    In the start frame the normal is n = (t1, t2, 1) / |.|; for p = offset - centre,
    h = p.n and rho^2 = p.p - h^2.
    """
    p = offset - x[:3]
    length = np.sqrt(1.0 + x[3] ** 2 + x[4] ** 2)
    n = np.array([x[3], x[4], 1.0]) / length
    h = p @ n
    rho = np.sqrt(np.maximum(np.sum(p * p, axis=1) - h * h, 1e-300))
    count = len(p)
    jacobian = np.zeros((2 * count, 6))
    jacobian[:count, :3] = (h[:, None] * n - p) / rho[:, None]
    jacobian[count:, :3] = -n
    # dn/dt_k = (e_k - n n_k) / |.|, and d rho = -(h / rho) dh
    by_tilt = (p[:, :2] - h[:, None] * n[:2]) / length
    jacobian[:count, 3:5] = -(h / rho)[:, None] * by_tilt
    jacobian[count:, 3:5] = by_tilt
    jacobian[:count, 5] = -1.0
    return np.concatenate([rho - radius - x[5], h]), jacobian

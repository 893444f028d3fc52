"""Arcs in space of which everything is known."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import tangent_basis


@dataclass(frozen=True, eq=False)
class Arc:
    """A true circle, the angles of its samples, and the samples."""

    center: NDArray
    normal: NDArray
    radius: float
    angles: NDArray
    points: NDArray


@pytest.fixture(scope="session")
def make_arc():
    """Return a function that samples an arc of a circle, 0.6 m off the origin."""

    def make(
        seed: int, count: int, arc_deg: float, *, sigma: float = 0.0, radius: float = 0.127
    ) -> Arc:
        rng = np.random.default_rng(seed)
        normal, center = rng.normal(size=3), rng.normal(0.0, 0.35, 3)
        normal /= np.linalg.norm(normal)
        angles = rng.uniform(-np.pi, np.pi) + np.radians(arc_deg) * np.linspace(0.0, 1.0, count)
        ring = np.column_stack([np.cos(angles), np.sin(angles)]) @ tangent_basis(normal).T
        points = center + radius * ring + rng.normal(0.0, 1.0, (count, 3)) * sigma
        return Arc(center, normal, radius, angles, points)

    return make


@pytest.fixture(scope="session")
def assert_same_circle():
    """Return a check of a circle against another, whatever the signs of their normals."""

    def check(circle, other, tolerance: float) -> None:
        assert circle.center == pytest.approx(other.center, abs=tolerance)
        assert circle.radius == pytest.approx(other.radius, abs=tolerance)
        sign = np.sign(circle.normal @ other.normal)
        assert circle.normal == pytest.approx(sign * other.normal, abs=tolerance / other.radius)

    return check


@pytest.fixture(scope="session")
def parameter_errors():
    """Return a function: a circle's errors in the basis that its covariance refers to. (6,)."""

    def errors(circle, truth) -> NDArray:
        basis = tangent_basis(circle.normal)
        normal = truth.normal * np.sign(truth.normal @ circle.normal)
        frame = np.column_stack([basis, circle.normal])
        center = frame.T @ (circle.center - truth.center)
        return np.concatenate([center, -basis.T @ normal, [circle.radius - truth.radius]])

    return errors

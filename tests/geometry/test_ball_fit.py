"""Balls that a surface seen from outside lies on."""

import numpy as np
import pytest

from nico_selfmodel.geometry.solids.ball_fit import fit_balls
from nico_selfmodel.geometry.solids.solid import distance_to_solids

CLOSE = 2e-3


def on_a_ball(radius, count=800):
    """Return points on a ball about the origin, and the normals there. Shapes (count, 3)."""
    way = np.random.default_rng(0).standard_normal((count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    return radius * way, way


def notch():
    """Return points of two plates that meet at the bottom of a notch, and their normals."""
    a, b = np.meshgrid(np.linspace(0.0, 0.1, 21), np.linspace(-0.05, 0.05, 21))
    flat = np.column_stack([a.ravel(), b.ravel(), np.zeros(a.size)])
    return (
        np.vstack([flat, flat[:, [2, 1, 0]]]),
        np.repeat([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], a.size, axis=0),
    )


@pytest.mark.parametrize("surface", [on_a_ball(0.06), notch()], ids=["ball", "notch"])
def test_all_points_lie_on_balls_and_none_deeper_than_allowed(surface):
    balls = fit_balls(*surface, CLOSE, 0.03)
    off = distance_to_solids(balls, surface[0])[0]
    assert np.abs(off).max() <= CLOSE + 1e-12
    assert len(balls) < 0.2 * len(surface[0])


def test_a_ball_no_larger_than_allowed_is_one_ball():
    (found,) = fit_balls(*on_a_ball(0.025), CLOSE, 0.03)
    assert found.size == pytest.approx((0.025,) * 3, abs=2.0 * CLOSE)
    assert np.linalg.norm(found.X_FS[:3, 3]) < 2.0 * CLOSE


def test_what_is_seen_from_one_side_reaches_two_radii_behind_it_and_a_notch_stays_open():
    points, normals = notch()
    balls = fit_balls(points, normals, CLOSE, 0.03)
    behind = np.array([[0.05, 0.0, -0.059], [0.05, 0.0, -0.0601]])
    nearest = min(ball.X_FS[2, 3] - ball.size[0] for ball in balls)
    assert behind[1, 2] <= nearest <= behind[0, 2]
    inside = np.array([[0.01, 0.0, 0.01], [0.03, 0.02, 0.02]])
    assert (distance_to_solids(balls, inside)[0] > 0.007).all()


@pytest.mark.parametrize(
    ("points", "normals", "close", "largest", "said"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3)), CLOSE, 0.03, "n >= 1"),
        (np.zeros((2, 3)), np.zeros((1, 3)), CLOSE, 0.03, "n_FQ must have shape"),
        (np.zeros((1, 3)), np.full((1, 3), np.nan), CLOSE, 0.03, "n_FQ must be finite"),
        (np.zeros((1, 3)), np.zeros((1, 3)), CLOSE, 0.03, "unit length"),
        (np.zeros((1, 3)), np.ones((1, 3)), 0.0, 0.03, "0 < close < largest"),
        (np.zeros((1, 3)), np.ones((1, 3)), 0.03, 0.03, "0 < close < largest"),
    ],
)
def test_what_is_no_surface_is_refused(points, normals, close, largest, said):
    with pytest.raises(ValueError, match=said):
        fit_balls(points, normals, close, largest)

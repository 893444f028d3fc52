"""A camera that is turned to what it sees shows it, and a homography tells where."""

import numpy as np
import pytest

from nico_selfmodel.systems.rendering.turned_view import TurnedView

FOCAL = np.array([760.0, 750.0])


def box(low, high):
    """Return the corners between two rays."""
    return np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])])


@pytest.mark.parametrize(
    ("low", "high"),
    [((0.5, 0.3), (1.2, 0.9)), ((-1.1, -0.1), (-0.7, 0.2)), ((-0.2, -0.2), (0.2, 0.2))],
)
def test_all_that_is_looked_at_lies_inside_with_room_to_spare(low, high):
    view = TurnedView.of(box(low, high), FOCAL)
    x, y = np.meshgrid(np.linspace(low[0], high[0], 9), np.linspace(low[1], high[1], 9))
    rays = np.stack([x.ravel(), y.ravel(), np.ones(81)])
    places = view.H @ rays
    places = places[:2] / places[2]
    assert (places.min(axis=1) >= 4.0).all()
    assert (places.max(axis=1) <= np.array(view.size) - 4.0).all()
    # Drake wants the principal point inside what it renders.
    assert ((view.K[:2, 2] > 0.0) & (view.K[:2, 2] < view.size)).all()
    np.testing.assert_allclose(view.R_CT.T @ view.R_CT, np.eye(3), atol=1e-12)
    assert np.linalg.det(view.R_CT) == pytest.approx(1.0)
    depth = (view.R_CT.T @ rays)[2]
    assert depth.max() == pytest.approx(view.deepest)


def test_a_corner_of_a_wide_picture_is_a_small_one():
    view = TurnedView.of(box([0.9, 0.6], [1.1, 0.8]), FOCAL)
    assert view.area < 0.1 * (1.1 * FOCAL[0]) * (0.8 * FOCAL[1])


def test_pixels_on_the_sides_look_where_the_homography_has_them():
    view = TurnedView.of(box([0.5, 0.3], [0.8, 0.6]), FOCAL)
    rows, columns, rays = view.border()
    places = view.H @ np.column_stack([rays, np.ones(len(rays))]).T
    np.testing.assert_allclose(places[:2] / places[2], [columns + 0.5, rows + 0.5], atol=1e-8)
    assert len(set(zip(rows, columns, strict=True))) == 2 * sum(view.size) - 4

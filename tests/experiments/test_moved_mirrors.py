"""A mirror that pictures move farther than the hand allows tells nothing of a shape."""

from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.estimation.shape.fusion import DepthView
from nico_selfmodel.estimation.shape.shape_views import ShapeView, ShapeViews
from nico_selfmodel.estimation.shape.standpoints import InMirror
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.sessions.mirrors import learned_shape
from nico_selfmodel.sessions.mirrors.learned_shape import Skeleton, learn_shape
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS

SIGMA = np.array([1e-3, 2e-3, 5e-4])


def views_of(count):
    """Return two pictures of each of some mirrors, which hold the mirror's number."""
    mirrors = [Mirror.from_values([0.01 * k, -0.3, 0.3]) for k in range(count)]
    views = [
        ShapeView(k, side, np.full((1, 1), k), np.full((1, 1), -9.0))
        for k in range(count)
        for side in (0, 1)
    ]
    sigma = np.append(np.outer(np.arange(1.0, count + 1.0), SIGMA).ravel(), 0.7)
    standpoints = tuple(InMirror(one, np.eye(4)) for one in mirrors)
    return ShapeViews(tuple(views), NICO_CAMERAS, standpoints, ("left.fx",), np.diag(sigma**2))


def learned_from(monkeypatch, off, count=8):
    """Return the mirrors of each time a shape was learned, where pictures move one of them."""
    seen = []

    def refined(views, *_):
        numbers = [view.picture.item() for view in views.views[::2]]
        sigma = np.sqrt(np.diag(views.covariance))
        np.testing.assert_allclose(sigma[:-1:3], SIGMA[0] * (np.array(numbers) + 1.0))
        assert sigma[-1] == pytest.approx(0.7)
        assert [view.look for view in views.views] == [k for k in range(len(numbers)) for _ in "lr"]
        seen.append(numbers)
        moved = np.where([number == 3 for number in numbers], off, 0.5)[:, None]
        values = views.values.reshape(-1, 3) + moved * sigma[:-1].reshape(-1, 3)
        return SimpleNamespace(standpoints=tuple(map(Mirror.from_values, values)))

    def first_surface(grid, near, views, depths):
        assert [one.look for one in depths] == list(range(len(views.standpoints)))
        assert [one.depth.item() for one in depths] == [v.picture.item() for v in views.views[::2]]

    depths = [DepthView(k, NICO_CAMERAS.left, np.full((1, 1), k)) for k in range(count)]
    monkeypatch.setattr(learned_shape, "outlined", lambda *_: views_of(count))
    monkeypatch.setattr(learned_shape, "_depths", lambda *_: depths)
    monkeypatch.setattr(learned_shape, "first_surface", first_surface)
    monkeypatch.setattr(learned_shape, "refined", refined)
    monkeypatch.setattr(learned_shape, "links_of", lambda *_: {})
    skeleton = Skeleton(("chest",), np.array([[[0.0, 0.0, 0.8], [0.0, 0.0, 0.801]]]))
    looks, model = SimpleNamespace(shots=()), SimpleNamespace(rig=NICO_CAMERAS)
    found = learn_shape(looks, model, skeleton, {}, ("chest",), np.random.default_rng(0))
    assert len(found.all.standpoints) == len(seen[-1])
    return seen


@pytest.mark.parametrize(("off", "again"), [(2.30, False), (2.35, True)])
def test_it_is_left_out_and_all_is_learned_anew(monkeypatch, off, again):
    first, *rest = learned_from(monkeypatch, off)  # a chi-square of 15.9, and of 16.6
    assert first == list(range(8))
    assert rest == ([[0, 1, 2, 4, 5, 6, 7]] if again else [])


def test_it_stays_where_too_few_would_be_left(monkeypatch):
    assert len(learned_from(monkeypatch, 9.0, count=6)) == 1

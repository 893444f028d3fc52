"""A mirror that pictures move farther than the hand allows tells nothing of a shape."""

from types import MappingProxyType, SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.sessions.mirrors import learned_shape
from nico_selfmodel.sessions.mirrors.learned_shape import Skeleton, learn_shape
from nico_selfmodel.sessions.mirrors.shape_looks import ShapeLooks

SIGMA = np.array([1e-3, 2e-3, 5e-4])


def looks_into(count):
    mirrors = {f"m{k}": Mirror.from_values([0.01 * k, -0.3, 0.3]) for k in range(count)}
    shots = tuple(SimpleNamespace(mirror=name) for name in mirrors)
    covered = tuple((np.full((1, 1), k), np.full((1, 1), k)) for k in range(count))
    return ShapeLooks(MappingProxyType(mirrors), shots, covered, np.zeros((2, 2, 3)), (1.0, 1.0))


def learned_from(monkeypatch, off, count=8):
    """Return the mirrors of each time a shape was learned, where pictures move one of them."""
    seen = []

    def outlined(looks, *_):
        seen.append(tuple(looks.mirrors))
        assert [shot.mirror for shot in looks.shots] == list(looks.mirrors)
        assert [f"m{pair[0].item()}" for pair in looks.covered] == list(looks.mirrors)
        values = np.concatenate([mirror.values for mirror in looks.mirrors.values()])
        covariance = np.diag(np.tile(SIGMA**2, len(looks.mirrors)))
        parts = tuple(slice(3 * k, 3 * k + 3) for k in range(len(looks.mirrors)))
        return SimpleNamespace(values=values, covariance=covariance, views=(), parts=parts)

    def refined(*_):
        moved = np.where([name == "m3" for name in seen[-1]], off, 0.5)[:, None] * SIGMA
        values = [looks.mirrors[name].values for name in seen[-1]] + moved
        return SimpleNamespace(standpoints=tuple(map(Mirror.from_values, values)))

    looks = looks_into(count)
    monkeypatch.setattr(learned_shape, "outlined", outlined)
    monkeypatch.setattr(learned_shape, "_depths", lambda *_: [])
    monkeypatch.setattr(learned_shape, "first_surface", lambda *_: None)
    monkeypatch.setattr(learned_shape, "refined", refined)
    monkeypatch.setattr(learned_shape, "links_of", lambda *_: {})
    skeleton = Skeleton(("chest",), np.array([[[0.0, 0.0, 0.8], [0.0, 0.0, 0.801]]]))
    found = learn_shape(looks, None, skeleton, {}, ("chest",), np.random.default_rng(0))
    assert len(found.all.standpoints) == len(seen[-1])
    return seen


@pytest.mark.parametrize(("off", "again"), [(2.30, False), (2.35, True)])
def test_it_is_left_out_and_all_is_learned_anew(monkeypatch, off, again):
    first, *rest = learned_from(monkeypatch, off)  # a chi-square of 15.9, and of 16.6
    assert len(first) == 8
    assert rest == ([tuple(name for name in first if name != "m3")] if again else [])


def test_it_stays_where_too_few_would_be_left(monkeypatch):
    assert len(learned_from(monkeypatch, 9.0, count=6)) == 1

"""The colours of paints, told by pictures whose brightness is not known."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.mirrors.body_alignment import AlignedView
from nico_selfmodel.estimation.mirrors.paint_colors import DESCRIBED_SIGMA, PaintColors

DESCRIBED = np.array([[0.9, 0.8, 0.7], [0.2, 0.5, 0.6], [0.6, 0.3, 0.3], [0.5, 0.5, 0.5]])
AREA = 1.0


def pictures(real, rng, gains=(1.0, 0.9), noise=1.0, expected=DESCRIBED, even=False):
    """Return views in which three of four paints lie side by side."""
    views = []
    for gain in gains:
        shade = np.linspace(170.0 if even else 120.0, 170.0 if even else 220.0, 60)[:, None]
        shade = shade * np.ones((60, 60))
        paint = np.repeat(np.arange(3), 20)[None] * np.ones((60, 1), int)
        level = [shade[:, :, None] * colors[paint][:, :, ::-1] for colors in (real, expected)]
        seen = gain * level[0] + noise * rng.standard_normal((60, 60, 3))
        used = np.ones((60, 60), bool)
        if even:  # nothing of an edge
            used[:, [19, 20, 39, 40]] = False
        views.append(AlignedView(0, 0, seen, level[1], np.ones((60, 60)), used,
                                 np.zeros((0, 60, 60), bool), paints=paint))  # fmt: skip
    return views


def others(rng):
    return np.clip(DESCRIBED * np.exp(0.1 * rng.standard_normal(DESCRIBED.shape)), 0.0, 1.0)


def shares(found, real):
    """Return what the three paints that are seen are off by, but for a common brightness."""
    each = (found.colors / real)[:3]
    return each / each.mean() - 1.0


@pytest.mark.parametrize("seed", range(3))
def test_colours_are_told_but_for_how_bright_all_of_them_are(seed):
    rng = np.random.default_rng(seed)
    real = others(rng)
    found = PaintColors.by_description(DESCRIBED).seen_in(pictures(real, rng), AREA)
    assert np.abs(shares(found, real)).max() < 0.01
    assert found.sigma[:3].max() < 0.02


def test_of_a_paint_that_is_not_seen_the_description_is_what_is_known():
    rng = np.random.default_rng(3)
    found = PaintColors.by_description(DESCRIBED).seen_in(pictures(others(rng), rng), AREA)
    assert found.colors[3] == pytest.approx(DESCRIBED[3])
    assert found.sigma[3] == pytest.approx(DESCRIBED_SIGMA)


def test_pictures_that_show_no_paint_change_nothing():
    rng = np.random.default_rng(4)
    before = PaintColors.by_description(DESCRIBED)
    nothing = [replace(one, paints=np.full(one.used.shape, -1)) for one in pictures(DESCRIBED, rng)]
    assert before.seen_in(nothing, AREA) is before


def test_brighter_pictures_tell_the_same_colours():
    real = others(np.random.default_rng(5))
    start = PaintColors.by_description(DESCRIBED)
    one, two = (
        start.seen_in(pictures(real, np.random.default_rng(6), gains, 0.0), AREA)
        for gains in ((0.8, 0.9), (1.0, 1.125))
    )
    assert one.colors == pytest.approx(two.colors, rel=2e-3)


def test_what_is_brighter_than_a_pixel_can_be_tells_no_colour():
    rng = np.random.default_rng(7)
    real = others(rng)
    bright = [
        replace(one, seen=np.where(one.seen > 90.0, 255.0, one.seen)) for one in pictures(real, rng)
    ]
    found = PaintColors.by_description(DESCRIBED).seen_in(bright, AREA)
    assert found.colors[0] == pytest.approx(DESCRIBED[0])


def test_a_spot_of_another_colour_does_not_change_a_paint():
    rng = np.random.default_rng(8)
    real = others(rng)
    views = pictures(real, rng)
    for view in views:
        view.seen[10:16, 5:11] = 20.0
    found = PaintColors.by_description(DESCRIBED).seen_in(views, AREA)
    assert np.abs(shares(found, real)).max() < 0.01


def test_sigmas_of_colours_are_what_they_scatter_by():
    real = others(np.random.default_rng(9))
    start = PaintColors.by_description(DESCRIBED)
    found = [
        start.seen_in(pictures(real, np.random.default_rng(s), even=True), AREA) for s in range(40)
    ]
    spread = np.std([shares(one, real) for one in found], axis=0)
    told = np.mean([one.covariance[:3].diagonal(axis1=1, axis2=2) for one in found], axis=0)
    assert 0.7 < np.sqrt(np.mean(spread**2 / told)) < 1.3


def test_the_order_of_paints_does_not_matter():
    rng = np.random.default_rng(10)
    real, order = others(rng), np.array([2, 0, 3, 1])
    views = pictures(real, rng)
    found = PaintColors.by_description(DESCRIBED).seen_in(views, AREA)
    views = [replace(one, paints=np.argsort(order)[one.paints]) for one in views]
    turned = PaintColors.by_description(DESCRIBED[order]).seen_in(views, AREA)
    assert turned.colors == pytest.approx(found.colors[order], rel=1e-9)
    assert turned.covariance == pytest.approx(found.covariance[order], rel=1e-6)


def test_nothing_is_quite_black():
    assert (PaintColors.by_description(np.zeros((1, 3))).colors > 0.0).all()


def test_what_lies_between_edges_is_known_no_better_than_where_these_are():
    rng = np.random.default_rng(11)
    real = others(rng)
    views = pictures(real, rng, gains=(1.0,) * 20)
    narrow = []
    for one in views:
        paints = one.paints.copy()
        paints[:, :19] = -1  # of the first paint only what the next one's edge blurs
        narrow.append(replace(one, paints=paints))
    wide, found = (PaintColors.by_description(DESCRIBED).seen_in(v, AREA) for v in (views, narrow))
    assert found.sigma[0] > 3.0 * wide.sigma[0]
    assert found.sigma[0] > 0.03

"""The middle of a spot: an ellipse fitted to a picture, at edges of colours, where it is cut."""

import numpy as np
import pytest

from nico_selfmodel.vision.surprise.blobs import Blob
from nico_selfmodel.vision.surprise.seen_places import seen_places
from nico_selfmodel.vision.surprise.spot_middle import middle_of
from nico_selfmodel.vision.surprise.surprise import Expectation, Surprise, as_before, surprise

SHAPE, NOISE, RADIUS = (60, 80), 2.0, 4.0
PAINT = np.array([90.0, 120.0, 60.0])


def two_colors(edge):
    """Return a picture of one colour left of a column, and of another right of it."""
    left = np.arange(SHAPE[1]) < edge
    row = np.where(left[:, None], [100.0, 60.0, 150.0], [200.0, 190.0, 180.0])
    return np.tile(row, (SHAPE[0], 1, 1))


def marked(picture, at, rng, slant=1.0):
    """Return a noisy picture with a disc of paint about a place, narrowed along a diagonal."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    along, across = (u - at[0] + v - at[1]) / np.sqrt(2.0), (u - at[0] - v + at[1]) / np.sqrt(2.0)
    share = np.clip(RADIUS + 0.5 - np.hypot(along, across / slant), 0.0, 1.0)[:, :, None]
    seen = (1.0 - share) * picture + share * PAINT + NOISE * rng.standard_normal(picture.shape)
    return np.clip(np.round(seen), 0, 255).astype(np.uint8)


def fitted(at, rng, edge=0, judged=SHAPE[1], sigma=0.25, slant=1.0):
    """Return the spot and the middle that a look at a mark gives."""
    known = np.full(SHAPE, sigma)
    known[:, judged:] = np.nan
    expected = Expectation(two_colors(edge).astype(np.uint8), known, NOISE, 0.01)
    picture = marked(two_colors(edge), at, rng, slant)
    own = surprise(picture, expected)
    spots = [blob for blob, strong in seen_places(own) if strong]
    assert len(spots) == 1
    return spots[0], middle_of(spots[0], picture, [own])


@pytest.mark.slow
@pytest.mark.parametrize("edge", [0, 40, 43])
def test_the_middle_is_where_it_is_and_as_well_known_as_is_said(edge):
    rng = np.random.default_rng(edge)
    off, sigmas = [], []
    for _ in range(40):
        at = np.array([40.0, 30.0]) + rng.uniform(-0.5, 0.5, 2)
        _, middle = fitted(at, rng, edge)
        off.append([middle.u - at[0], middle.v - at[1]])
        sigmas.append(middle.sigma)
    assert np.sqrt(np.mean(np.square(off))) < 0.12
    assert np.max(sigmas) < 0.25
    assert np.mean(np.square(off) / (np.square(sigmas) + 0.08**2)[:, None]) < 1.5


@pytest.mark.slow
def test_a_disc_that_is_seen_at_a_slant_is_an_ellipse_with_the_same_middle():
    rng, off = np.random.default_rng(5), []
    for _ in range(20):
        at = np.array([40.0, 30.0]) + rng.uniform(-0.5, 0.5, 2)
        middle = fitted(at, rng, edge=41, slant=0.4)[1]
        off.append([middle.u - at[0], middle.v - at[1]])
    assert np.sqrt(np.mean(np.square(off))) < 0.2


def test_an_edge_does_not_draw_the_middle_as_it_draws_the_surprise():
    rng = np.random.default_rng(1)
    blob, middle = fitted((40.0, 30.0), rng, edge=42, sigma=2.0)
    assert abs(blob.u - 40.0) > 0.35
    assert middle.u == pytest.approx(40.0, abs=0.2)


def test_a_spot_of_which_a_half_is_judged_is_known_by_less():
    rng = np.random.default_rng(2)
    whole = fitted((40.0, 30.0), rng)[1]
    blob, half = fitted((40.0, 30.0), rng, judged=41)
    assert whole.sigma < 0.2 < half.sigma < 2.0
    assert abs(half.u - 40.0) < 2.5 * half.sigma
    assert abs(half.u - 40.0) < abs(blob.u - 40.0)


def test_an_earlier_picture_tells_the_other_half():
    rng = np.random.default_rng(3)
    known = np.where(np.arange(SHAPE[1]) < 41, 0.25, np.nan) * np.ones(SHAPE)
    under = two_colors(0)
    expected = Expectation(under.astype(np.uint8), known, NOISE, 0.01)
    before, picture = (marked(under, at, rng) for at in ((-50.0, 0.0), (40.0, 30.0)))
    own = surprise(picture, expected)
    rest = surprise(picture, as_before(before, own, NOISE, 0.01))
    ((blob, _),) = [one for one in seen_places(own, rest) if one[1]]
    middle = middle_of(blob, picture, [own, rest])
    assert (middle.u, middle.v) == pytest.approx((40.0, 30.0), abs=0.25)
    assert middle.sigma < 0.2


def test_a_spot_of_nothing_that_is_known_is_known_to_its_radius():
    blob, picture = Blob(40.0, 30.0, 50, 99.0), np.zeros((*SHAPE, 3), np.uint8)
    for parts in ([], [Surprise(np.zeros(SHAPE), 1.0)]):
        middle = middle_of(blob, picture, parts)
        assert (middle.u, middle.v, middle.sigma) == pytest.approx((40.0, 30.0, 3.99), abs=0.01)


def test_a_spot_at_the_edge_of_the_picture_is_fitted_too():
    rng = np.random.default_rng(4)
    _, middle = fitted((2.0, 1.0), rng)
    assert (middle.u, middle.v) == pytest.approx((2.0, 1.0), abs=1.0)


def banded(at, rng):
    """Return what is expected, and a noisy disc across a band that has the colour of its paint."""
    under = np.tile([100.0, 60.0, 150.0], (*SHAPE, 1))
    under[28:33] = PAINT
    under[33:] = PAINT + np.array([0.0, 4.0, 5.0])
    return under.astype(np.uint8), marked(under, at, rng)


def test_a_spot_in_parts_that_no_ellipse_holds_is_where_most_of_it_is_and_known_to_half():
    rng = np.random.default_rng(6)
    under, picture = banded((40.0, 30.0), rng)
    own = surprise(picture, Expectation(under, np.full(SHAPE, 0.25), NOISE, 0.01))
    blob = Blob(40.0, 26.5, 20, 99.0, ((40.0, 26.0), (40.0, 41.0)))
    middle = middle_of(blob, picture, [own])
    assert (middle.u, middle.v, middle.sigma) == pytest.approx((40.0, 26.5, 7.5))


def test_parts_that_one_ellipse_holds_are_fitted_as_one():
    rng = np.random.default_rng(7)
    under, picture = two_colors(0).astype(np.uint8), marked(two_colors(0), (40.0, 30.0), rng)
    own = surprise(picture, Expectation(under, np.full(SHAPE, 0.25), NOISE, 0.01))
    ((blob, _),) = [one for one in seen_places(own) if one[1]]
    parts = Blob(blob.u, blob.v, blob.area, 99.0, ((39.0, 28.0), (41.0, 32.0)))
    assert middle_of(parts, picture, [own]) == middle_of(blob, picture, [own])


def test_paint_that_looks_otherwise_beyond_an_edge_is_a_part_of_the_spot():
    off = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        under = np.tile([100.0, 60.0, 150.0], (*SHAPE, 1))
        under[:, 39:] = PAINT - 20.0
        picture = marked(under, (40.0, 30.0), rng).astype(float)
        shaded = marked(under, (99.0, 99.0), rng).astype(float)
        v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
        shaded[np.hypot(u - 40.0, v - 30.0) < RADIUS] -= 7.0
        picture[:, 39:] = shaded[:, 39:]
        picture = picture.astype(np.uint8)
        own = surprise(
            picture, Expectation(under.astype(np.uint8), np.full(SHAPE, 0.25), NOISE, 0.01)
        )
        ((blob, _),) = [one for one in seen_places(own) if one[1]]
        middle = middle_of(blob, picture, [own])
        assert middle.sigma > 1.0
        off.append(np.hypot(middle.u - 40.0, middle.v - 30.0) / middle.sigma)
    assert 0.1 < np.sqrt(np.mean(np.square(off))) < 1.5

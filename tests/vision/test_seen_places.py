"""Places of one picture: those of the own body and those beside it are one picture."""

import numpy as np
import pytest

from nico_selfmodel.optimization.chi_square import chi_square_tail
from nico_selfmodel.vision.surprise.blobs import Blob, surprising_places, threshold_of
from nico_selfmodel.vision.surprise.seen_places import (
    all_judged,
    beyond_chance,
    nothing_at,
    reaches,
    seen_places,
    spots_at,
)
from nico_selfmodel.vision.surprise.surprise import Surprise

SHAPE = (80, 100)
BODY = np.arange(100)[None] < 50


def pictures(*spots, height=100.0, calm=1.0):
    """Return what the body and what the room differs by: discs of radius 6 about some places."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    all_of_it = np.full(SHAPE, calm)
    for at in spots:
        all_of_it[np.hypot(u - at[0], v - at[1]) < 6.0] = height
    body = np.broadcast_to(BODY, SHAPE)
    return Surprise(np.where(body, all_of_it, np.nan), 1.0), Surprise(
        np.where(body, np.nan, all_of_it), 1.0
    )


def test_a_spot_half_on_the_body_and_half_beside_it_is_one_with_its_true_middle():
    own, rest = pictures((50.0, 40.0))
    ((blob, sure),) = seen_places(own, rest)
    assert sure
    assert (blob.u, blob.v) == pytest.approx((50.0, 40.0), abs=0.6)
    half = surprising_places(own)[0]
    assert half.u < 48.0


def test_the_more_surprising_half_does_not_draw_the_middle_to_itself():
    own, rest = pictures((50.0, 40.0), calm=0.1)
    bright = Surprise(np.where(np.isfinite(rest.chi_square), 40.0 * rest.chi_square, np.nan), 1.0)
    ((blob, _),) = seen_places(own, bright)
    assert blob.u == pytest.approx(50.0, abs=1.2)


def test_without_an_earlier_picture_only_the_body_is_judged():
    own, _ = pictures((80.0, 40.0))
    assert seen_places(own) == []


def test_weak_places_are_told_but_are_not_sure():
    places = int(BODY.sum()) * SHAPE[0]
    between = 0.5 * (threshold_of(places, 1.0) + threshold_of(places))
    own, _ = pictures((25.0, 40.0), height=between)
    ((_, sure),) = seen_places(own)
    assert not sure
    assert seen_places(pictures((25.0, 40.0), height=threshold_of(places, 2.0))[0]) == []


def test_what_other_pictures_show_too_is_sure():
    own, _ = pictures((25.0, 40.0), height=12.0)
    assert seen_places(own) == []
    shared = np.zeros(SHAPE, dtype=bool)
    shared[37:44, 22:29] = True
    ((blob, sure),) = seen_places(own, None, shared)
    assert sure
    assert (blob.u, blob.v) == pytest.approx((25.0, 40.0), abs=0.3)


def test_less_is_weakly_surprising_where_another_camera_says_to_look():
    height = 14.0
    assert threshold_of(int(BODY.sum()) * SHAPE[0], 1.0) > height > threshold_of(113, 1.0)
    own, _ = pictures((25.0, 40.0), height=height)
    assert seen_places(own) == []
    ((blob, sure),) = seen_places(own, where=[(27.0, 41.0)])
    assert not sure
    assert (blob.u, blob.v) == pytest.approx((25.5, 40.2), abs=0.8)
    assert seen_places(own, where=[(40.0, 40.0)]) == []
    faint, _ = pictures((25.0, 40.0), height=11.0)
    assert seen_places(faint, where=[(27.0, 41.0)]) == []


def test_less_surprises_on_the_body_than_among_all_that_is_beside_it():
    body = np.hypot(*(np.mgrid[: SHAPE[0], : SHAPE[1]] - [[[40.0]], [[50.0]]])) < 15.0
    height = 27.0
    assert threshold_of(int(body.sum())) < height < threshold_of(int((~body).sum()))
    own = Surprise(np.full(SHAPE, np.nan), 1.0)
    for place, there in (((40, 50), True), ((10, 10), False)):
        changed = np.ones(SHAPE)
        changed[place] = height
        ((_, sure),) = seen_places(own, Surprise(changed, 1.0), body=body)
        assert sure is there


@pytest.mark.parametrize(("each", "beyond"), [(25.3, True), (24.8, False)])
def test_places_of_two_pictures_are_beyond_chance_together_before_each_is_alone(each, beyond):
    places = 20000
    assert each < threshold_of(places)
    bound = 2.0 * each
    assert (places * 113 * chi_square_tail(bound, 6) < 0.01) is beyond
    assert beyond_chance(Blob(5.0, 5.0, 9, each), Blob(7.0, 5.0, 1, each), places) is beyond


@pytest.mark.parametrize(("each", "beyond"), [(37.8, True), (37.3, False)])
def test_what_is_wrong_alike_in_two_pictures_is_told_once(each, beyond):
    """Of a covariance half of which is alike equal differences tell two thirds as much."""
    pair = Blob(5.0, 5.0, 9, each), Blob(7.0, 5.0, 1, each)
    assert beyond_chance(*pair, 20000, alike=0.5) is beyond
    e, noise, alike = np.sqrt(each / 3.0) * np.ones(3), 0.5 * np.eye(3), 0.5 * np.eye(3)
    covariance = np.block([[noise + alike, alike], [alike, noise + alike]])
    both = np.concatenate([e, e])
    told = both @ np.linalg.solve(covariance, both)
    assert told == pytest.approx(2.0 * each / 1.5)
    assert (20000 * 113 * chi_square_tail(told, 6) < 0.01) is beyond


@pytest.mark.slow
def test_noise_of_two_pictures_beside_the_body_surprises_in_one_of_a_hundred():
    rng = np.random.default_rng(7)
    own = Surprise(np.full(SHAPE, np.nan), 1.0)
    seen = [seen_places(own, Surprise(rng.chisquare(3.0, SHAPE), 1.0)) for _ in range(200)]
    assert sum(any(sure for _, sure in one) for one in seen) <= 5
    assert sum(map(len, seen)) <= 400


def test_near_places_are_one_and_far_ones_are_not():
    assert len(seen_places(pictures((15.0, 40.0), (35.0, 40.0))[0])) == 2
    own, _ = pictures()
    chi = np.array(own.chi_square)
    chi[38:43, 20:23] = chi[38:43, 25:28] = 100.0
    ((blob, _),) = seen_places(Surprise(chi, 1.0))
    assert blob.u == pytest.approx(23.5, abs=0.5)


def test_pictures_of_two_shapes_are_not_joined():
    own, _ = pictures()
    with pytest.raises(ValueError, match="one shape"):
        own.beside(Surprise(np.zeros((2, 2)), 1.0))


def test_a_place_is_looked_at_where_two_places_about_it_are_judged():
    own, _ = pictures()
    assert all_judged(own, 47.0, 40.0)
    assert not all_judged(own, 48.0, 40.0)
    assert not all_judged(own, 200.0, 40.0)


@pytest.mark.parametrize(("height", "apart", "parts"), [(23.0, 4, 2), (20.0, 4, 0), (23.0, 9, 0)])
def test_what_is_faint_is_a_part_of_a_spot_only_if_it_is_near_to_it(height, apart, parts):
    places = np.ones((400, 500))
    places[40, 50], places[40 + apart, 50] = 90.0, height
    ((blob, sure),) = seen_places(Surprise(places, 1.0))
    assert sure
    assert height < threshold_of(places.size, 1.0)
    assert len(blob.parts) == parts
    assert (blob.area, blob.v) == pytest.approx((2, 40.8) if parts else (1, 40.0), abs=0.1)


def test_a_place_shows_nothing_where_it_is_judged_and_not_even_weakly_surprising():
    own, _ = pictures((20.0, 40.0))
    assert [(round(one.u), round(one.v)) for one in spots_at(own, 23.0, 42.0)] == [(20, 40)]
    assert not spots_at(own, 27.0, 42.0)
    assert not nothing_at(own, 27.0, 42.0)  # its outer part is within 6 px
    assert nothing_at(own, 35.0, 42.0)
    assert not nothing_at(own, 49.0, 42.0)  # what is beside the body is not judged
    # The threshold: n places within 6 px, one of which is as surprising by chance.
    about = int((np.hypot(*(np.mgrid[-6:7, -6:7])) < 6.0).sum())
    weak = threshold_of(about, 1.0)
    for height, nothing in ((weak - 0.1, True), (weak + 0.1, False)):
        faint, _ = pictures((20.0, 40.0), height=height)
        assert nothing_at(faint, 20.0, 40.0) is nothing


@pytest.mark.parametrize(("column", "near"), [(40.0, True), (48.0, True), (50.0, False)])
def test_a_spot_at_an_outline_reaches_what_its_middle_is_beside(column, near):
    """It reaches 3 px: to within 6 px of what ends at column 40."""
    shown = np.zeros((60, 80), dtype=bool)
    shown[:, :41] = True
    assert reaches(Blob(column, 30.0, 28, 50.0, reach=3.0), shown) is near
    assert not reaches(Blob(column, 30.0, 28, 50.0, reach=3.0), np.zeros_like(shown))


@pytest.mark.parametrize(("radius", "parts"), [(2.0, 2), (7.0, 1)])
def test_parts_of_a_large_spot_lie_farther_apart_than_those_of_a_small_one(radius, parts):
    """Something like what is under it, 9 px from the middle of a disc to that of a part of it."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    disc = np.hypot(u - 20.0, v - 40.0) < radius
    part = np.hypot(u - 29.0, v - 40.0) < 1.5
    body = np.broadcast_to(np.arange(SHAPE[1])[None] < 50, SHAPE)
    seen = Surprise(np.where(body, np.where(disc | part, 100.0, 1.0), np.nan), 1.0)
    assert len(seen_places(seen)) == parts
    assert surprising_places(seen)[-1].reach < 2.0

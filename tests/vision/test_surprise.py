"""What a picture shows that was not expected: marks, and neither light nor a pixel aside."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.optimization.chi_square import chi_square_tail
from nico_selfmodel.vision.surprise.blobs import FALSE_ALARM, surprising_places, threshold_of
from nico_selfmodel.vision.surprise.surprise import (
    Expectation,
    about_the_loose,
    as_before,
    away_from_the_unknown,
    log_likelihood,
    surprise,
)

NOISE = 2.0


def checks(shift=0.0):
    """Return a picture of soft stripes of two colours, moved along u by some pixels."""
    u = np.arange(160) - shift
    share = 0.5 + 0.5 * np.tanh(2.0 * np.sin(2.0 * np.pi * u / 40.0))
    row = share[:, None] * [200.0, 180.0, 60.0] + (1.0 - share[:, None]) * [40.0, 90.0, 150.0]
    return np.tile(row, (120, 1, 1))


def expected(sigma=1.0):
    return Expectation(np.round(checks()).astype(np.uint8), np.full((120, 160), sigma), NOISE, 0.02)


def seen(picture, rng):
    noisy = picture + NOISE * rng.standard_normal(picture.shape)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


@pytest.mark.slow
def test_what_was_expected_does_not_surprise():
    rng = np.random.default_rng(1)
    found = [surprise(seen(checks(), rng), expected()) for _ in range(30)]
    assert [surprising_places(one) for one in found] == [()] * 30
    # Shares of what is not known of place and colour make it less than the three of pure noise.
    assert 0.2 < np.mean([np.nanmean(one.chi_square) for one in found]) < 3.2


def test_pure_noise_is_a_chi_square_of_three():
    rng = np.random.default_rng(2)
    flat = np.full((120, 160, 3), 100.0)
    known = Expectation(flat.astype(np.uint8), np.zeros((120, 160)), NOISE, 0.0)
    found = surprise(seen(flat, rng), known).chi_square
    assert np.nanmean(found) == pytest.approx(3.0, rel=0.05)
    # The outermost pixels have no 3 x 3 about them.
    assert np.isfinite(found[1:-1, 1:-1]).all()
    assert np.isnan(found[0]).all()


@pytest.mark.parametrize(("share", "alike"), [(0.0, 0.0), (0.01, 0.6923), (0.04, 0.973)])
def test_what_is_no_noise_of_a_place_is_wrong_in_all_pictures_alike(share, alike):
    """Noise of 2 levels is 2 / 3 in the mean of nine pixels; 1 % of 100 is one level in each."""
    flat = np.full((120, 160, 3), 100.0)
    known = Expectation(flat.astype(np.uint8), np.zeros((120, 160)), NOISE, share)
    found = surprise(seen(flat, np.random.default_rng(2)), known)
    assert found.share_alike(80.3, 60.8) == pytest.approx(alike, abs=0.01)
    assert found.share_alike(0.0, 60.0) == 0.0  # the outermost pixels are not judged
    parts = found.alike(np.arange(len(found.covariance)))
    assert (np.linalg.eigvalsh(parts) > -1e-9).all()
    assert found.covariance[7] - parts[7] == pytest.approx(
        (NOISE**2 + 1.0 / 12.0) / 9.0 * np.eye(3), abs=1e-9
    )
    with pytest.raises(ValueError, match="no covariances"):
        replace(found, covariance=None).alike(np.arange(3))


@pytest.mark.parametrize(
    ("less", "surprises"), [([0.9, 0.9, 0.9], False), ([1.0, 1.0, 0.78], True)]
)
def test_what_is_turned_to_the_light_is_darker_in_all_colours_alike(less, surprises):
    """A sleeve that may be a twentieth darker is not expected to lose a fifth of its red alone."""
    flat = np.tile([104.0, 100.0, 116.0], (40, 60, 1))
    known = Expectation(flat.astype(np.uint8), np.zeros((40, 60)), NOISE, 0.01)
    spot = np.zeros((40, 60, 1))
    spot[15:25, 20:30] = 1.0
    dark = flat * (1.0 - spot * (1.0 - np.array(less)))
    picture = seen(dark, np.random.default_rng(4))
    for light, alarms in ((0.05, surprises), (0.0, True)):
        found = surprise(picture, replace(known, light_sigma=light))
        assert bool(surprising_places(found)) is alarms
    # A share of each colour by itself, as large, would miss both.
    assert not surprising_places(surprise(picture, replace(known, appearance_sigma=0.06)))


def test_each_place_has_a_share_of_its_own():
    picture = np.tile(np.linspace(20.0, 220.0, 160)[:, None], (120, 1, 3))
    known = Expectation(picture.astype(np.uint8), np.zeros((120, 160)), NOISE, 0.01)
    found = surprise(picture.astype(np.uint8), known)
    shares = np.array([found.share_alike(u, 30.0) for u in range(1, 159)])
    assert (np.diff(shares) > -1e-6).all()
    assert shares[0] < 0.2 < 0.8 < shares[-1]


@pytest.mark.parametrize("light", [0.9, 1.0, 1.1])
def test_light_is_found_and_does_not_surprise(light):
    found = surprise(seen(light * checks(), np.random.default_rng(3)), expected())
    assert found.gain == pytest.approx(light, abs=0.01)
    assert surprising_places(found) == ()


def test_an_edge_a_pixel_aside_surprises_only_who_is_sure_of_its_place():
    picture = seen(checks(1.5), np.random.default_rng(4))
    assert surprising_places(surprise(picture, expected(1.5))) == ()
    assert len(surprising_places(surprise(picture, expected(0.25)))) > 3


def test_a_mark_is_found_where_it_is():
    picture = checks()
    picture[60:65, 79:84] += [0.0, 51.0, 0.0]
    found = surprising_places(surprise(seen(picture, np.random.default_rng(5)), expected()))
    assert len(found) == 1
    assert (found[0].u, found[0].v) == pytest.approx((81.0, 62.0), abs=0.5)
    assert found[0].area >= 9
    assert found[0].chi_square > threshold_of(160 * 120)


def test_a_faint_mark_is_found_where_only_noise_hides_it():
    picture = np.full((120, 160, 3), 8.0)
    known = Expectation(picture.astype(np.uint8), np.zeros((120, 160)), NOISE, 0.02)
    picture[60:66, 78:84] += 3.0
    found = surprising_places(surprise(seen(picture, np.random.default_rng(7)), known))
    assert len(found) == 1
    assert (found[0].u, found[0].v) == pytest.approx((80.5, 62.5), abs=1.0)


def test_what_neighbours_have_alike_does_not_become_less_in_their_mean():
    flat = np.full((120, 160, 3), 100.0)
    known = Expectation(flat.astype(np.uint8), np.zeros((120, 160)), 0.1, 0.02)
    bluer = flat + np.array([6.0, 0.0, 0.0])
    found = surprise(bluer.astype(np.uint8), known)
    # Three sigma of the colour, whatever the gain; noise and rounding hardly add to it.
    assert 5.0 < np.nanmean(found.chi_square) < 9.5


def test_beside_an_edge_the_pixels_that_lie_off_it_tell():
    """A plain mean would have all of what the edge may be off by, and paint would be hidden."""
    half = np.where(np.arange(160) < 80, 40.0, 200.0)[:, None] * np.ones((120, 1, 3))
    known = Expectation(half.astype(np.uint8), np.full((120, 160), 0.3), NOISE, 0.0)
    half[60:66, 74:79] += [0.0, 12.0, 0.0]
    found = surprise(seen(half, np.random.default_rng(10)), known)
    assert found.chi_square[62, 78] > threshold_of(160 * 120)
    judged = int(np.isfinite(found.chi_square[:62]).sum()) + 78 - 1
    sigma = np.sqrt(found.covariance[judged, 1, 1])
    assert NOISE / 3.0 < sigma < 1.5


def test_light_that_is_less_well_known_in_one_place_surprises_less_there():
    flat = np.full((120, 160, 3), 100.0)
    share = np.where(np.arange(160) < 40, 0.04, 0.01) * np.ones((120, 1))
    known = Expectation(flat.astype(np.uint8), np.zeros((120, 160)), 0.1, share)
    flat[:30] += 6.0
    found = surprise(flat.astype(np.uint8), known).chi_square
    assert np.nanmean(found[:28, :38]) < 8.0 < 60.0 < np.nanmean(found[:28, 42:])


def test_an_earlier_picture_tells_what_the_body_does_not():
    rng = np.random.default_rng(8)
    nothing = np.full((120, 160), np.nan)
    nothing[:, :80] = 1.0
    own = surprise(seen(checks(), rng), replace(expected(), pixel_sigma=nothing))
    before = as_before(seen(checks(), rng), own, NOISE, 0.01)
    rest = surprise(seen(checks(), rng), before)
    both = own.beside(rest)
    judged = np.isfinite(both.chi_square)
    each = np.full((2, *judged.shape), np.nan)
    told = np.linalg.solve(both.covariance, both.off[:, :, None])[:, :, 0]
    each[0, judged], each[1] = np.sum(both.off * told, axis=1), both.chi_square
    assert np.allclose(each[0], each[1], equal_nan=True)  # rows are of their own places
    assert np.isfinite(both.chi_square[1:-1, 1:-1]).all()
    assert np.isnan(rest.chi_square[:, :79]).all()
    assert surprising_places(rest) == ()


@pytest.mark.parametrize("moved", [0.05, 0.13, 0.25, 0.375, 1.0])
def test_a_gradient_counts_by_the_displacement_that_is_meant_however_small(moved):
    u = np.tile(20.0 + 2.0 * np.arange(100), (40, 1))
    ramp = np.stack([u, 0.5 * u, 0.0 * u], axis=2).astype(np.uint8)
    known = Expectation(ramp, np.full((40, 100), moved), NOISE, 0.0)
    covariance = surprise(ramp, known).covariance.reshape(-1, 3, 3)[1000]
    noise = (NOISE**2 + 1.0 / 12.0) / 9.0
    G = np.array([2.0, 1.0, 0.0])
    V = moved**2 * np.outer(G, G)
    assert covariance == pytest.approx(V + (noise + 0.15**2 / 3.0 * np.trace(V)) * np.eye(3), 0.05)


def test_paint_of_the_same_colour_moves_an_outline_and_does_not_surprise():
    rng = np.random.default_rng(9)
    nothing = np.full((120, 160), np.nan)
    nothing[:, :1] = 1.0
    own = surprise(seen(checks(), rng), replace(expected(), pixel_sigma=nothing))
    before, now = seen(checks(), rng), seen(checks(0.25), rng)
    sharp, thick = (surprise(now, as_before(before, own, NOISE, 0.01, s)) for s in (0.0, 0.25))
    assert surprising_places(sharp)
    assert surprising_places(thick) == ()


def test_the_threshold_follows_from_the_number_of_places():
    for places in (1, 1000, 40000):
        assert places * chi_square_tail(threshold_of(places), 3) == pytest.approx(FALSE_ALARM)


def test_nothing_is_judged_beside_the_unknown():
    sigma = np.full((40, 40), 1.0)
    sigma[:, 20:] = np.nan
    kept = away_from_the_unknown(sigma)
    # 2.5 pixels rounded up, and one.
    assert np.isfinite(kept[:, :16]).all()
    assert np.isnan(kept[:, 16:]).all()
    nothing = np.full((4, 4), np.nan)
    assert np.isnan(away_from_the_unknown(nothing)).all()


def test_what_is_sure_of_its_place_is_judged_nearer_to_the_unknown():
    sigma = np.full((40, 40), 2.0)
    sigma[:20], sigma[:, 20:] = 0.5, np.nan
    kept = away_from_the_unknown(sigma)
    assert np.isfinite(kept[:19, 16]).all()
    assert np.isnan(kept[20:, 16]).all()


@pytest.mark.slow
def test_the_likeliest_sigma_is_the_one_that_pictures_have():
    rng = np.random.default_rng(6)
    sigmas = (0.25, 0.5, 1.0, 2.0)
    likely = np.zeros(len(sigmas))
    for _ in range(20):
        picture = seen(checks(1.0 * rng.standard_normal()), rng)
        likely += [np.nansum(log_likelihood(picture, expected(sigma))) for sigma in sigmas]
    assert sigmas[int(np.argmax(likely))] == 1.0


def test_places_may_be_weaker_where_more_of_them_may_be_by_chance():
    assert threshold_of(1000, 1.0) < threshold_of(1000) < threshold_of(1000, 1e-4)


def test_what_cannot_be_compared_is_refused():
    with pytest.raises(ValueError, match="was expected, got"):
        surprise(np.zeros((2, 2, 3), np.uint8), expected())
    with pytest.raises(ValueError, match="nothing of the picture"):
        surprise(checks().astype(np.uint8), expected(np.nan))
    with pytest.raises(ValueError, match=r"shapes \(h, w, 3\)"):
        Expectation(np.zeros((2, 2, 3), np.uint8), np.zeros((3, 3)), 1.0, 0.0)
    for name in ("appearance_sigma", "light_sigma"):
        with pytest.raises(ValueError, match=rf"{name} must be a number or have shape \(2, 2\)"):
            replace(
                Expectation(np.zeros((2, 2, 3), np.uint8), np.zeros((2, 2)), 1.0, 0.0),
                **{name: np.zeros(3)},
            )


def test_what_was_found_cannot_be_changed():
    found = surprise(checks().astype(np.uint8), expected())
    with pytest.raises(ValueError, match="read-only"):
        found.chi_square[0, 0] = 0.0


def test_nothing_is_expected_to_be_brighter_than_a_pixel_can_be():
    rng = np.random.default_rng(9)
    bright = expected()
    bright = replace(bright, picture=np.clip(bright.picture.astype(float) + 60.0, 0, 255))
    most = 0.8 * bright.picture.max()  # what a mirror throws back of the brightest
    picture = seen(np.minimum(bright.picture, most), rng)
    assert (bright.picture > most + 20.0).any()
    found = surprise(picture, bright)
    assert found.gain == pytest.approx(1.0, abs=0.05)
    assert np.nanmax(found.chi_square[bright.picture.max(axis=2) > most + 20.0]) < 30.0


def test_a_body_in_a_dark_picture_is_not_expected_to_be_dark():
    """Its bright places stay brighter than the rest of it, however dark all of a picture is."""
    rng = np.random.default_rng(10)
    one = expected()
    grey = np.repeat(one.picture[:, :, :1], 3, axis=2)  # 40 to 200
    found = surprise(seen(np.full(grey.shape, 90.0), rng), replace(one, picture=grey))
    bright = grey[:, :, 0] == grey.max()
    assert found.gain * grey.max() > 110.0
    assert np.nanmedian(found.chi_square[bright]) > 100.0


def test_what_is_loose_may_be_seen_about_it_the_farther_the_less_it_is_known():
    sigma = np.full((40, 60), np.nan)
    sigma[20, 10], sigma[20, 40] = 4.0, 1.0
    found = about_the_loose(sigma)
    rows, columns = np.nonzero(found)
    near = columns < 25
    assert (columns[near].min(), columns[near].max()) == (0, 21)  # 2.5 sigma and a pixel
    assert (rows[near].min(), rows[near].max()) == (9, 31)
    assert (columns[~near].min(), columns[~near].max()) == (36, 44)
    assert not about_the_loose(np.full((40, 60), np.nan)).any()

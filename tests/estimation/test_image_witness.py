"""A mirror, a picture and another are told apart by where the hand is seen in them."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.estimation.contingency import image_witness
from nico_selfmodel.estimation.contingency.contingency import ODDS
from nico_selfmodel.estimation.contingency.image_witness import (
    ANOTHER,
    CANNOT_TELL,
    MIRROR,
    PICTURE,
    HandImages,
    tell_image,
)
from nico_selfmodel.estimation.mirrors.reflection_sigma import reflection_sigma
from nico_selfmodel.estimation.noise.pose_noise import POSE_NOISE
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.optimization.chi_square import chi_square_tail

from ..slow_rest import slow_rest
from .mirror_scenes import CHAIN, JOINTS, RIG, SERVOS, SIZE, body

PLACE = Mirror.from_values([*np.radians([6.0, -9.0]), 0.36])
PLAY = np.radians(0.5)
"""Half the width of the joints' noise."""
NEAR = np.array([0.0, 0.5, 0.0, -0.4])


def in_mirror(p):
    return MirrorRig(RIG, PLACE).project(p)


def on_screen(p, deep=0.0):
    """Return pixels of a picture of the reflection on a screen in the mirror's place.

    A share `deep` of the way to where the reflection would be, points lie behind the screen.
    """
    viewer = np.array([0.03, 0.01, 0.1])
    behind = PLACE.reflect(p)
    plane = PLACE.plane_in(np.eye(4))
    before, after = plane.distance_to(viewer), plane.distance_to(behind)
    share = (before / (before - after))[:, None]
    share = share + deep * (1.0 - share)
    return RIG.project(viewer + share * (behind - viewer))


def twin(p):
    """Return pixels of the same hand of who stands opposite, and is no mirror image."""
    X = transform(rotation_from_vector([0.0, np.pi, 0.0]), [0.1, 0.0, 0.9])
    return RIG.project(apply(X, p))


def seen(shows, count=12, seed=0, mirrored=True, wide=1.0, own_play=False):
    """Return what both cameras see in so many poses; `own_play`: its joints err by themselves."""
    rng = np.random.default_rng((seed, 5))
    q = rng.uniform(-wide, wide, (4000, 4)) + NEAR
    shown = PLACE.in_front_by(CHAIN.forward(q)) > 0.02
    p = CHAIN.forward(q + rng.uniform(-PLAY, PLAY, q.shape))
    pixels = shows(CHAIN.forward(q + rng.uniform(-PLAY, PLAY, q.shape)) if own_play else p)
    shown &= np.isfinite(pixels).all(axis=1) & (np.abs(pixels - 300.0) < 280.0).all(axis=1)
    q, pixels, own = q[shown][:count], pixels[shown][:count], RIG.project(p[shown][:count])
    assert len(q) == count
    return HandImages(
        tuple(JointInfo(name, "rad") for name in JOINTS),
        "hand",
        SERVOS.to_encoder(q),
        pixels + rng.normal(0.0, 0.3, pixels.shape),
        np.full(count, mirrored),
        own + rng.normal(0.0, 0.3, own.shape),
    )


def who_knows_its_play(**changes):
    """Return the body, which knows how much its joints err."""
    sigma = np.full(4, PLAY / np.sqrt(3.0)).tolist()
    return body(fit={POSE_NOISE: {"sensor_sigma": 2e-4, "joint_sigma_rad": sigma}}, **changes)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shows", "mirrored", "verdict"),
    [(in_mirror, True, MIRROR), (on_screen, True, PICTURE), (twin, False, ANOTHER)],
)
def test_each_is_told_in_every_one_of_ten_recordings(shows, mirrored, verdict):
    told = [tell_image(seen(shows, seed=s, mirrored=mirrored), body()) for s in range(10)]
    assert [one.verdict for one in told] == [verdict] * 10


def test_a_picture_that_is_not_turned_round_is_a_picture_too():
    assert tell_image(seen(on_screen, mirrored=False), body()).verdict == PICTURE


def test_a_picture_is_flat_to_its_noise_and_no_mirror_explains_it():
    told = tell_image(seen(on_screen), body())
    assert told.depth_mm < 1.5 * told.depth_sigma_mm
    assert told.mirror_px > 5.0


def test_what_is_half_as_deep_as_a_mirror_shows_it_is_neither_picture_nor_mirror():
    assert tell_image(seen(lambda p: on_screen(p, 0.5)), body()).verdict == CANNOT_TELL


@pytest.mark.parametrize(
    ("shows", "mirrored"), [(in_mirror, True), (on_screen, True), (twin, False)]
)
def test_a_hand_that_hardly_moves_is_no_picture(shows, mirrored):
    told = tell_image(seen(shows, mirrored=mirrored, wide=0.05), body())
    assert told.hand_mm < told.depth_sigma_mm
    assert told.verdict != PICTURE


def test_who_is_turned_round_and_stands_elsewhere_is_not_taken_for_a_mirror():
    assert tell_image(seen(twin), body()).verdict == CANNOT_TELL


@pytest.mark.parametrize("count", [0, 4])
def test_few_looks_tell_nothing(count):
    told = tell_image(
        HandImages(
            (),
            "hand",
            np.zeros((count, 4)),
            np.zeros((count, 4)),
            np.ones(count, bool),
            np.zeros((count, 4)),
        ),
        body(),
    )
    assert (told.verdict, told.looks) == (CANNOT_TELL, count)
    assert np.isnan(told.mirror_px)
    assert np.isfinite(tell_image(seen(on_screen, count=5), body()).depth_mm)


def test_points_of_a_picture_scatter_by_the_noise_of_the_pixels():
    told = tell_image(seen(on_screen, count=80), body())
    assert 0.8 < told.depth_mm / told.depth_sigma_mm < 1.25


@pytest.mark.parametrize(
    ("by_chance", "deep", "mirror_px", "verdict"),
    [
        (1.2e-3, 61.0, 1.0, PICTURE),
        (1.2e-3, 59.0, 1.0, CANNOT_TELL),
        (0.8e-3, 61.0, 4.9, MIRROR),
        (0.8e-3, 61.0, 5.1, CANNOT_TELL),
    ],
)
def test_an_image_is_told_by_three_bounds(monkeypatch, by_chance, deep, mirror_px, verdict):
    images = seen(in_mirror)
    p_WH = body().points(body().servos.to_joint(images.readings))
    hand = Plane.from_points(p_WH).distance_to(p_WH)
    sigma = np.full(len(hand), np.sqrt(np.sum(hand**2) / deep))
    # The chi-square of nine degrees of freedom that chance exceeds as often.
    grid = np.linspace(20.0, 40.0, 4001)
    square = np.interp(-by_chance, [-chi_square_tail(x, len(hand) - 3) for x in grid], grid)
    off = sigma * np.sqrt(square / len(hand))
    monkeypatch.setattr(image_witness, "_off_plane", lambda images, model: (off, sigma))
    monkeypatch.setattr(image_witness, "_by_mirror", lambda images, model: (mirror_px, 0.0))
    assert tell_image(images, body()).verdict == verdict


@pytest.mark.parametrize("seeds", slow_rest([range(2), range(2, 6)]))
def test_who_stands_where_a_mirror_image_would_has_joints_that_err_otherwise(seeds):
    told = [tell_image(seen(in_mirror, seed=s), who_knows_its_play()) for s in seeds]
    assert {one.verdict for one in told} == {MIRROR}
    assert min(one.shared for one in told) > np.log(ODDS)
    told = [tell_image(seen(in_mirror, seed=s, own_play=True), who_knows_its_play()) for s in seeds]
    assert {one.verdict for one in told} == {ANOTHER}
    assert max(one.mirror_px for one in told) < 5.0


def test_joints_that_hardly_err_and_a_hand_out_of_view_tell_neither():
    images = seen(in_mirror, own_play=True)
    still = {POSE_NOISE: {"sensor_sigma": 2e-4, "joint_sigma_rad": [1e-6] * 4}}
    assert tell_image(images, body(fit=still)).shared == pytest.approx(0.0, abs=0.1)
    unseen = replace(images, own=np.full_like(images.own, np.nan))
    told = tell_image(unseen, who_knows_its_play())
    assert (told.verdict, told.shared) == (MIRROR, 0.0)
    assert np.isnan(tell_image(images, body()).shared)


@pytest.mark.parametrize(("odds", "verdict"), [(0.99, MIRROR), (1.01, ANOTHER)])
def test_a_mirror_is_ruled_out_by_odds_of_ten_thousand(monkeypatch, odds, verdict):
    shared = -odds * np.log(ODDS)
    monkeypatch.setattr(image_witness, "_by_mirror", lambda images, model: (1.0, shared))
    assert tell_image(seen(in_mirror), body()).verdict == verdict


def test_no_look_alone_says_more_than_three():
    images = seen(in_mirror)
    wild = images.own + 50.0 * (np.arange(12) == 6)[:, None]
    told = tell_image(replace(images, own=wild), who_knows_its_play())
    whole = tell_image(images, who_knows_its_play())
    assert 4.0 < whole.shared - told.shared <= 6.0


def test_pixels_beyond_where_a_lens_has_rays_are_not_judged():
    folding = Camera(300.0, 300.0, 320.0, 240.0, SIZE, k1=-0.3)
    depth = np.full(SIZE[::-1], 0.9)
    ways = np.array([[320.0, 240.0], [0.0, 0.0]])
    assert folding.has_rays(ways).tolist() == [True, False]
    behind = Mirror.from_values([0.0, 0.0, 0.4])
    sigma = reflection_sigma(StereoRig(folding, folding), behind, 0, depth, 1e-3)
    assert np.isfinite(sigma[240, 320])
    assert np.isnan(sigma[0, 0])

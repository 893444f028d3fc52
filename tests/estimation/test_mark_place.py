"""Spots that both cameras see: on the body in a mirror, on the glass, or elsewhere."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.mirrors.body_alignment import AlignedView, BodyMotion, alignment_step
from nico_selfmodel.estimation.mirrors.mark_place import (
    GATE_3,
    NOT_ON_ME,
    ON_GLASS,
    ON_ME,
    PosedBody,
    Spot,
    agreeing,
    best_spots,
    spot_of,
)
from nico_selfmodel.geometry.rotation import rotation_about
from nico_selfmodel.geometry.solids.solid import Solid, onto_solids
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS

LEFT, RIGHT = (camera.at(np.eye(4)) for camera in NICO_CAMERAS.cameras)
RIG = StereoRig(LEFT, RIGHT.at(transform(np.eye(3), [0.07, 0.0, 0.0])))
MIRROR = Mirror.from_values([0.05, -0.1, 0.3], np.diag(np.square([5e-4, 5e-4, 2e-4])))
TURNED = Mirror.from_values([0.12, -0.1, 0.34], np.diag(np.square([5e-4, 5e-4, 2e-4])))
X_WH = transform(rotation_about([0.0, 0.0, 1.0], 0.4), [0.0, 0.16, -0.05])
BALL = Solid("ellipsoid", (0.06, 0.06, 0.06), np.eye(4))
NECK = np.array([0.0, 0.2, -0.05])
SIGMA = 0.4


def body(shift=0.0):
    """Return a head that is a ball and may turn about x by 0.2 deg."""
    pose = transform(X_WH[:3, :3], X_WH[:3, 3] + [shift, 0.0, 0.0])
    motion = BodyMotion(np.array([1.0, 0.0, 0.0]), NECK), frozenset({"head"})
    covariance = np.diag(np.square([5e-4, 5e-4, 2e-4, np.radians(0.2)]))
    solid = Solid("ellipsoid", BALL.size, pose)
    return PosedBody([solid], ["head"], {"head": pose}, [motion], covariance, {"head": 1e-4})


def on_the_ball(rng):
    """Return a place of the surface that looks at the mirror, in the head's frame."""
    way = rng.standard_normal(3) * [0.4, 0.4, 0.0] + [0.0, 0.0, 1.0]
    return 0.06 * (X_WH[:3, :3].T @ (way / np.linalg.norm(way)))


def seen(p_W, rng, mirror=MIRROR):
    return MirrorRig(RIG, mirror).project(p_W) + SIGMA * rng.standard_normal(4)


@pytest.mark.slow
def test_a_mark_is_put_where_it_is_and_as_exactly_as_is_said():
    rng = np.random.default_rng(1)
    chi = []
    for _ in range(150):
        p_F = on_the_ball(rng)
        values = rng.multivariate_normal(MIRROR.values, MIRROR.covariance)
        turn = rotation_about([1.0, 0.0, 0.0], np.radians(0.2) * rng.standard_normal())
        p_W = NECK + turn @ (apply(X_WH, p_F[None])[0] - NECK)
        spot = spot_of(seen(p_W, rng, Mirror.from_values(values)), SIGMA, RIG, MIRROR, body())
        if spot is None:
            continue
        assert spot.kind == ON_ME
        off = spot.place.p_FM - p_F
        assert np.linalg.norm(off) < 8e-3
        chi.append(off @ np.linalg.pinv(spot.place.own + spot.place.common) @ off)
    assert len(chi) > 140
    # Of a place on a known surface two coordinates are free.
    assert 0.8 < np.mean(chi) / 2.0 < 1.2


@pytest.mark.slow
def test_a_link_that_may_stand_elsewhere_makes_its_places_as_uncertain():
    rng = np.random.default_rng(11)
    loose, chi = replace(body(), place_sigma={"head": 1.5e-3}), []
    for _ in range(150):
        p_F = on_the_ball(rng)
        p_W = apply(X_WH, p_F[None])[0] + 1.5e-3 * rng.standard_normal(3)
        pixels = MirrorRig(RIG, MIRROR).project(p_W) + 0.1 * rng.standard_normal(4)
        spot = spot_of(pixels, 0.1, RIG, MIRROR, loose)
        if spot is None or spot.kind != ON_ME:
            continue
        off = spot.place.p_FM - p_F
        chi.append(off @ np.linalg.pinv(spot.place.own + spot.place.common, 1e-3) @ off)
        assert np.trace(spot.place.common) > np.trace(spot.place.own)
    assert len(chi) > 140
    assert 0.8 < np.mean(chi) / 2.0 < 1.2


def test_a_spot_on_the_glass_is_called_one():
    rng = np.random.default_rng(2)
    for _ in range(20):
        ray = np.array([*rng.uniform(-0.2, 0.2, 2), 1.0])
        p_W = ray * -MIRROR.plane.offset / (MIRROR.plane.normal @ ray)
        spot = spot_of(RIG.project(p_W) + 0.3 * rng.standard_normal(4), SIGMA, RIG, MIRROR, body())
        assert spot is None or spot.kind == ON_GLASS


@pytest.mark.parametrize("glass", [False, True])
def test_a_spot_whose_middle_is_hardly_known_is_where_it_fits_better(glass):
    """Known to nine pixels, as one seen in parts, it may be on the glass and on the body."""
    rng, kinds = np.random.default_rng(5), []
    for _ in range(20):
        p_W = apply(X_WH, on_the_ball(rng)[None])[0]
        pixels = MirrorRig(RIG, MIRROR).project(p_W)
        if glass:
            behind = p_W - 2.0 * MIRROR.plane.distance_to(p_W) * MIRROR.plane.normal
            pixels = RIG.project(behind * -MIRROR.plane.offset / (MIRROR.plane.normal @ behind))
        found = spot_of(pixels, 9.0, RIG, MIRROR, body())
        assert found is not None
        assert found.chi_square < 0.1
        kinds.append(found.kind)
    assert set(kinds) == {ON_GLASS if glass else ON_ME}


def test_a_mark_beside_the_body_is_not_on_me():
    rng = np.random.default_rng(3)
    beside = apply(X_WH, on_the_ball(rng)[None])[0] + [0.3, 0.0, 0.0]
    assert spot_of(seen(beside, rng), SIGMA, RIG, MIRROR, body()).kind == NOT_ON_ME


def test_pixels_that_are_not_of_one_point_are_no_spot():
    pixels = MirrorRig(RIG, MIRROR).project(X_WH[:3, 3])
    assert spot_of(pixels + np.array([0.0, 6.0, 0.0, 0.0]), SIGMA, RIG, MIRROR, body()) is None


def test_two_looks_agree_on_a_mark():
    rng = np.random.default_rng(4)
    p_F = on_the_ball(rng)
    p_W = apply(X_WH, p_F[None])[0]
    first = spot_of(seen(p_W, rng), SIGMA, RIG, MIRROR, body())
    second = spot_of(seen(p_W, rng, TURNED), SIGMA, RIG, TURNED, body())
    other = spot_of(seen(apply(X_WH, -p_F[None] * [1, 1, -1])[0], rng), SIGMA, RIG, MIRROR, body())
    assert agreeing([first], [second]) == ((first, second),)
    assert other is None or other.kind != ON_ME or agreeing([other], [second]) == ()
    assert np.linalg.norm(first.place.p_FM - p_F) < 4e-3


def test_looks_that_show_parts_of_one_spot_agree():
    p_W = apply(X_WH, on_the_ball(np.random.default_rng(4))[None])[0]
    sharp = replace(body(), covariance=1e-4 * body().covariance)
    part = np.array([0.0, 0.7, 0.0, 0.7])
    first, second = (
        spot_of(MirrorRig(RIG, mirror).project(p_W) + off, 0.1, RIG, mirror, sharp)
        for mirror, off in ((MIRROR, part), (TURNED, -part))
    )
    apart = first.place.p_FM - second.place.p_FM
    own = first.place.own + second.place.own + first.place.common + second.place.common
    assert apart @ np.linalg.solve(own, apart) > GATE_3
    assert agreeing([first], [second]) == ((first, second),)
    # Two faces of an edge: that they lie apart across the surface tells nothing either.
    assert np.sqrt(np.linalg.eigvalsh(first.place.in_part)[0]) > 3e-4
    assert np.sqrt(abs(np.linalg.eigvalsh(first.place.own)[0])) < 1e-6


def test_a_place_that_chance_makes_takes_no_partner_from_one_beyond_chance():
    left, right, chance = "left", "right", "chance"

    def spot(kind, chi_square):
        return Spot(kind, None, chi_square)

    elsewhere, glass = spot(NOT_ON_ME, 500.0), spot(ON_GLASS, 1.0)
    by_chance = glass, (left, True), (chance, False)
    assert best_spots([by_chance]) == [(glass, True)]
    seen_twice = elsewhere, (left, True), (right, True)
    assert best_spots([by_chance, seen_twice]) == [(elsewhere, True)]
    # Of what is beyond chance alike, what can be told comes first, and then what fits better.
    better, me = spot(ON_ME, 0.5), spot(ON_ME, 2.0)
    pairs = [(one, (left, True), (right, True)) for one in (elsewhere, me, better)]
    assert best_spots(pairs) == [(better, True)]
    apart = (me, ("other", False), (chance, False))
    assert best_spots([seen_twice, apart]) == [(elsewhere, True), (me, False)]


@pytest.mark.parametrize("depth", [-0.01, -0.005, 0.0, 0.005, 0.01])
def test_a_spot_where_two_shapes_meet_is_on_what_cameras_see_of_them(depth):
    own = Solid("ellipsoid", (0.02, 0.02, 0.02), transform(np.eye(3), [0.0, 0.02, 0.05]))
    chin, jaw = replace(own, X_FS=X_WH @ own.X_FS), body()
    whole = replace(jaw, solids=[*jaw.solids, chin], links=["head", "head"])
    p_W = apply(X_WH, onto_solids([BALL, own], [[0.0, 0.035, 0.2]], [0.0, 0.0, -1.0]))[0]
    rig = MirrorRig(RIG, MIRROR)
    eye = rig.virtual.left.X_WC[:3, 3]
    deep = p_W + depth * (p_W - eye) / np.linalg.norm(p_W - eye)
    spot = spot_of(rig.project(deep), SIGMA, RIG, MIRROR, whole)
    assert spot.kind == ON_ME
    assert np.linalg.norm(apply(X_WH, spot.place.p_FM[None])[0] - p_W) < 2e-3


def test_how_well_a_middle_is_known_counts_for_its_own_look_alone():
    p_W = apply(X_WH, on_the_ball(np.random.default_rng(4))[None])[0]
    pixels = MirrorRig(RIG, MIRROR).project(p_W)
    sharp, dull = (spot_of(pixels, sigma, RIG, MIRROR, body()).place for sigma in (0.1, 0.3))
    np.testing.assert_allclose(dull.own, 9.0 * sharp.own, atol=1e-12)
    np.testing.assert_allclose(dull.common, sharp.common, atol=1e-12)


def test_a_spot_that_is_seen_in_part_is_put_where_it_is_all_the_same():
    p_F = on_the_ball(np.random.default_rng(4))
    pixels = MirrorRig(RIG, MIRROR).project(apply(X_WH, p_F[None])[0])
    lower = np.array([0.0, 1.4, 0.0, 0.0])
    part, other = pixels + lower, pixels + 2.0 * lower
    assert spot_of(part, 0.1, RIG, MIRROR, body()).kind == ON_ME
    assert spot_of(other, 0.1, RIG, MIRROR, body()) is None


def smooth(u, v):
    """Return a picture of soft waves of three colours at pixels."""
    waves = [
        np.sin(0.15 * u + 0.2 * v + k) + np.cos(0.21 * v - 0.05 * u * (k - 1)) for k in range(3)
    ]
    return 120.0 + 40.0 * np.stack(waves, axis=-1)


def test_a_body_that_looks_turned_is_told_by_how_much():
    v, u = np.mgrid[0:480, 0:640].astype(float)
    inside = np.hypot(u - 320, v - 240) < 120
    ideal = np.concatenate(
        [LEFT.undistort(np.stack([u[inside], v[inside]], axis=1)), np.ones((inside.sum(), 1))],
        axis=1,
    )
    depth = np.full(u.shape, np.inf)
    depth[inside] = 0.7
    plane, motion = MIRROR.plane, BodyMotion(np.array([1.0, 0.0, 0.0]), NECK)
    points = 0.7 * ideal - 2.0 * plane.distance_to(0.7 * ideal)[:, None] * plane.normal
    angle = np.radians(0.15)
    turned = NECK + (points - NECK) @ rotation_about([1.0, 0.0, 0.0], angle).T
    moved = MirrorRig(RIG, MIRROR).project(turned)[:, :2] - np.stack([u[inside], v[inside]], axis=1)
    picture = smooth(u, v)
    picture[inside] = 0.9 * smooth(u[inside] - moved[:, 0], v[inside] - moved[:, 1])
    view = AlignedView(0, 0, picture, smooth(u, v), depth, inside, inside[None])
    prior = np.diag(np.square([1e-6, 1e-6, 1e-6, np.radians(1.0)]))
    found = alignment_step([view], RIG, [MIRROR], [motion], (np.zeros(4), prior), 10.0)
    assert found.change[3] == pytest.approx(angle, rel=0.15)
    assert abs(found.change[:3]).max() < 1e-5


@pytest.mark.slow
def test_shades_that_lie_elsewhere_are_told_from_a_body_that_is_turned():
    v, u = np.mgrid[0:480, 0:640].astype(float)
    inside = np.hypot(u - 320, v - 240) < 120
    depth, motion = np.where(inside, 0.7, np.inf), BodyMotion(np.array([1.0, 0.0, 0.0]), NECK)
    by_light = np.stack([np.gradient(smooth(u, v), axis=0), smooth(v, u), smooth(-u, v)], axis=3)
    turn = np.array([0.04, -0.03, 0.02])
    picture = 0.9 * 1.03 * (smooth(u, v) + by_light @ turn)
    known = AlignedView(0, 0, picture, smooth(u, v), depth, inside, inside[None])
    view = replace(known, by_light=by_light)
    sigma = [1e-6, 1e-6, 1e-6, np.radians(1.0)]
    before = np.zeros(4), np.diag(np.square(sigma))
    fooled = alignment_step([known], RIG, [MIRROR], [motion], before, 10.0)
    before = np.zeros(7), np.diag(np.square([*sigma, 0.1, 0.1, 0.1]))
    found = alignment_step([view], RIG, [MIRROR], [motion], before, 10.0)
    assert found.change[4:] == pytest.approx(turn, abs=2e-3)
    assert abs(found.change[3]) < 0.1 * abs(fooled.change[3])


def test_a_camera_that_may_be_off_is_not_taken_for_a_mirror_that_is():
    v, u = np.mgrid[0:480, 0:640].astype(float)
    inside = np.hypot(u - 320, v - 240) < 120
    depth = np.where(inside, 0.7, np.inf)
    off, picture = 0.15, smooth(u, v)
    picture[inside] = smooth(u[inside] - off, v[inside])
    still = BodyMotion(np.array([1.0, 0.0, 0.0]), None)
    view = AlignedView(0, 0, picture, smooth(u, v), depth, inside, np.zeros((1, *u.shape), bool))
    sigma = [1e-3, 1e-3, 1e-4, 1e-9]
    before = np.zeros(4), np.diag(np.square(sigma))
    exact = alignment_step([view], RIG, [MIRROR], [still], before, 10.0)
    before = np.zeros(5), np.diag(np.square([*sigma, 5.0]))
    loose = alignment_step([view], RIG, [MIRROR], [still], before, 10.0, ("left.cx",))
    assert loose.change[4] == pytest.approx(off, rel=0.15)
    assert abs(exact.change[0]) > 1e-4
    assert abs(loose.change[:2]).max() < 0.2 * abs(exact.change[0])
    assert loose.covariance[0, 0] > exact.covariance[0, 0]


def test_an_alignment_without_a_body_in_view_is_refused():
    nothing = np.zeros((480, 640), dtype=bool)
    flat = np.full((480, 640, 3), 90.0)
    view = AlignedView(0, 0, flat, flat, np.full(nothing.shape, np.inf), nothing, nothing[None])
    motion = BodyMotion(np.array([1.0, 0.0, 0.0]), None)
    with pytest.raises(EstimationError, match="only 0 grey levels of the body"):
        alignment_step([view], RIG, [MIRROR], [motion], (np.zeros(4), np.eye(4)), 10.0)

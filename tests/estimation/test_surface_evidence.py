"""What surprises a little in every picture of one place of the surface, and what in one only."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from nico_selfmodel.estimation.mirrors.mark_place import GATE_3
from nico_selfmodel.estimation.mirrors.surface_evidence import (
    SurfaceView,
    plainly_shown,
    surprising_together,
)
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.solids.solid import Solid, onto_solids
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.vision.surprise.blobs import FALSE_ALARM, threshold_of

LEFT, RIGHT = (camera.at(np.eye(4)) for camera in NICO_CAMERAS.cameras)
RIG = StereoRig(LEFT, RIGHT.at(transform(np.eye(3), [0.07, 0.0, 0.0])))
MIRRORS = [MirrorRig(RIG, Mirror.from_values([k, -0.1, 0.3])) for k in (0.05, 0.12)]
X_WH = transform(np.eye(3), [0.0, 0.16, -0.05])
BALL = Solid("ellipsoid", (0.06, 0.06, 0.06), X_WH)
SHAPE = (480, 640)
HEAD, NONE = 7, -1
MARK = np.array([0.01, 0.0, 0.0592])
"""On the ball, in the head's frame."""


@cache
def geometry(look, side):
    """Return depths and labels of one camera's picture of the ball in a mirror."""
    camera, rig = RIG.cameras[side], MIRRORS[look]
    depth, labels = np.full(SHAPE, np.inf), np.full(SHAPE, NONE)
    u, v = np.round(rig.project(X_WH[:3, 3])[2 * side : 2 * side + 2]).astype(int)
    rows, columns = (k.ravel() for k in np.mgrid[v - 60 : v + 61, u - 60 : u + 61])
    ways = camera.directions(np.stack([columns, rows], axis=1).astype(float))
    normal = rig.plane.normal
    ways = ways - 2.0 * (ways @ normal)[:, None] * normal
    start = reflect(rig.plane, camera.X_WC[:3, 3])
    # Behind the glass is nothing: the search begins before the ball.
    met = onto_solids([BALL], start + 0.2 * ways, ways)
    seen = np.isfinite(met).all(axis=1)
    depth[rows[seen], columns[seen]] = apply(camera.X_CW, reflect(rig.plane, met[seen]))[:, 2]
    labels[rows[seen], columns[seen]] = HEAD
    return depth, labels


def view(look, side, off, depth, labels, alike=0.0):
    """Return a picture of what differs by so many of its sigmas, a share of them not by noise."""
    known = off[np.isfinite(off).all(axis=2)]
    one = np.tile(np.eye(3), (len(known), 1, 1))
    places = np.sum(off**2, axis=2)
    poses = {HEAD: X_WH}
    return SurfaceView(side, MIRRORS[look], places, known, one, alike * one, depth, labels, poses)


PAINT = np.array([0.6, 0.0, -0.8])


def views(strengths, rng, surprise=3.0):
    """Return four pictures, of noise and paint that differs by so much in each."""
    found = []
    for k, strength in enumerate(strengths):
        look, side = divmod(k, 2)
        depth, labels = geometry(look, side)
        off = np.full((*SHAPE, 3), np.nan)
        own = labels == HEAD
        off[own] = np.sqrt(surprise / 3.0) * rng.standard_normal((own.sum(), 3))
        pixels = MIRRORS[look].project(apply(X_WH, MARK[None])[0]).reshape(2, 2)[side]
        rows, columns = np.ogrid[: SHAPE[0], : SHAPE[1]]
        near = np.hypot(columns - pixels[0], rows - pixels[1]) < 3.0
        off[near] = np.nan if strength is None else np.sqrt(strength) * PAINT + 0.3 * off[near]
        found.append(view(look, side, off, depth, labels))
    return found


def together(found):
    return surprising_together(found, lambda n, k: threshold_of(n, FALSE_ALARM, k))


def alone(found):
    least = threshold_of(int(np.isfinite(found[0].places).sum()))
    return [bool((view.places > least).any()) for view in found]


@pytest.mark.slow
def test_a_mark_that_no_picture_shows_for_sure_is_found_by_all_of_them():
    found = views([15.0] * 4, np.random.default_rng(1), surprise=0.5)
    assert not any(alone(found))
    for k, above in enumerate(together(found)):
        assert above.any()
        v, u = np.argwhere(above).mean(axis=0)
        look, side = divmod(k, 2)
        pixels = MIRRORS[look].project(apply(X_WH, MARK[None])[0]).reshape(2, 2)[side]
        assert (u, v) == pytest.approx(tuple(pixels), abs=2.0)


@pytest.mark.slow
def test_a_place_that_all_pictures_tell_together_surprises_in_each_of_them():
    """Lines of sight end between pixels: what one picture tells must not get lost in the next."""
    rows, columns = np.nonzero(geometry(0, 0)[1] == HEAD)
    middle = np.hypot(rows - rows.mean(), columns - columns.mean()) < 12.0
    pixels = np.stack([columns[middle], rows[middle]], axis=1)
    ways = LEFT.undistort(pixels.astype(float))
    depth = geometry(0, 0)[0][pixels[:, 1], pixels[:, 0]]
    p_LQ = np.concatenate([ways, np.ones((len(ways), 1))], axis=1) * depth[:, None]
    p_WQ = reflect(MIRRORS[0].plane, p_LQ)
    lost = 0
    for k in range(0, len(pixels), 90):
        found = views([0.0] * 4, np.random.default_rng(6), surprise=1e-6)
        for view in found:
            u, v = view.rig.project(p_WQ[k])[2 * view.side : 2 * view.side + 2]
            number = np.cumsum(np.isfinite(view.places)).reshape(SHAPE)[round(v), round(u)] - 1
            view.places[round(v), round(u)] = 30.0
            view.off[number] = np.sqrt(30.0) * PAINT
        lost += sum(not above.any() for above in together(found))
    assert lost == 0


@pytest.mark.parametrize(
    ("alike", "off", "surprises"),
    [(0.0, 12.0, True), (0.9, 12.0, False), (0.9, 24.0, False), (0.9, 40.0, True)],
)
def test_what_is_expected_wrongly_in_all_pictures_alike_is_no_mark(alike, off, surprises):
    """Of noise four pictures tell half as much as one; of wrong colours no less than one."""
    rng, found = np.random.default_rng(4), []
    for k in range(4):
        look, side = divmod(k, 2)
        depth, labels = geometry(look, side)
        differs = np.full((*SHAPE, 3), np.nan)
        own = labels == HEAD
        differs[own] = np.sqrt(off) * PAINT + 0.1 * rng.standard_normal((own.sum(), 3))
        found.append(view(look, side, differs, depth, labels, alike))
    assert all(above.any() == surprises for above in together(found))


def test_what_is_wrong_in_one_picture_alone_is_alike_in_none():
    """What has changed since an earlier picture is compared with that, and not with the body."""
    found = []
    for side, alike in ((0, 0.0), (1, 0.9)):
        depth, labels = geometry(0, side)
        differs = np.full((*SHAPE, 3), np.nan)
        differs[labels == HEAD] = np.sqrt(20.0) * PAINT
        found.append(view(0, side, differs, depth, labels, alike))
    assert all(above.any() for above in together(found))
    both = [replace(one, alike=found[1].alike[:1] + 0.0 * one.covariance) for one in found]
    assert not any(above.any() for above in together(both))


@pytest.mark.slow
def test_what_one_picture_shows_however_bright_is_not_on_the_surface():
    for k in range(4):
        strengths = [0.0] * 4
        strengths[k] = 500.0
        assert not any(
            above.any() for above in together(views(strengths, np.random.default_rng(3)))
        )


@pytest.mark.slow
@pytest.mark.parametrize("two", [(0, 2), (1, 3), (0, 3), (1, 2)])
def test_what_two_pictures_show_and_the_others_do_not_is_not_on_the_surface(two):
    """A spot on the glass lies before nearly the same places for one camera in two mirrors."""
    strengths = [500.0 if k in two else 0.0 for k in range(4)]
    assert not any(a.any() for a in together(views(strengths, np.random.default_rng(3))))


@pytest.mark.slow
def test_what_two_of_three_pictures_show_is_found_if_the_third_does_too():
    rng = np.random.default_rng(2)
    assert not any(a.any() for a in together(views([500.0, None, 500.0, 0.0], rng)))
    found = together(views([500.0, None, 500.0, 40.0], rng))
    assert all(found[k].any() for k in (0, 2, 3))


@pytest.mark.slow
def test_what_only_one_look_shows_is_not_found_where_the_other_judges():
    rng = np.random.default_rng(3)
    assert not any(above.any() for above in together(views([60.0, 60.0, 0.0, 0.0], rng)))
    unseen = together(views([60.0, 60.0, None, None], rng))
    assert unseen[0].any()
    assert unseen[1].any()


@pytest.mark.parametrize(("off", "counts"), [(0.006, True), (0.014, False)])
def test_what_stands_before_or_behind_a_place_is_not_that_place(off, counts):
    found = views([60.0, 60.0, 0.0, 0.0], np.random.default_rng(3))
    aside = [
        view if view.rig is MIRRORS[0] else replace(view, depth=view.depth - off) for view in found
    ]
    # The second look contradicts the first where it shows the same place.
    assert bool(together(aside)[0].any()) is not counts


@pytest.mark.slow
def test_noise_surprises_in_one_of_a_hundred_looks_at_most():
    rng = np.random.default_rng(4)
    assert sum(any(a.any() for a in together(views([0.0] * 4, rng))) for _ in range(20)) == 0


def test_weak_paint_that_is_alike_in_all_pictures_is_found_and_other_differences_are_not():
    found = views([12.0] * 4, np.random.default_rng(5), surprise=1e-6)
    assert together(found)[0].any()
    for one, side in zip(found, (1.0, -1.0, -1.0, 1.0), strict=True):
        one.off[...] *= side
    assert not together(found)[0].any()


@pytest.mark.parametrize(("shown", "strengths"), [(4, (8.0, 8.5, 9.5)), (2, (16.0, 17.0, 18.5))])
def test_all_pictures_must_pass_the_bound_and_the_rest_what_chance_lets_pass(shown, strengths):
    """Of four pictures any two must tell by themselves, of two each one."""
    above, total = [], 0
    for strength in strengths:
        each = [strength] * shown + [None] * (4 - shown)
        found = views(each, np.random.default_rng(5), surprise=1e-6)
        total = sum(int(np.isfinite(view.places).sum()) for view in found)
        above.append(together(found)[0].any())
    least = max(threshold_of(total, FALSE_ALARM) / shown, GATE_3 / (2 if shown == 4 else 1))
    assert above == [strength > least for strength in strengths]
    assert above[0] is not above[-1]


def plain_view(covered=False):
    """Return a picture of the ball, or of one that something covers about the mark."""
    depth, labels = geometry(0, 0)
    if covered:
        u, v = np.rint(MIRRORS[0].project(apply(X_WH, MARK[None])[0])[:2]).astype(int)
        labels = labels.copy()
        labels[v - 3 : v + 4, u + 2 : u + 6] = NONE
    off = np.where((labels == HEAD)[:, :, None], 0.0, np.full((*SHAPE, 3), np.nan))
    return view(0, 0, off, depth, labels)


def test_a_place_is_plainly_shown_where_what_is_about_it_is_and_not_from_the_side():
    whole, toward = plain_view(), MARK / np.linalg.norm(MARK)
    assert plainly_shown(whole, HEAD, MARK, toward)
    assert not plainly_shown(plain_view(covered=True), HEAD, MARK, toward)
    away = np.array([0.0, 0.0, -1.0])
    assert not plainly_shown(whole, HEAD, 0.06 * away, away)
    assert not plainly_shown(whole, HEAD + 1, MARK, toward)
    # Where the ball turns from the camera it narrows, and ends.
    rim = [np.array([np.sin(a), 0.0, np.cos(a)]) for a in np.radians(np.arange(0.0, 100.0, 5.0))]
    found = [plainly_shown(whole, HEAD, 0.06 * n, n) for n in rim]
    assert found[0]
    assert not found[-1]
    assert sum(a != b for a, b in pairwise(found)) == 1

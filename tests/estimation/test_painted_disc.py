"""The middle of a disc of paint on a known surface, of which pictures may show a part."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.mirrors.painted_disc import SurfacePixels, light_of, painted_disc
from nico_selfmodel.geometry.rotation import tangent_basis
from nico_selfmodel.geometry.solids.solid import (
    Solid,
    distance_to_solids,
    normals_of_solids,
    onto_solids,
)
from nico_selfmodel.geometry.transform import transform

from ..slow_rest import slow_rest

NOISE, RADIUS, PIXEL, THICKEST = 2.0, 5e-3, 1.5e-3, 4e-4
BALL = Solid("ellipsoid", (0.06, 0.06, 0.06), np.eye(4))
CAP = Solid("box", (0.13, 0.13, 0.06), transform(np.eye(3), [0.0, 0.0, 0.05]))
"""About the upper part of the ball: its lower side is at z = 20 mm, its front at x = 65 mm."""
COLORS = np.array([[200.0, 180.0, 160.0], [60.0, 110.0, 140.0]])
PAINT = np.array([150.0, 190.0, 190.0])
LIGHT = np.array([0.8, 0.0, 0.6])


def sights(way, at):
    """Return where lines of sight through a square of pixels begin, and how pixels lie."""
    across = tangent_basis(np.array(way))
    v, u = np.mgrid[-12:13, -12:13].reshape(2, -1)
    pixels = np.stack([u, v], axis=1).astype(float)
    return pixels, at + PIXEL * pixels @ across.T - 0.1 * np.array(way), across


def shown(solids, p_FQ, x, p_FP):
    """Return the colours of places, under a disc of paint that is met elsewhere, or under none."""
    normals = normals_of_solids(solids, p_FQ)
    light = 0.3 + 0.7 * np.maximum(normals @ LIGHT, 0.0)[:, None]
    plain = COLORS[distance_to_solids(solids, p_FQ)[1] if len(solids) > 1 else 0] * light
    E = tangent_basis(normals_of_solids(solids, x[None])[0])
    normal = np.cross(*E.T)
    if p_FP is None:
        return plain
    y = (p_FP - x) @ E
    laid = onto_solids(solids, x + y @ E.T + RADIUS * normal, -normal)
    on = (np.linalg.norm(y, axis=1) < RADIUS) & (np.linalg.norm(laid - p_FQ, axis=1) < 5e-4)
    return np.where(on[:, None], PAINT * light, plain)


def picture(solids, x, way, rng, top=None):
    """Return a picture of a mark, nine samples a pixel; the paint's top may be higher."""
    pixels, start, across = sights(way, x)
    fine = PIXEL / 3.0 * (np.mgrid[-1:2, -1:2].reshape(2, -1).T @ across.T)
    seen, under = np.zeros((2, len(pixels), 3))
    for step in fine:
        met = onto_solids(solids, start + step, np.array(way))
        known = np.isfinite(met).all(axis=1)
        above = met if top is None else onto_solids(top, start + step, np.array(way))
        for colors, paint in ((seen, above[known]), (under, None)):
            colors += 110.0 / 9.0
            colors[known] += (shown(solids, met[known], x, paint) - 110.0) / 9.0
    p_FQ = onto_solids(solids, start, np.array(way))
    known = np.isfinite(p_FQ).all(axis=1)
    colors = np.full(p_FQ.shape, np.nan)
    colors[known] = COLORS[distance_to_solids(solids, p_FQ[known])[1]]
    light = light_of(pixels, under, colors)
    p_FQ[np.isnan(light[:, 0])] = np.nan
    off = seen - under
    seen += NOISE * rng.standard_normal(seen.shape)
    inverse = np.tile(np.eye(3) / NOISE**2, (len(pixels), 1, 1))
    surprising = np.linalg.norm(off, axis=1) > 10.0
    return SurfacePixels(
        pixels, p_FQ, seen, under, light, inverse, across.T / PIXEL, surprising
    )  # fmt: skip


def on_ball(longitude, latitude):
    """Return a place on the ball [deg]."""
    a, b = np.radians([longitude, latitude])
    return 0.06 * np.array([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)])


def looking(longitude, latitude):
    """Return a direction that looks at a place of the ball from outside [deg]."""
    return -on_ball(longitude, latitude) / 0.06


CASES = {
    "lit from one side": ([BALL], on_ball(0.0, -30.0), 0.0),
    "at the outline": ([BALL], on_ball(75.0, 0.0), 1.0),
    "below what hides a part": ([BALL, CAP], on_ball(0.0, 18.0), 0.5),
}
"""Solids, a place on them, and how far off the middle of what is seen there is at least [mm]."""


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_the_middle_is_that_of_the_disc_not_of_what_is_seen_of_it(case):
    solids, x, least = CASES[case]
    along = tangent_basis(normals_of_solids(solids, x[None])[0]).T
    square, off = [], []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        each = [picture(solids, x, looking(k, 5.0), rng) for k in (-4.0, 4.0)]
        seen = [np.nanmean(one.p_FQ[one.surprising], axis=0) - x for one in each]
        assert 1e3 * max(map(np.linalg.norm, seen)) > least
        found, covariance = painted_disc(each, solids, x + 1e-3 * rng.standard_normal(3), 0.03, 0.0)
        e, C = along @ (found - x), along @ covariance @ along.T
        square.append(float(e @ np.linalg.solve(C, e)) / 2.0)
        off.append(1e3 * np.linalg.norm(e))
    assert np.mean(square) < 2.5
    assert max(off) < 0.5


@pytest.mark.parametrize("height", slow_rest([THICKEST, 0.0]))
def test_paint_may_be_seen_beside_its_place_by_as_much_as_it_is_thick(height):
    x, rng, slant = on_ball(0.0, 0.0), np.random.default_rng(3), np.tan(np.radians(40.0))
    top = [Solid("ellipsoid", tuple(0.06 + height * np.ones(3)), np.eye(4))]
    each = [picture([BALL], x, looking(40.0, 0.0), rng, top)]
    y, sigma = [], []
    for thickest in (0.0, THICKEST):
        middle, covariance = painted_disc(each, [BALL], x, 0.03, thickest)
        y.append(middle[1])
        sigma.append(np.sqrt(covariance[1, 1]))
    assert y[0] == pytest.approx(-height * slant, abs=2.0 * sigma[0])
    half = 0.5 * THICKEST * slant
    assert y[1] - y[0] == pytest.approx(half, rel=0.1)
    assert sigma[1] ** 2 - sigma[0] ** 2 == pytest.approx(half**2, rel=0.2)
    assert abs(y[1]) < 2.0 * sigma[1]


def test_paint_that_bends_about_a_bead_is_known_worse_than_on_a_head():
    sigma = []
    for size in (0.007, 0.06):
        x, ball = np.array([size, 0.0, 0.0]), Solid("ellipsoid", (size,) * 3, np.eye(4))
        each = [picture([ball], x, looking(k, 5.0), np.random.default_rng(2)) for k in (-4.0, 4.0)]
        covariance = painted_disc(each, [ball], x, 0.03, 0.0)[1]
        sigma.append(float(np.sqrt(np.trace(covariance) / 2.0)))
    assert sigma[0] > 0.8e-3
    turned = 1.0 - np.sqrt(1.0 - (RADIUS / 0.007) ** 2)
    assert sigma[0] == pytest.approx(RADIUS * turned, rel=0.1)
    assert sigma[1] < 0.15e-3


def test_a_disc_that_an_edge_cuts_is_known_by_its_part_on_the_face():
    plate = Solid("box", (0.02, 0.06, 0.06), np.eye(4))
    x, way = np.array([0.01, 0.027, 0.0]), np.array([-1.0, 0.0, 0.0])
    square = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        each = [picture([plate], x, way, rng) for _ in range(2)]
        found, covariance = painted_disc(each, [plate], x - 1e-3 * np.eye(3)[1], 0.03, 0.0)
        e, C = (found - x)[1:], covariance[1:, 1:]
        assert np.sqrt(np.diag(C)).max() < 1e-3
        square.append(float(e @ np.linalg.solve(C, e)) / 2.0)
    assert np.mean(square) < 2.5


@pytest.mark.parametrize(("across", "told"), [(3.0, False), (6.0, True)])
def test_a_spot_of_too_few_pixels_is_taken_for_half_a_disc_and_known_to_its_middle(across, told):
    x, rng = on_ball(0.0, 0.0), np.random.default_rng(1)
    one = picture([BALL], x, looking(0.0, 0.0), rng)
    seen = np.linalg.norm(one.at, axis=1) < across
    few = replace(one, p_FQ=np.where(seen[:, None], one.p_FQ, np.nan))
    middle, covariance = painted_disc([few], [BALL], x, 0.03, 0.0)
    sigma = np.sqrt(np.linalg.eigvalsh(covariance))
    if told:
        assert sigma.max() < 0.5e-3
    else:
        assert middle == pytest.approx(x)
        radius = PIXEL * np.sqrt((one.surprising & seen).sum() / np.pi)
        assert sigma == pytest.approx([0.5 * radius] * 3)


def test_light_is_told_by_what_is_inside_of_a_colour_not_by_its_edge():
    v, u = np.mgrid[:9, :12].reshape(2, -1)
    colors = COLORS[(u > 5).astype(int)]
    under = 0.5 * colors
    under[u == 5] = 0.25 * (COLORS[0] + COLORS[1])
    colors = np.where((u < 10)[:, None], colors, np.nan)
    light = light_of(np.stack([u, v], axis=1).astype(float), under, colors)[:, 0]
    inside = (u < 10) & (v > 0) & (v < 8) & (u > 0)
    assert light[inside] == pytest.approx(0.5)
    assert np.isnan(light[u >= 10]).all()


def test_light_that_falls_is_followed_to_the_edge_of_a_colour():
    v, u = np.mgrid[:9, :12].reshape(2, -1)
    colors = COLORS[(u > 5).astype(int)]
    light = np.exp(-0.15 * u - 0.1 * v)[:, None]
    under = light * colors
    under[u == 5] = 200.0
    found = light_of(np.stack([u, v], axis=1).astype(float), under, colors)
    near = (u == 5) & (v > 1) & (v < 7)
    assert found[near] == pytest.approx(light[near], rel=0.1)


def test_what_is_seen_of_half_a_disc_is_off_by_what_is_said():
    """A part of half its area whose middle is half a radius off, in any direction."""
    rng = np.random.default_rng(5)
    middles = 0.5 * RADIUS * np.exp(2j * np.pi * rng.uniform(size=20_000))
    x = on_ball(0.0, 0.0)
    one = picture([BALL], x, looking(0.0, 0.0), rng)
    few = replace(
        one, p_FQ=np.where(np.linalg.norm(one.at, axis=1)[:, None] < 2.5, one.p_FQ, np.nan)
    )
    shown = PIXEL * np.sqrt(np.isfinite(few.p_FQ[few.surprising, 0]).sum() / np.pi)
    said = np.sqrt(np.diag(painted_disc([few], [BALL], x, 0.03, 0.0)[1]))
    assert said[0] / shown == pytest.approx(
        np.std(middles.real) / (RADIUS / np.sqrt(2.0)), rel=0.02
    )

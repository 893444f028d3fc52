"""The shape of a link that moves before cameras that stand still."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from nico_selfmodel.estimation.shape.fusion import DepthView, first_surface
from nico_selfmodel.estimation.shape.picture_equations import PictureEquations
from nico_selfmodel.estimation.shape.refinement import MOVING_STEPS, refine_surface
from nico_selfmodel.estimation.shape.shape_views import ShapeView, ShapeViews, slope_of
from nico_selfmodel.estimation.shape.standpoints import InMirror, OnLink
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.geometry.voxel_grid import VoxelGrid

from .test_shape import CENTER, RADIUS, ball, look, mirrors, off, rig

LOOKS = 24
PLACE = np.array([0.0, 0.0, 0.35])
"""Where the cameras see the middle of the ball [m]."""
SIGMA = np.array([8e-3] * 3 + [1e-3] * 3)
"""How well the link's pose is known in each look [rad, m]."""


def poses_of_link():
    """Return where the link is in each look, the ball about `PLACE`. Shape (looks, 4, 4)."""
    rng = np.random.default_rng(11)
    turns = rotation_from_vector(rng.uniform(-2.0, 2.0, (LOOKS, 3)))
    aside = rng.uniform(-0.03, 0.03, (LOOKS, 3))
    both = zip(turns, aside, strict=True)
    return np.array([transform(R, PLACE + p - R @ CENTER) for R, p in both])


@cache
def seen():
    """Return pictures of a painted ball on a link, with poses as the joints tell them."""
    rng, views, depths, links = np.random.default_rng(0), [], [], []
    for k, X_WF in enumerate(poses_of_link()):
        for side, camera in enumerate(rig().cameras):
            here = camera.at(np.linalg.inv(X_WF) @ camera.X_WC)
            picture, beyond, depth = look(here, rng)
            views.append(ShapeView(k, side, picture, beyond))
            if side == 0:
                depths.append(DepthView(k, rig().left, depth))
        links.append(OnLink(X_WF, np.zeros(6)))
    known = np.kron(np.eye(LOOKS), np.diag(SIGMA**2))
    return ShapeViews(tuple(views), rig(), tuple(links), (), known), tuple(depths)


def test_pixels_and_slopes_of_points_on_a_turned_link_agree():
    views, _ = seen()
    now = views.placed(np.random.default_rng(1).normal(0.0, 0.05, len(views.values)))
    p, step = CENTER[None] + [[0.01, 0.02, -0.03]], 1e-6
    by_point, by_value = now.slopes(p)[5]
    assert by_value.shape == (1, 2, 6)
    for k in range(3):
        moved = [now.pixels(p + sign * step * np.eye(3)[k])[5][0] for sign in (1, -1)]
        slope = (moved[0] - moved[1]) / (2 * step)
        np.testing.assert_allclose(by_point[0, :, k], slope, rtol=1e-4, atol=1e-4)
    for k, number in enumerate(now.part(now.views[5])):
        change = step * np.eye(len(now.values))[number]
        moved = [now.placed(now.values + sign * change).pixels(p)[5][0] for sign in (1, -1)]
        slope = (moved[0] - moved[1]) / (2 * step)
        np.testing.assert_allclose(by_value[0, :, k], slope, rtol=1e-4, atol=1e-4)


def test_what_moves_a_links_frame_in_all_poses_alike_is_no_error_of_its_shape():
    views, _ = seen()
    beside = views.beside_the_frame
    motion = np.array([[1e-3, -2e-3, 5e-4], [2e-4, 1e-4, -3e-4]])
    alike = np.concatenate([one.R_WF @ part for one in views.standpoints for part in motion])
    np.testing.assert_allclose(beside @ alike, 0.0, atol=1e-17)
    np.testing.assert_allclose(beside @ beside, beside, atol=1e-12)
    assert np.linalg.matrix_rank(np.eye(len(beside)) - beside) == 6
    still = tuple(InMirror(mirror, np.eye(4)) for mirror in mirrors())
    mirrored = replace(views, standpoints=still, covariance=np.eye(3 * len(still)))
    assert np.array_equal(mirrored.beside_the_frame, np.eye(3 * len(still)))


def test_a_part_of_a_picture_shows_points_from_its_corner():
    views, _ = seen()
    p = CENTER[None]
    part = replace(views.views[3], corner=(7, 9))
    cut = replace(views, views=(*views.views[:3], part))
    np.testing.assert_allclose(views.pixels(p)[3] - cut.pixels(p)[3], [[7.0, 9.0]])


def test_light_is_one_in_all_mirrors_and_another_in_each_pose_of_a_link():
    views, _ = seen()
    assert views.lit_alike == [[2 * k, 2 * k + 1] for k in range(LOOKS)]
    still = tuple(InMirror(mirror, np.eye(4)) for mirror in mirrors())
    both = replace(views, standpoints=(*still, *views.standpoints[len(still) :]))
    assert both.lit_alike[0] == list(range(2 * len(still)))


def test_colours_that_change_from_pose_to_pose_do_not_disagree():
    views, _ = seen()
    mesh = ball(RADIUS, 0.01)
    brighter = [
        replace(v, picture=v.picture * (1.0 + 0.02 * v.look), beyond=v.beyond) for v in views.views
    ]
    plain, lit = (
        PictureEquations.of(mesh, replace(views, views=tuple(own))).chi_square
        for own in (views.views, brighter)
    )
    assert np.median(lit) == pytest.approx(np.median(plain), rel=0.3)


def test_two_pictures_that_disagree_tell_nothing_that_cannot_be():
    views, _ = seen()
    odd = np.random.default_rng(2).uniform(0.0, 60.0, views.views[0].picture.shape)
    strange = [replace(v, picture=v.picture + odd * v.side) for v in views.views]
    found = PictureEquations.of(ball(RADIUS, 0.01), replace(views, views=tuple(strange)))
    sizes = np.linalg.eigvalsh(found.values)
    assert sizes[0] > -1e-9 * sizes[-1]


def test_slopes_between_pixels_are_those_of_the_image():
    v, u = np.mgrid[0:9, 0:9].astype(float)
    at = np.array([[3.25, 4.5], [0.5, 4.0]])
    slopes = slope_of(u**2 + 3.0 * v, at)
    np.testing.assert_allclose(slopes[0], [6.5, 3.0])
    assert np.isnan(slopes[1, 0])


def test_a_ball_that_is_turned_about_is_seen_from_all_sides():
    views, depths = seen()
    grid = VoxelGrid.about(CENTER[None], RADIUS + 0.02, 8e-3)
    mesh = first_surface(grid, np.ones(len(grid.points), dtype=bool), views, depths)
    assert np.median(np.abs(off(mesh))) < 1e-3
    ways = (mesh.vertices - CENTER) / np.linalg.norm(mesh.vertices - CENTER, axis=1)[:, None]
    assert np.linalg.norm(ways.mean(axis=0)) < 0.25  # of half a ball it is 0.5


@pytest.mark.slow
def test_a_ball_on_a_loose_link_gets_its_size_and_says_how_well():
    views, _ = seen()
    rng = np.random.default_rng(1)
    told = views.placed(np.tile(SIGMA, LOOKS) * rng.standard_normal(6 * LOOKS))
    told = replace(
        told, standpoints=tuple(OnLink(one.pose, np.zeros(6)) for one in told.standpoints)
    )
    found = refine_surface(ball(RADIUS - 2e-3, 8e-3), lambda _: told, rng, steps=MOVING_STEPS)
    sure = found.looks >= 6
    assert np.count_nonzero(sure) > 0.9 * len(sure)
    assert np.median(np.abs(off(found.mesh)[sure])) < 0.5e-3
    assert 0.5 < np.sqrt(np.mean((off(found.mesh)[sure] / found.sigma[sure]) ** 2)) < 1.3

"""The shape of a ball that stands before two cameras, seen in mirrors."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.shape import refinement
from nico_selfmodel.estimation.shape.fair_surface import FairSurface, Neighbours
from nico_selfmodel.estimation.shape.fusion import DepthView, first_surface
from nico_selfmodel.estimation.shape.picture_equations import PictureEquations
from nico_selfmodel.estimation.shape.refinement import STEPS, refine_surface
from nico_selfmodel.estimation.shape.shape_views import ShapeView, ShapeViews, nearest_of, sampled
from nico_selfmodel.estimation.shape.standpoints import InMirror
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.surface_nets import surface_nets
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.geometry.voxel_grid import VoxelGrid
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.sessions.mirrors.learned_shape import claimed
from nico_selfmodel.vision.images.image_array import smoothed_within

CENTER, RADIUS = np.array([0.03, 0.1, -0.05]), 0.07
TILTS = [(x, y) for x in (-25, 0, 25) for y in (-20, 5)]
SIGMA = np.array([2e-3, 2e-3, 1e-3])


def rig():
    left = Camera(190.0, 190.0, 159.5, 119.5, (320, 240))
    return StereoRig(left, left.at(transform(np.eye(3), [0.07, 0.0, 0.0])))


def mirrors():
    return [
        Mirror.from_values([*np.radians(tilt), 0.2 + 0.02 * k], np.diag(SIGMA**2))
        for k, tilt in enumerate(TILTS)
    ]


def standpoints():
    return tuple(InMirror(mirror, rig().left.X_WC) for mirror in mirrors())


def painted(way):
    """Return a colour that changes smoothly over the ball. Shape (..., 3) -> (..., 3)."""
    waves = np.stack([np.sin(9.0 * way @ axis + k) for k, axis in enumerate(np.eye(3))], axis=-1)
    return 120.0 + 50.0 * waves


def shaded(way):
    """Return the colour of plain paint in one light. Shape (..., 3) -> (..., 3)."""
    light = np.clip(way @ np.array([0.0, -0.5, 0.87]), 0.0, 1.0)
    return 60.0 + 120.0 * light[..., None] ** 2 * np.array([1.0, 0.9, 0.8])


def look(camera, rng, paint=painted):
    """Return a picture of the ball, its outline and its depth, of one camera."""
    u, v = np.meshgrid(*(np.arange(n, dtype=float) for n in camera.image_size))
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2)
    ways = camera.directions(pixels) @ camera.X_WC[:3, :3].T
    off = camera.X_WC[:3, 3] - CENTER
    along = -ways @ off
    square = off @ off - along**2
    hit = along - np.sqrt(np.maximum(RADIUS**2 - square, 0.0))
    places = off + hit[:, None] * ways
    beyond = camera.fx * (np.sqrt(square) - RADIUS) / along
    color = np.where(beyond[:, None] < 0.0, paint(places / RADIUS), 90.0)
    color = color + rng.normal(0.0, 0.5, color.shape)
    depth = hit * (ways @ camera.X_WC[:3, 2])
    shape = u.shape
    return (
        color.reshape(*shape, 3),
        np.clip(beyond, -60.0, 60.0).reshape(shape),
        np.where(beyond < -1.0, depth, np.nan).reshape(shape),
    )


@cache
def seen(paint=painted):
    rng, views, depths = np.random.default_rng(0), [], []
    for k, mirror in enumerate(mirrors()):
        for side, camera in enumerate(MirrorRig(rig(), mirror).virtual.cameras):
            picture, beyond, depth = look(camera, rng, paint)
            views.append(ShapeView(k, side, picture, beyond))
            if side == 0:
                depths.append(DepthView(k, rig().left, depth))
    known = np.kron(np.eye(len(TILTS)), np.diag(SIGMA**2))
    return ShapeViews(tuple(views), rig(), standpoints(), (), known), tuple(depths)


def ball(radius, pitch=5e-3, front=None):
    grid = VoxelGrid.about(CENTER[None], radius + 0.02, pitch)
    distance = np.linalg.norm(grid.points - CENTER, axis=1) - radius
    if front is not None:
        distance[grid.points[:, 2] < front] = np.nan
    return surface_nets(grid, distance.reshape(grid.shape))


def fair_of(mesh, tau=1e-3):
    """Return the equations of a smooth surface, the same everywhere or at each vertex."""
    return FairSurface.of(mesh, Neighbours.of(mesh), np.full(len(mesh.vertices), tau))


def off(mesh):
    return np.linalg.norm(mesh.vertices - CENTER, axis=1) - RADIUS


def test_depths_and_outlines_of_a_ball_fuse_to_its_front_and_leave_its_back_unknown():
    views, depths = seen()
    grid = VoxelGrid.about(CENTER[None], RADIUS + 0.03, 6e-3)
    mesh = first_surface(grid, np.ones(len(grid.points), dtype=bool), views, depths)
    assert np.median(np.abs(off(mesh))) < 1.5e-3
    away = np.array([center - CENTER for center in views.centers()])
    outward = (mesh.vertices - CENTER) / np.linalg.norm(mesh.vertices - CENTER, axis=1)[:, None]
    facing = (outward @ (away / np.linalg.norm(away, axis=1)[:, None]).T).max(axis=1)
    assert np.mean(facing > -0.3) > 0.95


def test_mirrors_in_which_nothing_stands_show_no_surface():
    views, depths = seen()
    empty = tuple(replace(v, beyond=np.full_like(v.beyond, 60.0)) for v in views.views)
    grid = VoxelGrid.about(CENTER[None], 0.1, 0.01)
    nothing = tuple(replace(d, depth=np.full_like(d.depth, np.nan)) for d in depths)
    with pytest.raises(EstimationError, match="show no surface"):
        first_surface(grid, grid.points[:, 0] < 9.0, replace(views, views=empty), nothing)


@pytest.mark.slow
def test_a_ball_drawn_too_small_grows_to_its_size_and_says_how_well():
    views, _ = seen()
    rng = np.random.default_rng(1)
    told = views.placed(views.values + 0.5 * np.tile(SIGMA, len(TILTS)) * rng.standard_normal(18))
    start = ball(RADIUS - 4e-3, front=CENTER[2] - 0.01)
    found = refine_surface(start, lambda _: told, rng)
    sure = found.looks >= 6
    assert np.count_nonzero(sure) > 0.5 * len(sure)
    assert np.median(np.abs(off(found.mesh)[sure])) < 1e-3
    assert np.sqrt(np.mean((off(found.mesh)[sure] / found.sigma[sure]) ** 2)) < 1.3
    truth = np.array([m.values for m in mirrors()])
    before, after = (
        np.linalg.norm((np.array([m.values for m in own]) - truth) / SIGMA)
        for own in (told.standpoints, found.standpoints)
    )
    assert after < before


def blurred(views, sigma):
    smooth = [
        replace(v, picture=smoothed_within(v.picture, v.beyond < -0.5, sigma)) for v in views.views
    ]
    return replace(views, views=tuple(smooth))


@pytest.mark.slow
def test_plain_paint_that_darkens_aside_looks_deeper_the_more_it_is_blurred():
    views, _ = seen(shaded)
    start = ball(RADIUS)
    outward = (start.vertices - CENTER) / np.linalg.norm(start.vertices - CENTER, axis=1)[:, None]
    mesh = start.moved(CENTER + RADIUS * outward)
    asked = []
    for levels in (1.0, 0.5):
        found = PictureEquations.of(mesh, blurred(views, levels), blurred(views, 1.5))
        told = (found.looks >= 6) & (views.facing(mesh).max(axis=0) > 0.5)
        asked.append(found.pull[told].sum() / found.own[told].sum())
    assert asked[0] < -0.2e-3
    assert abs(asked[1]) < 0.1e-3  # as pictures have it: no outline that lies too far out hides it


def test_surface_and_mirrors_move_at_once_as_a_dense_solution_says():
    views, _ = seen()
    mesh, rng = ball(0.03, 0.015), np.random.default_rng(3)
    fair = fair_of(mesh, rng.uniform(5e-4, 1e-3, len(mesh.vertices)))
    size, count = len(mesh.vertices), len(views.values)
    own, coupling = rng.uniform(1e5, 1e6, size), rng.uniform(-1e6, 1e6, (size, count))
    bent = fair.bent(np.eye(size))
    A = np.diag(own) + bent.T @ (bent / fair.tau[:, None] ** 2)
    values = coupling.T @ np.linalg.solve(A, coupling) + 1e7 * np.eye(count)
    told = PictureEquations(
        own, rng.normal(0.0, 1e3, size), coupling, values, rng.normal(0.0, 1e3, count),
        np.zeros((size, 3)), np.ones(size), np.full(size, 9),
    )  # fmt: skip
    now = views.values + 1e-3 * rng.standard_normal(count)
    by, change, covariance = refinement._together(views, now, told, fair)
    known = np.linalg.inv(views.covariance)
    N = (values - coupling.T @ np.linalg.solve(A, coupling)) / refinement._ALIKE + known
    b = told.pull + fair.pull
    asked = (told.values_pull - coupling.T @ np.linalg.solve(A, b)) / refinement._ALIKE
    asked += known @ (views.values - now)
    np.testing.assert_allclose(change, np.linalg.solve(N, asked), rtol=1e-3, atol=1e-7)
    np.testing.assert_allclose(covariance, np.linalg.inv(N), rtol=1e-3, atol=1e-10)
    dense = np.linalg.solve(A, b - coupling @ change)
    np.testing.assert_allclose(by, dense, rtol=1e-2, atol=1e-6)


@pytest.mark.parametrize("scale", [0.2, 1.0])
def test_sigma_is_what_vertices_are_off_by_where_mirrors_and_cameras_are_wrong(scale):
    mesh, rng, draws = ball(0.03, 0.01), np.random.default_rng(5), 400
    fair = fair_of(mesh)
    size = len(mesh.vertices)
    own = rng.uniform(1e6, 3e6, size)
    coupling = own[:, None] * rng.uniform(0.5, 1.5, 7)
    root = scale * 1e-3 * rng.standard_normal((7, 7))
    told = PictureEquations(
        own, np.zeros(size), coupling, np.eye(7), np.zeros(7), np.zeros((size, 3)),
        np.ones(size), np.full(size, 9),
    )  # fmt: skip
    noise = np.sqrt(own)[:, None] * rng.standard_normal((size, draws))
    noise += fair.unbent(rng.standard_normal((size, draws)) / fair.tau[:, None])
    off = fair.solved(own, noise - coupling @ root @ rng.standard_normal((7, draws)))
    sigma = refinement._sigma(told, fair, root @ root.T, rng)
    assert np.sqrt(np.mean((off / sigma[:, None]) ** 2)) == pytest.approx(1.0, abs=0.1)
    alone = refinement._sigma(told, fair, 0.0 * root, rng)
    assert np.mean(sigma) > 1.5 * np.mean(alone)


def test_colours_that_disagree_where_a_surface_jumps_tell_nothing_of_what_is_about():
    mesh = ball(0.03, 0.01)
    size = len(mesh.vertices)
    jump = mesh.vertices[:, 0] > CENTER[0] + 0.02
    told = PictureEquations(
        np.full(size, 2e6), np.zeros(size), np.zeros((size, 1)), np.eye(1), np.zeros(1),
        np.zeros((size, 3)), np.where(jump, 60.0, 1.0), np.full(size, 20),
    )  # fmt: skip
    known = told, fair_of(mesh), np.zeros((1, 1))
    agreed = replace(told, chi_square=np.ones(size)), *known[1:]
    plain, about, apart = (
        refinement._sigma(*own, np.random.default_rng(0), which)
        for own, which in ((agreed, None), (known, None), (known, jump))
    )
    assert np.min(about[~jump] / plain[~jump]) > 1.1
    np.testing.assert_allclose(apart, plain)


def test_nothing_is_known_where_a_surface_jumps():
    views, _ = seen()
    rng, start = np.random.default_rng(0), ball(RADIUS, 0.02)

    def right(p):
        return p[:, 0] > CENTER[0] + 0.02

    found = refine_surface(start, lambda _: views, rng, steps=STEPS[-1:], jumps=right)
    assert 10 < right(found.mesh.vertices).sum() < 0.5 * len(start.vertices)
    assert np.array_equal(np.isinf(found.sigma), right(found.mesh.vertices))
    assert not claimed(found)[right(found.mesh.vertices)].any()
    whole = refine_surface(start, lambda _: views, rng, steps=STEPS[-1:])
    assert np.isfinite(whole.sigma).all()


def test_what_is_turned_away_or_beyond_the_outline_is_not_shown():
    views, _ = seen()
    mesh = ball(RADIUS)
    shown = views.shown(mesh)
    assert shown.any(axis=1).all()
    assert (views.facing(mesh)[shown] > 0.3).all()
    assert not shown[:, mesh.vertices[:, 2] < CENTER[2] - 0.6 * RADIUS].any()


def test_pixels_and_slopes_of_mirrored_points_agree():
    views, _ = seen()
    p, step = CENTER[None] + [[0.01, 0.02, 0.06]], 1e-6
    by_point = views.slopes(p)[3][0][0]
    for k in range(3):
        moved = [views.pixels(p + sign * step * np.eye(3)[k])[3][0] for sign in (1, -1)]
        np.testing.assert_allclose(by_point[:, k], (moved[0] - moved[1]) / (2 * step), rtol=1e-4)


def test_pixels_of_mirrored_points_move_with_the_cameras_as_is_said():
    views, _ = seen()
    views = replace(views, cameras=("left.fx", "right.k1", "right.pose.rx", "right.pose.x"))
    p = CENTER[None] + [[0.01, 0.02, 0.06]]
    for number, view in enumerate(views.views[2:4]):
        told = views.slopes(p)[2 + number][1][0, :, 3:]
        for k, name in enumerate(views.cameras):
            pixels = []
            for sign in (1, -1):
                inside = views.rig.values
                inside[views.rig.names.index(name)] += sign * 1e-6
                rig = views.rig.with_values(inside)
                pixels.append(replace(views, rig=rig).pixels(p)[2 + number][0])
            slope = (pixels[0] - pixels[1]) / 2e-6
            np.testing.assert_allclose(told[:, k], slope, rtol=1e-4, atol=1e-5)
        assert np.any(told[:, 0]) == (view.side == 0)


def test_a_ball_is_expected_as_it_is_and_a_dent_is_pulled_out():
    mesh = ball(RADIUS)
    fair = fair_of(mesh)
    assert np.abs(fair.bend).max() < 0.2e-3
    dent = np.zeros(len(mesh.vertices))
    dent[100] = -2e-3
    dented = mesh.moved(mesh.vertices + dent[:, None] * mesh.normals)
    fair = fair_of(dented)
    step = fair.solved(np.full(len(dent), 1e2), fair.pull[:, None])[:, 0]
    assert np.argmax(step) == 100
    assert step[100] > 1e-3


def test_conjugate_gradients_solve_what_a_dense_matrix_solves():
    mesh = ball(0.03, 0.015)
    fair = fair_of(mesh, np.linspace(4e-4, 1e-3, len(mesh.vertices)))
    size = len(mesh.vertices)
    diagonal = np.linspace(1e5, 1e6, size)
    bent = fair.bent(np.eye(size))
    dense = np.diag(diagonal) + bent.T @ (bent / fair.tau[:, None] ** 2)
    right = np.random.default_rng(0).standard_normal((size, 3))
    np.testing.assert_allclose(
        fair.solved(diagonal, right), np.linalg.solve(dense, right), rtol=1e-2, atol=1e-9
    )


def test_pictures_that_disagree_are_as_much_more_uncertain_and_smoothness_is_not():
    mesh = ball(0.03, 0.015)
    fair, size = fair_of(mesh, 1e-3), len(mesh.vertices)
    own = np.where(mesh.vertices[:, 0] > CENTER[0], 1e7, 1e5)  # of which the second hardly counts
    bent = fair.bent(np.eye(size)) / 1e-3
    inverse = np.linalg.inv(np.diag(own) + bent.T @ bent)
    for worse in (np.ones(size), np.full(size, 9.0)):
        known = np.diag(inverse @ (np.diag(worse * own) + bent.T @ bent) @ inverse)
        drawn = fair.drawn(own, np.random.default_rng(0), 1000, 300, worse)
        np.testing.assert_allclose(np.mean(drawn**2, axis=1), known, rtol=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("start", [6e-4, 1e-3])
def test_each_patch_tells_how_much_it_bends_and_what_nobody_sees_tells_nothing(start):
    mesh, rng = ball(0.08), np.random.default_rng(7)
    aside = mesh.vertices[:, 0] - CENTER[0]
    true = fair_of(mesh, np.where(aside > 0.0, 9e-4, 3.5e-4))
    size = len(mesh.vertices)
    surface = true.drawn(np.full(size, 1e-2 / 1e-6), rng, 1, 300)
    own = np.full(size, 1.0 / 0.4e-3**2)
    seen = surface + 0.4e-3 * rng.standard_normal((size, 1))
    shown = mesh.vertices[:, 1] < CENTER[1] + 0.02
    tau = np.full(size, start)
    for _ in range(8):
        fair = replace(true, tau=tau)
        best = fair.solved(own, own[:, None] * seen)
        at_best = replace(fair, bend=fair.bent(best)[:, 0])
        tau = at_best.told(fair.drawn(own, rng, 16, 80), shown, start)
    inside = mesh.vertices[:, 1] < CENTER[1] - 0.02
    for part, expected in ((aside > 0.03, 9e-4), (aside < -0.03, 3.5e-4)):
        told = np.sqrt(np.mean(tau[inside & part] ** 2))
        assert told == pytest.approx(expected, rel=0.15)
    far = mesh.vertices[:, 1] > CENTER[1] + 0.075
    np.testing.assert_allclose(tau[far], start, rtol=0.05)


def sigma_of(chi_square, looks=refinement.FEWEST, everywhere=False):
    mesh = ball(0.03, 0.01)
    size = len(mesh.vertices)
    each = np.ones(size)
    each[slice(None) if everywhere else 7] = chi_square
    told = PictureEquations(
        np.full(size, 1e6), np.zeros(size), np.zeros((size, 1)), np.eye(1), np.zeros(1),
        np.zeros((size, 3)), each, np.full(size, looks),
    )  # fmt: skip
    return refinement._sigma(told, fair_of(mesh), np.eye(1), np.random.default_rng(0))


def test_what_disagrees_in_pictures_is_less_sure_with_all_about_it_but_for_an_odd_place():
    plain, some, most = (sigma_of(one) for one in (1.0, 0.9 * refinement._ODD, refinement._ODD))
    assert (some > 1.05 * plain).mean() > 0.3
    assert (most > some).mean() > 0.3
    assert np.array_equal(sigma_of(1e6), most)
    np.testing.assert_allclose(sigma_of(1e6, refinement.FEWEST - 1), plain)


def test_colours_that_agree_better_than_expected_are_surer_and_a_place_hardly_shown_counts_as_one():
    told = sigma_of(0.2, everywhere=True)
    plain = sigma_of(1.0)
    assert (told < 0.8 * plain).all()
    few = sigma_of(0.2, refinement.FEWEST - 1, everywhere=True)
    np.testing.assert_allclose(few, plain)


def test_places_that_hardly_any_picture_shows_do_not_make_those_beside_them_surer():
    mesh = ball(0.03, 0.01)
    size = len(mesh.vertices)
    half = mesh.vertices[:, 0] > CENTER[0]
    looks = np.where(half, refinement.FEWEST, refinement.FEWEST - 1)
    told = PictureEquations(
        np.full(size, 1e6), np.zeros(size), np.zeros((size, 1)), np.eye(1), np.zeros(1),
        np.zeros((size, 3)), np.full(size, 50.0), looks,
    )  # fmt: skip
    shown = refinement.well_shown(told, fair_of(mesh).neighbours)
    known = fair_of(mesh), np.eye(1), np.random.default_rng(0)
    beside = refinement._sigma(told, *known)[shown]
    whole = refinement._sigma(replace(told, looks=np.full(size, 99)), *known)[shown]
    assert np.median(beside / whole) > 0.9


def test_values_between_pixels_are_linear_and_beyond_the_picture_unknown():
    v, u = np.mgrid[0:5, 0:7].astype(float)
    image = np.stack([u, 2.0 * v], axis=2)
    at = np.array([[1.25, 2.5], [6.0, 4.0], [6.1, 1.0], [np.nan, 0.0]])
    found = sampled(image, at)
    np.testing.assert_allclose(found[:2], [[1.25, 5.0], [6.0, 8.0]])
    assert np.isnan(found[2:]).all()
    np.testing.assert_allclose(nearest_of(u, at)[:2], [1.0, 6.0])


def test_a_turned_ball_keeps_its_neighbours():
    mesh = ball(0.03, 0.01)
    turned = mesh.moved(mesh.vertices @ rotation_from_vector([0.1, 0.2, 0.3]).T)
    ones = np.ones((len(mesh.vertices), 1))
    np.testing.assert_allclose(Neighbours.of(turned).means(ones), ones)

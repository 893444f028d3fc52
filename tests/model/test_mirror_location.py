"""Things found by their reflections."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_location import locate_in_mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.model.cameras.stereo_rig import StereoRig

RIG = StereoRig(
    Camera(381.0, 383.0, 326.0, 233.0, (640, 480), k1=-0.28, k2=0.09),
    Camera(
        379.0, 380.0, 315.0, 244.0, (640, 480), k1=-0.27, k2=0.085,
        X_WC=transform(np.eye(3), [0.07, 0.0, 0.0]),
    ),
)  # fmt: skip
GLASS = Mirror.from_values([0.1, -0.15, 0.48], np.diag([1e-3, 1e-3, 1e-3]) ** 2)
BEFORE = MirrorRig(RIG, GLASS)
THINGS = np.array([[0.05, 0.08, 0.25], [-0.03, 0.02, 0.1], [0.1, 0.1, -0.05]])


def test_a_thing_is_found_where_it_is():
    found = locate_in_mirror(BEFORE, BEFORE.project(THINGS), 0.3)
    assert_allclose([place.p_WQ for place in found], THINGS, atol=1e-9)
    for place in found:
        assert place.miss < 1e-6
        assert place.in_front_by == pytest.approx(float(GLASS.in_front_by(place.p_WQ)))
        assert set(place.as_document()) >= {"x_m", "y_m", "z_m", "sigma_mm"}


def test_depth_is_what_stereo_leaves_open():
    place = locate_in_mirror(BEFORE, BEFORE.project(THINGS[:1]), 0.3)[0]
    assert place.sigma_along > 4.0 * place.sigma_across
    # 0.3 px, 70 mm apart, at 0.7 m: z^2 sigma sqrt 2 / (f b) is about 8 mm.
    assert 5e-3 < place.sigma_along < 12e-3
    twice = locate_in_mirror(BEFORE, BEFORE.project(THINGS[:1]), 0.6)[0]
    assert twice.sigma_along == pytest.approx(2.0 * place.sigma_along, rel=0.05)


def test_things_scatter_as_their_covariance_says():
    rng = np.random.default_rng(0)
    pixels = np.tile(BEFORE.project(THINGS[:1]), (400, 1)) + rng.normal(0.0, 0.3, (400, 4))
    exact = MirrorRig(RIG, Mirror(GLASS.normal, GLASS.distance))
    found = np.array([place.p_WQ for place in locate_in_mirror(exact, pixels, 0.3)])
    expected = locate_in_mirror(exact, exact.project(THINGS[:1]), 0.3)[0].covariance
    ratio = np.linalg.eigvals(np.linalg.solve(expected, np.cov(found.T)))
    assert 0.75 < ratio.min() < ratio.max() < 1.3


def test_what_is_no_reflection_is_refused():
    direct = RIG.project(np.array([[0.03, 0.0, 0.25]]))
    with pytest.raises(ModelError, match="no reflection in this mirror"):
        locate_in_mirror(BEFORE, direct)
    swapped = BEFORE.project(THINGS[:1])[:, [2, 3, 0, 1]]
    with pytest.raises(ModelError, match="no reflection in this mirror"):
        locate_in_mirror(BEFORE, swapped)
    with pytest.raises(ValueError, match="shape"):
        locate_in_mirror(BEFORE, np.zeros((1, 2)))
    with pytest.raises(ValueError, match="finite"):
        locate_in_mirror(BEFORE, np.full((1, 4), np.nan))


def apart(miss):
    """Return pixels whose lines of sight pass each other by so many pixels in all."""
    pixels = BEFORE.project(THINGS[:1])
    # The direction that no place moves: along it the triangulation leaves everything.
    free = BEFORE.projection(THINGS[:1]).by_point[0]
    return pixels + miss * np.linalg.svd(free)[0][:, 3]


def test_lines_of_sight_that_pass_each_other_make_the_place_unsure():
    meeting, passing = (locate_in_mirror(BEFORE, apart(m), 0.3)[0] for m in (0.0, 1.2))
    assert meeting.chi_square < 1e-9
    assert passing.chi_square == pytest.approx(1.2**2 / 0.1, rel=1e-3)
    assert passing.miss == pytest.approx(1.2 / np.sqrt(2.0), rel=1e-3)
    assert passing.sigma / meeting.sigma == pytest.approx(np.sqrt(passing.chi_square), rel=1e-3)
    # Closer than was to be expected is no surer.
    near = locate_in_mirror(BEFORE, apart(0.1), 0.3)[0]
    assert near.sigma == pytest.approx(meeting.sigma, rel=1e-3)
    assert near.as_document()["chi_square"] == near.chi_square


def test_lines_of_sight_far_apart_are_not_of_one_thing():
    with pytest.raises(ModelError, match=r"pass each other by 8\.7 px, where 0\.32 px are"):
        locate_in_mirror(BEFORE, np.concatenate([apart(0.0), apart(8.7)]), 0.3)
    # Five standard deviations are the limit; pixels known worse may miss by more.
    limit = 5.0 * np.hypot(0.3, 0.1)
    assert locate_in_mirror(BEFORE, apart(0.99 * limit), 0.3)[0].sigma > 0.02
    with pytest.raises(ModelError, match="not of one thing"):
        locate_in_mirror(BEFORE, apart(1.01 * limit), 0.3)
    assert locate_in_mirror(BEFORE, apart(8.7), 3.0)[0].chi_square < 9.0


def test_the_miss_of_noisy_pixels_is_chi_square_of_one():
    rng = np.random.default_rng(1)
    pixels = np.tile(BEFORE.project(THINGS[:1]), (400, 1)) + rng.normal(0.0, 0.3, (400, 4))
    found = np.array([place.chi_square for place in locate_in_mirror(BEFORE, pixels, 0.3)])
    assert np.mean(found) == pytest.approx(0.9, abs=0.2)

"""The circle fitted to points in space."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nico_selfmodel.geometry.circle import Circle
from nico_selfmodel.geometry.circle_variants import circle_with_angles, robust_circle
from nico_selfmodel.geometry.rotation import rotation_about, tangent_basis

FITS = {
    "free": lambda points: Circle.from_points(points),
    "with angles": lambda points: circle_with_angles(points, np.linspace(0, 1, len(points))),
    "robust": lambda points: robust_circle(points, np.random.default_rng(0))[0],
}
SEED = st.integers(0, 2**32 - 1)


@pytest.mark.parametrize("count", [3, 26])
@given(seed=SEED, arc_deg=st.floats(60.0, 330.0))
def test_points_without_noise_give_the_circle_itself(
    make_arc, assert_same_circle, count, seed, arc_deg
):
    truth = make_arc(seed, count, arc_deg)
    circle = Circle.from_points(truth.points)
    assert_same_circle(circle, truth, 1e-12)
    assert circle.rms < 1e-12
    largest_gap = max(360.0 - arc_deg, arc_deg / (count - 1))
    assert np.degrees(circle.arc) == pytest.approx(360.0 - largest_gap, abs=1e-6)


@given(seed=SEED)
def test_the_fit_is_a_minimum_of_the_distances(make_arc, seed):
    points = make_arc(seed, 20, 120.0, sigma=0.001).points
    circle = Circle.from_points(points)
    rng = np.random.default_rng(seed)

    def rms(center, normal, radius):
        moved = Circle(center, normal, radius, 0.0, 0.0, None)
        return np.sqrt(np.mean(np.sum(moved.residuals_to(points) ** 2, axis=1)))

    best = rms(circle.center, circle.normal, circle.radius)
    assert best == pytest.approx(circle.rms, rel=1e-12)
    for _ in range(10):
        turn = rotation_about(tangent_basis(circle.normal)[:, rng.integers(2)], rng.normal() * 0.02)
        center = circle.center + rng.normal(0.0, 0.002, 3)
        assert rms(center, turn @ circle.normal, circle.radius + rng.normal() * 0.002) > best


@pytest.mark.slow
def test_short_arcs_do_not_shrink_as_kasas_circle_does(make_arc):
    ours, kasa = [], []
    for seed in range(300):
        arc = make_arc(seed, 26, 60.0, sigma=0.001)
        ours.append(Circle.from_points(arc.points).radius)
        xy = (arc.points - arc.center) @ tangent_basis(arc.normal)
        design = np.column_stack([2.0 * xy, np.ones(len(xy))])
        a, b, c = np.linalg.lstsq(design, np.sum(xy**2, axis=1), rcond=None)[0]
        kasa.append(np.sqrt(c + a * a + b * b))
    assert np.median(ours) == pytest.approx(0.127, abs=0.0012)
    assert np.median(kasa) < 0.127 - 0.002


@pytest.mark.slow
@pytest.mark.parametrize("known_sigma", [True, False], ids=["known sigma", "from residuals"])
def test_the_covariance_is_the_spread_of_two_hundred_fits(make_arc, parameter_errors, known_sigma):
    errors, predicted, consistency = [], [], []
    for seed in range(200):
        truth = make_arc(seed, 26, 150.0, sigma=0.001)
        circle = Circle.from_points(truth.points, sigma=0.001 if known_sigma else None)
        error = parameter_errors(circle, truth)
        errors.append(error)
        predicted.append(np.diag(circle.covariance))
        consistency.append(error @ np.linalg.solve(circle.covariance, error) / 6.0)
    # The basis turns with the normal, so single directions in the plane are compared together.
    spread, expected = np.mean(np.square(errors), axis=0), np.mean(predicted, axis=0)
    groups = np.array([[1, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 1, 0], [0] * 5 + [1]])
    ratio = np.sqrt(groups @ spread / (groups @ expected))
    assert np.all((ratio > 0.85) & (ratio < 1.15)), ratio
    assert 0.85 < np.mean(consistency) < 1.15


def test_three_points_have_a_covariance_only_if_sigma_is_known(make_arc):
    points = make_arc(1, 3, 100.0).points
    assert Circle.from_points(points).covariance is None
    small = Circle.from_points(points, sigma=0.001).covariance
    large = Circle.from_points(points, sigma=0.002).covariance
    assert np.linalg.eigvalsh(small).min() > 0.0
    assert large == pytest.approx(4.0 * small)


def test_the_sagitta_is_the_height_of_the_arc_over_its_chord(make_arc):
    for arc_deg in (20.0, 90.0, 180.0):
        truth = make_arc(2, 11, arc_deg)
        chord = 0.5 * (truth.points[0] + truth.points[-1])
        height = np.linalg.norm(truth.points[5] - chord)
        assert Circle.from_points(truth.points).sagitta == pytest.approx(height, abs=1e-10)


def test_residuals_and_angles_are_measured_in_the_circles_own_frame(make_arc):
    truth = make_arc(3, 9, 200.0)
    circle = Circle.from_points(truth.points)
    out = (truth.points - truth.center) / truth.radius
    moved = truth.points + 0.01 * out + 0.02 * circle.normal
    assert circle.residuals_to(moved) == pytest.approx(np.tile([0.01, 0.02], (9, 1)), abs=1e-11)
    turned = np.sign(circle.normal @ truth.normal) * (truth.angles - truth.angles[0])
    assert np.exp(1j * circle.angles_of(moved)) == pytest.approx(np.exp(1j * turned), abs=1e-10)


@pytest.mark.parametrize("fit", FITS.values(), ids=FITS)
@pytest.mark.parametrize(
    "points",
    [
        np.array([0.1, 0.2, 0.3]) + np.outer(np.linspace(0.0, 1.0, 8), [0.3, -0.5, 0.7]),
        np.tile([0.1, 0.2, 0.3], (8, 1)),
        np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
        np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]] * 4),
        np.vstack([np.random.default_rng(0).normal(size=(7, 3)), [np.nan, 0.0, 0.0]]),
        np.random.default_rng(0).normal(size=(8, 2)),
    ],
    ids=["collinear", "coincident", "two points", "two places", "nan", "flat table"],
)
def test_points_that_make_no_circle_are_refused(fit, points):
    with pytest.raises(ValueError, match=r"\w"):
        fit(points)

"""Circle point analysis: exact where nothing is noisy, whatever the sweeps look like."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.sweeps import Sweep
from nico_selfmodel.estimation.arm.kinematic_task import sweeps_of
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.initialization.circle_points import (
    analyse_circle_points,
    crossing_of,
)
from nico_selfmodel.estimation.observations.observations import Observations

from ..slow_rest import slow_rest

EXACT = 1e-9


def learned(dataset, **options):
    return calibrate_kinematics(dataset, method="circle-points", **options)


def analysed(dataset, gears_known):
    observations = Observations.from_dataset(dataset)
    known = np.full(len(dataset.joints), gears_known)
    sweeps = sweeps_of(dataset, observations)
    return analyse_circle_points(observations, sweeps, known, np.random.default_rng(0))


@pytest.mark.parametrize("unit", slow_rest(["counts", "rad", "deg"]))
@pytest.mark.parametrize("points", [3, 26])
@pytest.mark.parametrize("n", slow_rest([4, 6, 7]))
def test_circles_without_noise_give_the_exact_arm(make_truth, n, points, unit):
    for seed in range(3):
        truth = make_truth(n, seed, unit=unit)
        result = learned(truth.dataset(*truth.sweeps(points)))
        assert truth.errors(result.model, truth.poses(50, seed)).max() < EXACT
        assert result.model.servos.gear == pytest.approx(truth.servos.gear, rel=1e-9)
        assert len(result.circles.circles) == n
        assert all(fit.inliers.all() for fit in result.circles.circles)


@pytest.mark.parametrize("unit", slow_rest(["counts", "rad"]))
def test_a_grid_of_poses_is_full_of_circles_at_other_homes(make_truth, unit):
    truth = make_truth(3, 4, unit=unit, markers=2)
    axis = np.linspace(-0.7, 0.7, 5)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    result = learned(truth.dataset(grid, missing=0.1, seed=1))
    assert len(result.circles.circles) > 0.9 * 2 * 3 * 25
    assert truth.errors(result.model, truth.poses(50, 1)).max() < EXACT


def test_sweeps_that_nobody_marked_are_found_in_the_encoders(make_truth, joined):
    truth = make_truth(4, 2, unit="counts")
    data = joined(truth.dataset(truth.sweeps(9)[0]), truth.dataset(truth.poses(40, 1)))
    assert not (data.sweep != "").any()
    result = learned(data)
    assert {fit.joint for fit in result.circles.circles} == {0, 1, 2, 3}
    assert truth.errors(result.model, truth.poses(50, 1)).max() < EXACT


def test_a_joint_that_nobody_marked_is_found_beside_those_that_are_marked(make_truth):
    truth = make_truth(4, 2, unit="counts")
    q, labels = truth.sweeps(9)
    labels = ["" if label == "joint_2" else label for label in labels]
    assert truth.errors(learned(truth.dataset(q, labels)).model, truth.poses(50)).max() < EXACT


@pytest.mark.slow
def test_the_order_of_the_rows_does_not_matter(make_truth):
    truth = make_truth(5, 1, unit="counts", markers=2)
    data = truth.dataset(*truth.sweeps(12), sigma=5e-4)
    backwards = data.select(np.arange(len(data))[::-1])
    models = [learned(d).model for d in (data, backwards)]
    there, back = (m.predict(data.encoders, "hand").p_WH for m in models)
    assert there == pytest.approx(back, abs=1e-12)


def test_the_way_a_joint_turns_goes_into_its_axis_and_gears_stay_positive(make_truth):
    truth = make_truth(4, 3, unit="counts")
    turned = replace(truth, chain=replace(truth.chain, directions=-truth.chain.directions))
    axes = []
    for arm in (truth, turned):
        result = learned(arm.dataset(*arm.sweeps(7)))
        assert (result.model.servos.gear > 0.0).all()
        assert arm.errors(result.model, arm.poses(50)).max() < EXACT
        axes.append(result.circles.directions)
    assert axes[0] == pytest.approx(-axes[1], abs=1e-9)


@pytest.mark.slow
def test_circles_of_several_markers_are_one_axis(make_truth):
    truth = make_truth(4, 6, unit="counts", markers=3)
    q, labels = truth.sweeps(15)
    one, three = (
        np.mean(
            [
                truth.errors(learned(data).model, truth.poses(100, seed)).mean()
                for seed in range(6)
                for data in [truth.dataset(q, labels, sigma=1e-3, missing=missing, seed=seed)]
            ]
        )
        for missing in (0.5, 0.0)
    )
    assert three < 0.8 * one
    exact = learned(truth.dataset(q, labels, missing=0.3, seed=2)).model
    assert truth.errors(exact, truth.poses(50)).max() < EXACT


def test_a_marker_that_no_sweep_saw_is_placed_by_the_free_poses(make_truth, joined):
    truth = make_truth(4, 6, unit="counts", markers=2)
    circles = truth.dataset(*truth.sweeps(8))
    data = joined(circles.select(circles.marker == "hand"), truth.dataset(truth.poses(10)))
    result = learned(data)
    assert result.model.markers == ("hand", "thumb")
    assert truth.errors(result.model, truth.poses(50)).max() < EXACT


def test_a_sweep_of_more_than_half_a_turn_is_unwrapped_in_the_encoders_order(make_truth):
    truth = make_truth(4, 5, unit="counts")
    result = learned(truth.dataset(*truth.sweeps(26, arc=5.5)))
    assert truth.errors(result.model, truth.poses(50)).max() < EXACT


def test_wrong_points_do_not_move_the_circles(make_truth):
    truth = make_truth(4, 5, unit="counts")
    q, labels = truth.sweeps(26)
    right = truth.dataset(q, labels)
    wrong = np.random.default_rng(3).random(len(q)) < 0.2
    wrong[0] = False
    p = right.p_WH_measured + 0.05 * wrong[:, None]
    result = learned(replace(right, p_WH_measured=p))
    assert truth.errors(result.model, truth.poses(50)).max() < EXACT
    for fit in result.circles.circles:
        assert np.array_equal(fit.inliers, ~wrong[fit.rows])


@pytest.mark.slow
def test_known_gears_place_the_centres_of_short_arcs(make_truth):
    truth = make_truth(4, 7)
    d, c = truth.chain.directions[0], truth.chain.points[0]
    errors = {True: [], False: []}
    for seed in range(10):
        data = truth.dataset(*truth.sweeps(26, arc=0.7), sigma=3e-4, seed=seed)
        for known in errors:
            found = analysed(data, known).circles[0].circle.center
            errors[known].append(np.linalg.norm(np.cross(found - c, d)))
    assert np.mean(errors[True]) < 0.3 * np.mean(errors[False])


@pytest.mark.slow
def test_the_noise_and_the_axes_uncertainty_are_those_of_many_recordings(make_truth):
    truth = make_truth(4, 8, unit="counts")
    q, labels = truth.sweeps(26)
    found = [analysed(truth.dataset(q, labels, sigma=5e-4, seed=seed), False) for seed in range(40)]
    assert np.mean([f.noise for f in found]) == pytest.approx(5e-4, rel=0.05)
    first = np.array([f.directions[0] for f in found])
    tilt = np.linalg.svd(first - first.mean(axis=0), compute_uv=False)[0] / np.sqrt(39)
    assert np.mean([f.axis_sigma[0] for f in found]) == pytest.approx(tilt, rel=0.3)
    assert all(f.trusted.all() for f in found)


@pytest.mark.slow
@pytest.mark.parametrize("points", [8, 12, 26])
def test_the_noise_of_few_points_is_not_underestimated(make_truth, points):
    """Good points that are thrown away make what is left look better than it is."""
    truth = make_truth(2, 8, unit="counts")
    q, labels = truth.sweeps(points)
    found = [analysed(truth.dataset(q, labels, sigma=5e-4, seed=s), False) for s in range(30)]
    kept = np.mean([fit.inliers.mean() for analysis in found for fit in analysis.circles])
    assert kept > 0.9
    noise = np.sqrt(np.mean([analysis.noise**2 for analysis in found]))
    assert noise == pytest.approx(5e-4, rel=0.2)


def test_the_zero_is_where_the_sweeps_cross(make_truth):
    truth = make_truth(3, 1)
    home = np.array([0.3, -0.2, 0.1])
    q, labels = truth.sweeps(8, home=home)
    data = truth.dataset(np.vstack([q, truth.poses(30)]), [*labels, *[""] * 30])
    observations = Observations.from_dataset(data)
    sweeps = sweeps_of(data, observations)
    assert crossing_of(observations.angles, sweeps) == pytest.approx(home + truth.servos.offset)
    anywhere = crossing_of(observations.angles, [Sweep(0, np.array([40, 41, 42]))])
    assert anywhere.tolist() in observations.angles[40:43].tolist()

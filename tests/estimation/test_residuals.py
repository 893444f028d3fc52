"""Residuals of hand points: derivatives, and two programs and three solvers with one minimum."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.arm.named_refinement import dh_program
from nico_selfmodel.estimation.initialization.axis_search import project_variables, random_starts
from nico_selfmodel.estimation.initialization.start_search import line_program
from nico_selfmodel.estimation.observations.arm_estimate import ArmEstimate
from nico_selfmodel.estimation.observations.hand_residuals import DhResiduals, LineResiduals
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.model.arm.dh_table import DhTable

from ..slow_rest import slow_rest

SIGMA = 1e-3


def near(truth, seed, size=0.02):
    """Return the arm as somebody accepts it: axes and points a little off, zero readings kept."""
    rng = np.random.default_rng(seed)
    chain = truth.chain
    tilted = chain.directions + rng.normal(0.0, size, chain.directions.shape)
    wrong = replace(
        chain,
        directions=tilted / np.linalg.norm(tilted, axis=1, keepdims=True),
        points=chain.points + rng.normal(0.0, 0.2 * size, chain.points.shape),
        p_WH_zero=chain.p_WH_zero + rng.normal(0.0, 0.2 * size, chain.p_WH_zero.shape),
    )
    return ArmEstimate(wrong, truth.servos.gear * (1.0 + 0.01 * rng.normal()), truth.servos.offset)


def seen(truth, count=60, sigma=5e-4, missing=0.2):
    return Observations.from_dataset(
        truth.dataset(truth.poses(count, 1), sigma=sigma, missing=missing, seed=1)
    )


def dh_of(observations, arm):
    servos = replace(observations.units, offset=arm.zero, gear=arm.gear)
    return DhParameters(DhTable.from_chain(arm.chain), servos)


def assert_derivatives(block, x, step=1e-6, scale=None):
    slopes = block.evaluate(x)[1].copy()
    scale = np.ones(len(x)) if scale is None else scale
    for i, unit in enumerate(np.eye(len(x))):
        ahead = block.evaluate(x + step * scale * unit)[0].copy()
        behind = block.evaluate(x - step * scale * unit)[0].copy()
        numeric = (ahead - behind) / (2.0 * step)
        largest = max(np.abs(numeric).max(), 1.0)
        assert slopes[i] * scale[i] == pytest.approx(numeric, abs=1e-6 * largest), block.names[i]


@pytest.mark.parametrize("kind", slow_rest(["parallel", "outlying", "elbow"]))
@pytest.mark.parametrize("unit", slow_rest(["counts", "rad"]))
def test_the_derivatives_of_the_lines_hold_away_from_the_start_too(make_truth, unit, kind):
    truth = make_truth(5, 2, unit=unit, kind=kind, markers=3)
    block = LineResiduals(seen(truth), near(truth, 3), SIGMA)
    assert len(block.names) == len(block.start) == 5 * 5 + 3 * 3
    assert_derivatives(block, block.start)
    rng = np.random.default_rng(4)
    assert_derivatives(block, block.start + 0.05 * rng.normal(size=len(block.start)))


@pytest.mark.parametrize("kind", ["outlying", "elbow", "parallel"])
def test_the_derivatives_of_the_named_parameters_hold(make_truth, kind):
    truth = make_truth(4, 2, unit="counts", kind=kind, markers=2)
    observations = seen(truth)
    named = dh_of(observations, near(truth, 3))
    block, scale = DhResiduals(observations, named, SIGMA), named.scales(observations.size)
    x = named.values + 0.02 * scale * np.random.default_rng(4).normal(size=len(block.names))
    assert_derivatives(block, x, step=1e-5, scale=scale)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 3.1, 3.3, 6.0])
def test_the_derivatives_by_the_base_hold_beyond_half_a_turn(make_truth, angle):
    truth = make_truth(3, 2, unit="counts")
    observations = seen(truth)
    named = dh_of(observations, near(truth, 3))
    x = named.values.copy()
    x[3:6] = angle * np.array([0.6, 0.0, 0.8])
    scale = named.scales(observations.size)
    assert_derivatives(DhResiduals(observations, named, SIGMA), x, step=1e-5, scale=scale)


def test_the_residuals_are_predicted_minus_measured_in_sigmas(make_truth):
    truth = make_truth(4, 1, unit="counts", markers=2)
    observations, arm = seen(truth), near(truth, 5)
    off = arm.predict(observations.angles, observations.marker) - observations.p_WH
    lines = LineResiduals(observations, arm, SIGMA)
    assert lines.evaluate(lines.start)[0] == pytest.approx(off.T / SIGMA)
    named = dh_of(observations, arm)
    by_name = DhResiduals(observations, named, SIGMA)
    assert by_name.evaluate(named.values)[0] == pytest.approx(off.T / SIGMA, abs=1e-9)


def test_chart_coordinates_lead_to_the_arm_that_the_residuals_are_of(make_truth):
    truth = make_truth(4, 1, unit="counts", markers=2)
    observations = seen(truth)
    block = LineResiduals(observations, near(truth, 5), SIGMA)
    x = block.start + 0.1 * np.random.default_rng(1).normal(size=len(block.start))
    backwards = x.copy()
    backwards[4] *= -1.0
    for y in (x, backwards):
        arm = block.hypothesis(y)
        assert (arm.gear > 0.0).all()
        off = arm.predict(observations.angles, observations.marker) - observations.p_WH
        assert block.evaluate(y)[0] == pytest.approx(off.T / SIGMA, abs=1e-9)


@pytest.mark.parametrize("kind", ["elbow", "parallel"])
@pytest.mark.parametrize("unit", ["rad", "counts"])
def test_lines_and_named_parameters_have_the_same_minimum(make_truth, unit, kind):
    truth = make_truth(5, 3, unit=unit, kind=kind, markers=2)
    observations = seen(truth)
    known = np.full(5, unit == "rad")
    start = near(truth, 6)
    if unit == "rad":
        start = replace(start, gear=np.ones(5))
    lines, block = line_program(observations, start, known, SIGMA)
    named = dh_of(observations, start)
    held = {f"{joint}.gear" for joint in truth.chain.joints} if unit == "rad" else set()
    free = frozenset(named.names) - named.gauge - held
    assert len(free) == 4 * 5 + 3 * 2 + (0 if unit == "rad" else 5) == lines.free.sum()
    program = dh_program(observations, named, free, SIGMA)
    a, b = lines.solve(tolerance=1e-12), program.solve(tolerance=1e-12, max_iterations=300)
    assert a.converged
    assert b.converged
    assert a.cost == pytest.approx(b.cost, rel=1e-7)
    expected = block.hypothesis(a.x).predict(observations.angles, observations.marker)
    found = named.with_values(b.x).predict(observations.angles, observations.marker)[0]
    assert found == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("solver", "view"),
    [
        ("snopt", "lines"),
        pytest.param("ipopt", "lines", marks=pytest.mark.slow),
        ("snopt", "named"),
    ],
)
def test_drakes_solvers_find_the_minimum_of_the_very_same_program(make_truth, solver, view):
    truth = make_truth(2, 3, unit="counts")
    observations, start = seen(truth), near(truth, 6, size=0.005)
    program = line_program(observations, start, np.zeros(2, dtype=bool), SIGMA)[0]
    if view == "named":
        named = dh_of(observations, start)
        program = dh_program(observations, named, frozenset(named.names) - named.gauge, SIGMA)
    ours, theirs = program.solve(), program.solve(solver)
    assert theirs.converged
    assert theirs.cost == pytest.approx(ours.cost, rel=1e-4)
    assert theirs.cost > ours.cost * (1.0 - 1e-9)


@pytest.mark.parametrize("unit", ["rad", "counts"])
def test_the_projected_search_ends_where_the_whole_problem_does(make_truth, unit):
    truth = make_truth(4, 3, unit=unit, kind="elbow", markers=2)
    observations = seen(truth)
    known = np.full(4, unit == "rad")
    start = replace(near(truth, 6), gear=np.ones(4)) if unit == "rad" else near(truth, 6)
    directions, gear = start.chain.directions[None], start.gear[None]
    (arm,) = project_variables(observations, directions, gear, known, start.zero, rounds=1)
    program, block = line_program(observations, start, known, SIGMA)
    best = block.hypothesis(program.solve(tolerance=1e-12).x)
    found = arm.predict(observations.angles, observations.marker)
    assert found == pytest.approx(
        best.predict(observations.angles, observations.marker), abs=0.3 * 5e-4
    )


@pytest.mark.slow
def test_random_starts_come_from_the_seed_and_often_reach_the_arm(make_truth):
    truth = make_truth(4, 3, unit="counts")
    observations = seen(truth, count=80, missing=0.0)
    zero = np.median(observations.angles, axis=0)

    def starts(seed):
        rng = np.random.default_rng(seed)
        return random_starts(observations, np.zeros(4, dtype=bool), zero, rng)

    first, again, other = (next(starts(seed)).chain.directions for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    errors = [
        np.median(np.linalg.norm(arm.predict(observations.angles, 0) - observations.p_WH, axis=1))
        for arm, _ in zip(starts(1), range(8), strict=False)
    ]
    assert np.sum(np.array(errors) < 1.5e-3) >= 2


def test_random_starts_stay_near_believed_axes_every_second_time(make_truth):
    truth = make_truth(4, 3)
    observations = seen(truth, count=80, missing=0.0)
    inliers = truth.chain.directions.copy()
    inliers[2] = np.nan
    starts = random_starts(
        observations,
        np.ones(4, dtype=bool),
        np.zeros(4),
        np.random.default_rng(0),
        directions=inliers,
        gear=np.where(np.arange(4) == 2, np.nan, 1.0),
    )
    arms = [next(starts) for _ in range(6)]
    rms = [
        np.sqrt(np.mean((arm.predict(observations.angles, 0) - observations.p_WH) ** 2))
        for arm in arms
    ]
    assert max(rms[1::2]) < 2.0 * 5e-4

"""Robust solution: gross outliers are named and change nothing."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from nico_selfmodel.optimization.calibration_program import CalibrationProgram
from nico_selfmodel.optimization.losses import Loss
from nico_selfmodel.optimization.residual_block import remembers_last
from nico_selfmodel.optimization.robust_solve import ROBUST_METHODS, RobustSolution, solve_robustly

from ..slow_rest import slow_rest
from .dense_jacobian import whitened_jacobian

SIGMA = 0.01
TRUTH = np.array([0.4, -0.2, 0.9, 1.5, 2.0])


class HelixBlock:
    """Points c + R (cos wt, sin wt, t) on a helix: three coordinates, not linear in w."""

    names = ("cx", "cy", "cz", "radius", "rate")

    def __init__(self, t, points):
        self.t, self.points = t, points

    def evaluate(self, x):
        cosine, sine = np.cos(x[4] * self.t), np.sin(x[4] * self.t)
        zero, one = np.zeros_like(self.t), np.ones_like(self.t)
        shape = np.stack([cosine, sine, self.t])
        slope = x[3] * self.t * np.stack([-sine, cosine, zero])
        centre = np.stack([[one, zero, zero], [zero, one, zero], [zero, zero, one]])
        jacobian = np.concatenate([centre, shape[None], slope[None]])
        return (x[:3, None] + x[3] * shape - self.points) / SIGMA, jacobian / SIGMA


@dataclass
class Case:
    program: CalibrationProgram
    number: int
    block: HelixBlock
    bad: NDArray


@pytest.fixture
def make_case():
    def make(seed, fraction, count=80, sigma=SIGMA):
        rng = np.random.default_rng(seed)
        t = np.linspace(0.0, 2.0, count)
        points = SIGMA * HelixBlock(t, np.zeros((3, count))).evaluate(TRUTH)[0]
        points = points + rng.normal(0.0, sigma, (3, count))
        bad = rng.permutation(count) < round(fraction * count)
        away = rng.normal(size=(3, count))
        away *= rng.uniform(20 * SIGMA, 100 * SIGMA, count) / np.linalg.norm(away, axis=0)
        program = CalibrationProgram()
        program.add_variables(HelixBlock.names, TRUTH + 0.05)
        block = HelixBlock(t, points + away * bad)
        return Case(program, program.add_residuals(block), block, bad)

    return make


def errors(make_case, method, fraction, seeds=25):
    found = []
    for seed in range(seeds):
        case = make_case(seed, fraction)
        found.append(solve_robustly(case.program, case.number, method).solution.x - TRUTH)
    return np.sqrt(np.mean(np.square(found), axis=0))


@pytest.mark.parametrize("fraction", [0.1, 0.3])
def test_outliers_are_named_and_the_solution_is_that_of_the_others(make_case, fraction):
    scales = []
    for seed in range(10):
        case = make_case(seed, fraction)
        found = solve_robustly(case.program, case.number)
        assert isinstance(found, RobustSolution)
        assert np.array_equal(found.outliers, case.bad)
        assert found.solution.converged
        assert found.iterations >= found.solution.iterations
        scales.append(found.scale)
        # least squares of what is left
        r, jacobian = case.block.evaluate(found.solution.x)
        keep = ~case.bad
        gradient = np.tensordot(jacobian[:, :, keep], r[:, keep], axes=2)
        assert np.abs(gradient / np.linalg.norm(jacobian, axis=(1, 2))).max() < 1e-3
    # The scale is that of the good coordinates, however many others there are.
    assert np.mean(scales) == pytest.approx(1.0, abs=0.06)
    assert np.max(np.abs(np.subtract(scales, 1.0))) < 0.25


@pytest.mark.parametrize(
    ("method", "fraction", "limit"),
    slow_rest(
        [
            ("trimmed", 0.3, 1.35),
            ("tukey", 0.3, 1.4),
            ("cauchy", 0.3, 1.5),
            ("huber", 0.1, 1.7),
            ("trimmed", 0.1, 1.25),
            ("tukey", 0.1, 1.25),
            ("cauchy", 0.1, 1.3),
        ],
        plain=4,
    ),
)
def test_a_robust_loss_keeps_the_accuracy_of_clean_data(make_case, method, fraction, limit):
    clean = errors(make_case, "none", 0.0)
    assert np.mean(errors(make_case, method, fraction) / clean) < limit
    assert np.mean(errors(make_case, "none", fraction) / clean) > 5.0


@pytest.mark.parametrize("method", ROBUST_METHODS)
def test_clean_data_lose_nothing(make_case, method):
    case = make_case(3, 0.0)
    clean = solve_robustly(make_case(3, 0.0).program, 0, "none").solution
    found = solve_robustly(case.program, case.number, method)
    assert not found.outliers.any()
    covariance = np.linalg.inv(case.program.normal_equations(clean.x)[2])
    assert np.all(np.abs(found.solution.x - clean.x) < np.sqrt(np.diag(covariance)))
    assert found.scale == pytest.approx(1.0, abs=0.15)


def test_without_a_loss_nothing_is_called_an_outlier(make_case):
    case = make_case(1, 0.3)
    found = solve_robustly(case.program, case.number, "none")
    assert not found.outliers.any()
    assert found.outliers.shape == (80,)
    residuals = case.program.residuals(case.number, found.solution.x)
    assert found.scale == pytest.approx(np.sqrt(np.mean(residuals**2)))


def test_without_noise_the_solution_is_exact_and_rounding_is_no_outlier(make_case):
    for method in ("trimmed", "cauchy", "tukey", "huber"):
        case = make_case(2, 0.2, sigma=0.0)
        found = solve_robustly(case.program, case.number, method)
        assert np.array_equal(found.outliers, case.bad), method
        assert found.solution.x == pytest.approx(TRUTH, abs=1e-6 if method != "huber" else 1e-3)


def test_the_program_goes_on_from_the_solution(make_case):
    case = make_case(4, 0.1)
    found = solve_robustly(case.program, case.number)
    assert case.program.start.tolist() == found.solution.x.tolist()
    assert case.program.solve().cost == pytest.approx(found.solution.cost, rel=1e-6)


def test_only_the_given_block_is_protected(make_case):
    case = make_case(6, 0.1)
    t = np.linspace(0.0, 2.0, 20)
    points = SIGMA * HelixBlock(t, np.zeros((3, 20))).evaluate(TRUTH)[0]
    points[:, 3] += 1.0  # an outlier that nobody asked about
    case.program.add_residuals(HelixBlock(t, points))
    before = whitened_jacobian(case.program, TRUTH)[240:]
    solve_robustly(case.program, case.number, "tukey")
    after = whitened_jacobian(case.program, TRUTH)
    assert np.array_equal(after[240:], before)
    ignored = np.all(after[:240].reshape(3, 80, 5) == 0.0, axis=(0, 2))
    assert np.all(ignored[case.bad])


def test_unknown_methods_are_refused(make_case):
    case = make_case(0, 0.0)
    with pytest.raises(ValueError, match="no loss 'median'; there are trimmed, none, huber"):
        solve_robustly(case.program, 0, "median")


class LinearBlock:
    """Twenty observations of three coordinates, each with slopes of its own."""

    names = tuple(f"x{k}" for k in range(23))

    def __init__(self, seed, units=1.0):
        rng = np.random.default_rng(seed)
        self.slopes = rng.normal(size=(23, 3, 20)) * rng.gamma(0.7, 1.0, 20)
        self.slopes *= np.reshape(units, (-1, 1, 1))
        self.measured = rng.normal(size=(3, 20))

    def evaluate(self, x):
        return np.tensordot(x, self.slopes, axes=1) - self.measured, self.slopes


def linear_program(seed, units=1.0):
    program = CalibrationProgram()
    program.add_variables(LinearBlock.names, np.zeros(23))
    program.add_residuals(LinearBlock(seed, units))
    return program


@pytest.mark.slow
def test_few_good_observations_that_all_matter_are_kept():
    """23 parameters take 23 of 60 coordinates, and some observations stand alone."""
    found = [solve_robustly(linear_program(seed), 0) for seed in range(200)]
    assert np.mean([f.outliers.any() for f in found]) <= 0.06
    assert np.median([f.scale for f in found]) == pytest.approx(1.0, abs=0.1)


def test_spreads_of_all_observations_add_up_to_the_parameters():
    program = linear_program(1)
    x = program.solve().x
    assert np.trace(program.prediction_covariances(0, x), axis1=1, axis2=2).sum() == pytest.approx(
        23.0
    )
    program.fix("x3")
    assert np.trace(program.prediction_covariances(0, x), axis1=1, axis2=2).sum() == pytest.approx(
        22.0
    )


def test_spreads_do_not_depend_on_the_units_of_the_parameters():
    x, units = np.zeros(23), np.geomspace(1.0, 1e10, 23)
    spreads = linear_program(1, units).prediction_covariances(0, x)
    assert spreads == pytest.approx(linear_program(1).prediction_covariances(0, x), abs=1e-6)


def test_what_nothing_is_known_of_spreads_nothing():
    program = linear_program(1)
    program.add_variables(["unseen"], [0.0])
    x = np.zeros(24)
    assert np.trace(program.prediction_covariances(0, x), axis1=1, axis2=2).sum() == pytest.approx(
        23.0
    )


def test_an_observation_left_out_is_judged_by_what_the_others_say_of_it():
    program = linear_program(2)
    keep = np.ones(20)
    keep[4] = 0.0
    program.set_loss(0, Loss(), keep)
    x = program.solve().x
    J = LinearBlock(2).slopes.transpose(2, 1, 0)
    others = np.einsum("nik,nil->kl", J[keep > 0.0], J[keep > 0.0])
    expected = J[4] @ np.linalg.solve(others, J[4].T)
    assert program.prediction_covariances(0, x)[4] == pytest.approx(expected, rel=1e-6)


def test_a_block_that_remembers_works_out_each_place_once_and_lets_nobody_write_to_it():
    class Line:
        places = 0

        @remembers_last
        def evaluate(self, x):
            self.places += 1
            return x[:1] - 3.0, np.ones((1, 1))

    one, other = Line(), Line()
    for x in (np.zeros(1), np.zeros(1), np.ones(1), np.ones(1), np.zeros(1)):
        r, jacobian = one.evaluate(x)
        assert r == x - 3.0
    assert (one.places, other.places) == (3, 0)
    with pytest.raises(ValueError, match="read-only"):
        jacobian *= 2.0
    x += 1.0  # what it was asked for is its own
    assert one.evaluate(np.zeros(1))[0] == -3.0
    assert one.places == 3

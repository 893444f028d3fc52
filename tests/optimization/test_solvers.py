"""Levenberg-Marquardt, with SNOPT and IPOPT as its witnesses on Drake's side of the program."""

import numpy as np
import pytest

from nico_selfmodel.errors import ImpossibleModelError
from nico_selfmodel.optimization.calibration_program import CalibrationProgram
from nico_selfmodel.optimization.losses import Loss

SOLVERS = ["lm", "snopt", "ipopt"]


def nothing(program):
    pass


def pinned(program):
    program.fix("height", 1.7)


def with_prior(program):
    program.add_prior("rate", 0.5, 0.01)


def robust(program):
    program.set_loss(0, Loss("cauchy", 0.02))


@pytest.mark.parametrize("change", [nothing, pinned, with_prior, robust])
def test_three_solvers_agree_on_one_program(decay, change):
    change(decay)
    decay.move_start(np.where(decay.free, [1.5, 0.5], decay.start))
    solutions = [decay.solve(solver) for solver in SOLVERS]
    assert [s.converged for s in solutions] == [True] * 3
    costs = [s.cost for s in solutions]
    assert costs == pytest.approx([costs[0]] * 3, rel=1e-6)
    for solution in solutions:
        assert solution.x == pytest.approx(solutions[0].x, rel=1e-3)


@pytest.mark.parametrize("solver", SOLVERS)
def test_variables_may_be_added_after_a_block(decay, linear_block, solver):
    decay.add_variables(["offset"], [0.0])
    decay.add_residuals(linear_block(("offset", "rate"), [[[1.0]], [[1.0]]], [[3.0]]))
    solution = decay.solve(solver)
    assert solution.converged
    assert solution.cost == pytest.approx(decay.solve("lm").cost, rel=1e-6)
    assert solution.x[2] == pytest.approx(3.0 - solution.x[1], abs=1e-4)


@pytest.mark.parametrize("solver", SOLVERS)
def test_priors_alone_make_a_program(solver):
    program = CalibrationProgram()
    program.add_variables(["a", "b"], [0.0, 0.0])
    program.add_prior("a", 1.0, 0.5)
    program.add_prior("b", -2.0, 3.0)
    assert program.solve(solver).x == pytest.approx([1.0, -2.0], abs=1e-4)


def test_the_limit_of_iterations_is_no_success(decay):
    solution = decay.solve(max_iterations=2)
    assert not solution.converged
    assert solution.iterations == 2
    assert solution.cost <= solution.history[0]


def test_the_history_falls_to_the_cost(decay):
    solution = decay.solve()
    assert np.all(np.diff(solution.history) < 0.0)
    assert solution.history[-1] == solution.cost


@pytest.mark.parametrize("start", [[np.nan, 1.0], [1.0, np.inf]])
def test_a_start_that_is_no_number_is_refused(decay, start):
    decay.move_start(np.array(start))
    with pytest.raises(ValueError, match="initial guess must be finite"):
        decay.solve()


def test_an_unknown_solver_is_answered_with_the_known_ones(decay):
    with pytest.raises(ValueError, match="no solver 'magic'; there are lm, snopt, ipopt"):
        decay.solve("magic")


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_cost_that_is_not_a_number_is_no_success(solver, linear_block):
    program = CalibrationProgram()
    program.add_variables(["x"], [1.0])
    program.add_residuals(linear_block(("x",), [[[1.0]]], [[np.nan]]))
    assert not program.solve(solver).converged


def test_an_open_gauge_does_not_stop_the_solver(linear_block):
    rng = np.random.default_rng(3)
    a = rng.normal(size=(3, 2, 10))
    a[2] = a[0] - a[1]
    program = CalibrationProgram()
    program.add_variables(["a", "b", "c"], [1.0, 1.0, 1.0])
    program.add_residuals(linear_block(("a", "b", "c"), a, rng.normal(size=(2, 10))))
    solution = program.solve()
    assert solution.converged
    assert np.abs(solution.x).max() < 10.0
    assert np.abs(program.normal_equations(solution.x)[1]).max() < 1e-4


class OnlyPositive:
    """A block that cannot be where its first variable is not positive."""

    def __init__(self, block):
        self.block, self.names, self.refused = block, block.names, 0

    def evaluate(self, x):
        if x[0] <= 0.0:
            self.refused += 1
            raise ImpossibleModelError(f"must be positive, got {x[0]:g}")
        return self.block.evaluate(x)


def logarithm(names, data):
    class Logarithm:
        """Residuals log(x) - y: from afar the step of Gauss and Newton goes below zero."""

        def __init__(self):
            self.names = names

        def evaluate(self, x):
            return (np.log(x) - data)[:, None], (1.0 / x)[:, None, None]

    return OnlyPositive(Logarithm())


@pytest.mark.parametrize("solver", ["lm", "ipopt"])
def test_a_step_to_what_cannot_be_is_refused_and_shortened(solver):
    block = logarithm(("x",), 0.0)
    program = CalibrationProgram()
    program.add_variables(["x"], [20.0])
    program.add_residuals(block)
    solution = program.solve(solver)
    assert block.refused
    assert solution.converged
    assert solution.x == pytest.approx([1.0], abs=1e-3)


def test_a_start_that_cannot_be_is_an_error():
    program = CalibrationProgram()
    program.add_variables(["x"], [-2.0])
    program.add_residuals(logarithm(("x",), 0.0))
    with pytest.raises(ImpossibleModelError, match="must be positive, got -2"):
        program.solve()

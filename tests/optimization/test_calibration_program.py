"""The program: names, pins, priors, and the derivatives of its cost."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff

from nico_selfmodel.optimization.calibration_program import CalibrationProgram
from nico_selfmodel.optimization.losses import Loss

from .dense_jacobian import whitened_jacobian

LOSSES = ["none", "huber", "cauchy", "tukey"]


def refuses(program):
    """Return whether a program without an answer is recognised as such."""
    try:
        return not program.solve().converged
    except ValueError:
        return True


def test_variables_have_names_an_order_and_a_start(decay):
    decay.add_variables(["offset"], [0.25])
    assert decay.names == ("height", "rate", "offset")
    assert decay.start.tolist() == [0.5, 0.1, 0.25]
    assert decay.index("offset") == 2
    assert [v.get_name().split("(")[0] for v in decay.prog.decision_variables()] == list(
        decay.names
    )
    assert decay.free.all()


@pytest.mark.parametrize(
    ("names", "start", "message"),
    [
        (["rate"], [1.0], "new and unique, got \\['rate'\\]"),
        (["a", "a"], [1.0, 2.0], "new and unique"),
        (["a"], [np.nan], "1 finite numbers"),
        (["a", "b"], [1.0], "2 finite numbers"),
    ],
)
def test_variables_that_make_no_sense_are_refused(decay, names, start, message):
    with pytest.raises(ValueError, match=message):
        decay.add_variables(names, start)
    assert decay.names == ("height", "rate")


@pytest.mark.parametrize(
    "call",
    [
        lambda program: program.fix("wdith"),
        lambda program: program.release("wdith"),
        lambda program: program.add_prior("wdith", 0, 1),
        lambda program: program.index("wdith"),
    ],
)
def test_an_unknown_name_is_answered_with_the_known_ones(decay, call):
    with pytest.raises(ValueError, match="no parameter 'wdith'; there are height, rate"):
        call(decay)


def test_a_block_of_unknown_variables_is_refused(linear_block):
    with pytest.raises(ValueError, match="no parameter 'x'"):
        CalibrationProgram().add_residuals(linear_block(("x",), [[[1.0]]], [[0.0]]))


def test_a_pin_holds_until_it_is_taken_out(decay):
    free = decay.solve()
    decay.fix("rate", 1.5)
    assert decay.free.tolist() == [True, False]
    assert decay.start[1] == 1.5
    held = decay.solve()
    assert held.converged
    assert held.x[1] == 1.5
    assert held.cost > free.cost
    decay.fix("rate", 0.3)  # replaces the earlier pin
    assert decay.solve().x[1] == 0.3
    decay.release("rate")
    decay.release("rate")
    assert decay.free.all()
    assert decay.solve().x == pytest.approx(free.x, rel=1e-6)


def test_a_pin_without_a_value_holds_the_start_and_all_pins_leave_nothing_to_do(decay):
    decay.fix("rate")
    assert decay.solve().x[1] == 0.1
    decay.fix("height")
    solution = decay.solve()
    assert solution.x.tolist() == [0.5, 0.1]
    assert solution.cost == pytest.approx(decay.normal_equations(decay.start)[0])


@given(mean=st.floats(-3, 3), sigma=st.floats(0.01, 10.0))
def test_a_prior_is_one_more_observation(linear_block, mean, sigma):
    rng = np.random.default_rng(4)
    a, b = rng.normal(size=(2, 1, 12)), rng.normal(size=(1, 12))
    programs = [CalibrationProgram(), CalibrationProgram()]
    for program in programs:
        program.add_variables(["x", "y"], [0.0, 0.0])
        program.add_residuals(linear_block(("x", "y"), a, b))
    programs[0].add_prior("y", mean, sigma)
    programs[1].add_residuals(linear_block(("y",), [[[1.0 / sigma]]], [[mean / sigma]]))
    x = np.array([0.3, -0.7])
    for mine, other in zip(*(p.normal_equations(x) for p in programs), strict=True):
        assert mine == pytest.approx(other, rel=1e-12)
    assert np.array_equal(*(whitened_jacobian(p, x) for p in programs))
    first, second = (program.solve() for program in programs)
    assert first.x == pytest.approx(second.x, abs=1e-9)


@pytest.mark.parametrize("sigma", [0.0, -1.0, np.nan])
def test_a_prior_must_leave_something_open(decay, sigma):
    with pytest.raises(ValueError, match="must be positive"):
        decay.add_prior("rate", 1.0, sigma)


def test_weights_leave_observations_out(decay, decay_block):
    keep = (np.arange(30) % 3 > 0).astype(float)
    decay.set_loss(0, Loss(), keep)
    part = decay.solve()
    again = CalibrationProgram()
    again.add_variables(["height", "rate"], [0.5, 0.1])
    chosen = type(decay_block)(("height", "rate"), decay_block.t[keep > 0], decay_block.y[keep > 0])
    again.add_residuals(chosen)
    assert part.x == pytest.approx(again.solve().x, rel=1e-6)
    assert decay.residuals(0, part.x).shape == (1, 30)


@pytest.mark.parametrize("kind", LOSSES)
def test_the_normal_equations_belong_to_the_cost(decay, kind):
    decay.add_prior("rate", 0.5, 0.3)
    decay.set_loss(0, Loss(kind, 0.1), np.linspace(0.5, 1.5, 30))
    x, h = np.array([1.4, 0.5]), 1e-6
    _, gradient, hessian = decay.normal_equations(x)
    numeric = [
        (decay.normal_equations(x + e)[0] - decay.normal_equations(x - e)[0]) / (2 * h)
        for e in h * np.eye(2)
    ]
    assert gradient == pytest.approx(numeric, rel=1e-6)
    jacobian = whitened_jacobian(decay, x)
    assert hessian == pytest.approx(jacobian.T @ jacobian, rel=1e-12)
    assert jacobian.shape == (31, 2)


@pytest.mark.parametrize("kind", LOSSES)
def test_drake_sees_the_same_cost_and_derivatives(decay, kind):
    decay.set_loss(0, Loss(kind, 0.1))
    (binding,) = decay.prog.generic_costs()
    x, h = np.array([1.4, 0.5]), 1e-6
    chain = np.array([[1.0, 2.0, 0.0], [0.0, -1.0, 3.0]])  # x may itself depend on others
    value = binding.evaluator().Eval(InitializeAutoDiff(x[:, None], chain))
    plain = binding.evaluator().Eval(x)
    assert ExtractValue(value)[0, 0] == plain[0] == decay.normal_equations(x)[0]
    numeric = [
        (binding.evaluator().Eval(x + h * c) - binding.evaluator().Eval(x - h * c))[0] / (2 * h)
        for c in chain.T
    ]
    assert ExtractGradient(value)[0] == pytest.approx(numeric, rel=1e-6)
    constant = binding.evaluator().Eval(InitializeAutoDiff(x[:, None], np.zeros((2, 0))))
    assert ExtractValue(constant)[0, 0] == plain[0]

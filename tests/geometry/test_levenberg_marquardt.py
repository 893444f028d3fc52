"""The Levenberg-Marquardt iteration on normal equations."""

import numpy as np
import pytest

from nico_selfmodel.least_squares import damped_step, levenberg_marquardt, levenberg_marquardt_each


def normal_equations(residuals, scale=1.0):
    """Return an `evaluate` for residuals(x) -> (r, J), in parameters y = x / scale."""
    trace = []

    def evaluate(y):
        trace.append(y * scale)
        r, jacobian = residuals(y * scale)
        jacobian = jacobian * scale
        return 0.5 * float(r @ r), jacobian.T @ r, jacobian.T @ jacobian

    evaluate.trace = trace
    return evaluate


def rosenbrock(x):
    r = np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])
    return r, np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]])


def exponential_decay(x):
    t = np.linspace(0.0, 2.0, 15)
    wave = 0.02 * np.sin(7.0 * t)
    value = np.exp(-x[1] * t)
    return x[0] * value - 2.0 * np.exp(-1.3 * t) - wave, np.stack(
        [value, -x[0] * t * value], axis=1
    )


@pytest.mark.parametrize("start", [(-1.2, 1.0), (5.0, -3.0), (0.0, 0.0)])
def test_it_walks_down_the_banana_valley(start):
    result = levenberg_marquardt(normal_equations(rosenbrock), np.array(start))
    assert result.converged
    assert result.x == pytest.approx([1.0, 1.0], abs=1e-8)
    assert np.all(np.diff(result.history) < 0.0)
    assert result.cost == result.history[-1]


def test_a_linear_problem_is_solved_by_one_step():
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(20, 4)), rng.normal(size=20)
    evaluate = normal_equations(lambda x: (a @ x - b, a))
    result = levenberg_marquardt(evaluate, np.zeros(4))
    expected = np.linalg.lstsq(a, b, rcond=None)[0]
    assert evaluate.trace[1] == pytest.approx(expected, abs=1e-3)  # up to the damping
    assert result.converged
    assert result.iterations <= 4
    assert result.x == pytest.approx(expected, abs=1e-6)


def test_a_problem_unobservable_in_one_direction_still_ends_in_its_valley():
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=(20, 3)), rng.normal(size=20)
    a[:, 2] = a[:, 0] + a[:, 1]
    result = levenberg_marquardt(normal_equations(lambda x: (a @ x - b, a)), np.ones(3))
    expected = np.linalg.lstsq(a[:, :2], b, rcond=None)[0]
    assert result.converged
    assert a @ result.x == pytest.approx(a[:, :2] @ expected, abs=1e-6)


def test_a_parameter_without_any_influence_stays_where_it_was():
    a = np.array([[1.0, 0.0], [2.0, 0.0]])
    result = levenberg_marquardt(
        normal_equations(lambda x: (a @ x - [1.0, 2.5], a)), np.array([9.0, 7.0])
    )
    assert result.converged
    assert result.x == pytest.approx([1.2, 7.0], abs=1e-6)


def test_the_limit_of_iterations_is_not_called_convergence():
    result = levenberg_marquardt(
        normal_equations(rosenbrock), np.array([-1.2, 1.0]), max_iterations=9
    )
    assert not result.converged
    assert result.iterations == 9
    assert result.cost < result.history[0]


def test_a_start_at_the_minimum_is_converged_at_once():
    result = levenberg_marquardt(normal_equations(rosenbrock), np.ones(2))
    assert (result.converged, result.iterations, result.cost) == (True, 1, 0.0)


@pytest.mark.parametrize("scale", [(1.0, 1e6), (1e-5, 1.0), (1e3, 1e-3)])
@pytest.mark.parametrize("residuals", [rosenbrock, exponential_decay])
def test_the_way_does_not_depend_on_the_units_of_the_parameters(residuals, scale):
    start, scale = np.array([-1.2, 1.0]), np.array(scale)
    plain, scaled = normal_equations(residuals), normal_equations(residuals, scale)
    reference = levenberg_marquardt(plain, start)
    result = levenberg_marquardt(scaled, start / scale)
    assert result.iterations == pytest.approx(reference.iterations, abs=1)  # rounding at the end
    way = np.array(scaled.trace)[:15]
    assert way == pytest.approx(np.array(plain.trace)[: len(way)], rel=1e-6, abs=1e-9)


def test_a_step_into_the_undefined_is_taken_back():
    def logarithm(x):
        with np.errstate(invalid="ignore"):
            return np.array([np.log(x[0])]), np.array([[1.0 / x[0]]])

    result = levenberg_marquardt(normal_equations(logarithm), np.array([8.0]))
    assert result.converged
    assert result.x == pytest.approx([1.0], abs=1e-6)


def test_a_cost_that_is_not_a_number_is_never_a_minimum():
    def nothing(x):
        return np.full(2, np.nan), np.full((2, 1), np.nan)

    result = levenberg_marquardt(normal_equations(nothing), np.zeros(1))
    assert not result.converged


def test_a_matrix_that_is_not_positive_gives_no_step():
    assert damped_step(np.diag([1.0, -1.0]), np.ones(2), np.zeros(2)) is None
    step = damped_step(np.diag([1.0, 3.0]), np.array([2.0, 4.0]), np.array([0.0, 1.0]))
    assert step == pytest.approx([-2.0, -1.0])


def test_a_step_of_the_callers_own_is_asked_again_with_more_damping():
    asked = []

    def step(hessian, gradient, damping):
        asked.append(damping.copy())
        return None if len(asked) < 4 else damped_step(hessian, gradient, damping)

    result = levenberg_marquardt(normal_equations(rosenbrock), np.array([0.5, 0.5]), step=step)
    assert result.converged
    assert np.all(np.diff(asked[:4], axis=0) > 0.0)


def test_many_starts_at_once_go_the_ways_that_they_would_alone():
    starts = np.array([[-1.2, 1.0], [5.0, -3.0], [1.0, 1.0], [0.0, 0.0]])
    asked = []

    def evaluate(which, x):
        asked.append(which.tolist())
        found = [normal_equations(rosenbrock)(point) for point in x]
        return tuple(map(np.array, zip(*found, strict=True)))

    for x, cost, start in zip(*levenberg_marquardt_each(evaluate, starts), starts, strict=True):
        alone = levenberg_marquardt(normal_equations(rosenbrock), start)
        assert x == pytest.approx(alone.x, abs=1e-9)
        assert cost == pytest.approx(alone.cost, abs=1e-20)
    assert asked[0] == [0, 1, 2, 3]
    assert all(2 not in which for which in asked[1:])  # it began at the minimum


def test_of_many_starts_one_that_costs_no_number_stays_alone_with_it():
    def evaluate(which, x):
        cost = np.where(which == 1, np.nan, 0.5 * x[:, 0] ** 2)
        return cost, x.copy(), np.ones((len(x), 1, 1))

    (found, lost), cost = levenberg_marquardt_each(evaluate, np.array([[3.0], [3.0]]))
    assert found == pytest.approx([0.0], abs=1e-6)
    assert lost == pytest.approx([3.0])
    assert np.isnan(cost).tolist() == [False, True]


def bounded(least):
    """Return the minimum of (x - 3 y)^2 + (x + y + 2)^2 + y^4 / 4, x and y no less than told."""

    def evaluate(at):
        x, y = at
        r = np.array([x - 3.0 * y, x + y + 2.0, 0.5 * y * y])
        jacobian = np.array([[1.0, -3.0], [1.0, 1.0], [0.0, y]])
        assert (at >= least).all()
        return 0.5 * float(r @ r), jacobian.T @ r, jacobian.T @ jacobian

    return levenberg_marquardt(evaluate, np.array([2.0, 1.0]), least=np.asarray(least))


@pytest.mark.parametrize(
    ("least", "found"),
    [
        ((-np.inf, -np.inf), None),
        ((-0.5, -np.inf), (-0.5, -0.29867)),
        ((-np.inf, 0.25), (-0.75, 0.25)),
        ((1.0, 0.5), (1.0, 0.5)),
    ],
)
def test_what_would_fall_below_its_least_value_stays_there_and_the_rest_makes_the_best_of_it(
    least, found
):
    fit = bounded(least)
    assert fit.converged
    if found is None:
        assert fit.x == pytest.approx(bounded((-9.0, -9.0)).x, abs=1e-6)
        assert (fit.x < -0.3).all()
    else:
        assert fit.x == pytest.approx(found, abs=1e-4)
    assert fit.iterations <= 10

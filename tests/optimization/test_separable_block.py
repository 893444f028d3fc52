"""Variables that one observation has to itself: assembled, eliminated, and with other company."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nico_selfmodel.least_squares import damped_step
from nico_selfmodel.optimization.calibration_program import CalibrationProgram
from nico_selfmodel.optimization.losses import Loss
from nico_selfmodel.optimization.separable_block import SeparableBlock, eliminated_step

from .dense_jacobian import whitened_jacobian

SEED = st.integers(0, 2**32 - 1)


class TracksBlock(SeparableBlock):
    """Decays seen V times: a rate for all; a height and a floor for each; residuals at k times."""

    own = 2

    def __init__(self, t, y):
        self.t, self.y = t, y
        each = [f"track_{v}.{name}" for v in range(len(y)) for name in ("height", "floor")]
        self.names = ("rate", "drift", *each)

    @property
    def observation_count(self):
        return len(self.y)

    def evaluate_parts(self, x):
        (rate, drift), own = x[:2], x[2:].reshape(-1, 2)
        wave = np.exp(-rate * self.t)
        r = own[:, :1] * wave + own[:, 1:] + drift * self.t**2 - self.y
        by_rate, by_drift = -own[:, :1] * self.t * wave, np.tile(self.t**2, (len(own), 1))
        by_own = np.broadcast_to(np.stack([wave, np.ones_like(wave)]), (len(own), 2, len(wave)))
        return r, np.stack([by_rate, by_drift], axis=1), by_own


class DenseBlock:
    """The same residuals without their structure."""

    def __init__(self, block):
        self.names, self.evaluate = block.names, block.evaluate


@pytest.fixture
def block():
    return make_block(0)


def make_block(seed, views=5):
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 2.0, 12)
    heights, floors = rng.uniform(1.0, 3.0, (views, 1)), rng.uniform(-1.0, 1.0, (views, 1))
    y = heights * np.exp(-0.9 * t) + floors + 0.1 * t**2
    return TracksBlock(t, y + rng.normal(0.0, 0.02, y.shape))


def start_of(block):
    return np.array([0.5, 0.0, *[1.0, 0.0] * (len(block.names) // 2 - 1)])


def program_of(*blocks, extra=()):
    """Return a program in whose order the variables are not that of the block."""
    program = CalibrationProgram()
    names = list(blocks[0].names)
    values = dict(zip(names, start_of(blocks[0]), strict=True))
    order = [*names[5:], *extra, *names[:5]]
    program.add_variables(order, [values.get(name, 0.0) for name in order])
    for each in blocks:
        program.add_residuals(each)
    return program


def random_system(seed, views=4, own=3, shared=5):
    """Return a positive definite bordered matrix, its gradient, and where the blocks lie."""
    rng = np.random.default_rng(seed)
    places = rng.permutation(views * own + shared)
    blocks, rest = places[: views * own].reshape(views, own), places[views * own :]
    hessian = np.zeros((len(places), len(places)))
    for block in blocks:
        columns = np.concatenate([block, rest])
        jacobian = rng.normal(size=(2 * own + 2, len(columns)))
        hessian[np.ix_(columns, columns)] += jacobian.T @ jacobian
    return hessian, rng.normal(size=len(places)), rng.uniform(0.0, 0.1, len(places)), blocks


def test_the_dense_derivatives_hold_those_of_the_parts(block):
    x = start_of(block)
    r, by_shared, by_own = block.evaluate_parts(x)
    residuals, jacobian = block.evaluate(x)
    assert np.array_equal(residuals, r.T)
    assert np.array_equal(block.residuals(x), r.T)
    assert jacobian.shape == (12, 12, 5)
    assert np.array_equal(jacobian[:2], np.moveaxis(by_shared, 0, -1))
    for v in range(5):
        own = jacobian[2 + 2 * v : 4 + 2 * v]
        assert np.array_equal(own[:, :, v], by_own[v])
        assert not np.delete(own, v, axis=2).any()
    h = 1e-6
    for i, step in enumerate(h * np.eye(len(x))):
        numeric = (block.residuals(x + step) - block.residuals(x - step)) / (2.0 * h)
        assert jacobian[i] == pytest.approx(numeric, abs=1e-8)


@pytest.mark.parametrize("loss", ["none", "huber", "cauchy", "tukey"])
@pytest.mark.parametrize("weights", [None, [1.0, 0.0, 0.5, 2.0, 1.0]])
def test_the_normal_equations_are_those_of_a_dense_block(block, loss, weights):
    programs = program_of(block), program_of(DenseBlock(block))
    weights = None if weights is None else np.array(weights)
    for program in programs:
        program.add_prior("rate", 1.0, 0.3)
        program.set_loss(0, Loss(loss, 0.2), weights)
    x = programs[0].start + np.random.default_rng(3).normal(0.0, 0.1, 12)
    for mine, other in zip(*(p.normal_equations(x) for p in programs), strict=True):
        assert mine == pytest.approx(other, rel=1e-11, abs=1e-11)
    assert np.array_equal(programs[0].residuals(0, x), programs[1].residuals(0, x))
    assert np.array_equal(*(whitened_jacobian(p, x) for p in programs))


def test_a_program_knows_which_variables_are_whose(block):
    program = program_of(block)
    assert program.own_variables.shape == (5, 2)
    for v, own in enumerate(program.own_variables):
        assert [program.names[i] for i in own] == [f"track_{v}.height", f"track_{v}.floor"]
    assert program_of(DenseBlock(block)).own_variables is None
    assert program_of(block, block).own_variables is None  # two of them share: no blocks then


@pytest.mark.parametrize("loss", ["none", "cauchy"])
def test_the_solution_is_that_of_a_dense_block_step_by_step(block, loss):
    solutions = []
    for program in (program_of(block), program_of(DenseBlock(block))):
        program.set_loss(0, Loss(loss, 0.05))
        solutions.append(program.solve())
    mine, other = solutions
    assert mine.converged
    assert mine.iterations == other.iterations
    assert mine.history == pytest.approx(other.history, rel=1e-8)
    assert mine.x == pytest.approx(other.x, rel=1e-6, abs=1e-7)


def test_snopt_finds_the_same_minimum_of_the_very_same_program(block):
    program = program_of(block)
    program.add_prior("drift", 0.0, 0.5)
    ours = program.solve()
    program.move_start(ours.x + 0.05)
    theirs = program.solve("snopt")
    assert ours.converged
    assert theirs.converged
    assert theirs.cost == pytest.approx(ours.cost, rel=1e-6)
    assert theirs.x == pytest.approx(ours.x, abs=1e-3)


def test_pinned_variables_of_one_observation_end_the_elimination_and_nothing_else(block):
    solutions = []
    for each in (block, DenseBlock(block)):
        program = program_of(each)
        program.fix("track_1.height", 2.0)
        solutions.append(program.solve())
    mine, other = solutions
    assert mine.converged
    assert mine.x == pytest.approx(other.x, rel=1e-6, abs=1e-7)
    assert mine.x[program.index("track_1.height")] == 2.0


def test_pinned_shared_variables_leave_each_observation_to_itself(block):
    program = program_of(block)
    program.fix("rate", 0.9)
    program.fix("drift", 0.1)
    solution = program.solve()
    assert solution.converged
    wave = np.stack([np.exp(-0.9 * block.t), np.ones_like(block.t)], axis=1)
    for v, own in enumerate(program.own_variables):
        alone = np.linalg.lstsq(wave, block.y[v] - 0.1 * block.t**2)[0]
        assert solution.x[own] == pytest.approx(alone, abs=1e-6)


@pytest.mark.parametrize("change", ["prior on its own", "weight zero"])
def test_priors_and_weights_work_as_on_a_dense_block(block, change):
    solutions = []
    for each in (block, DenseBlock(block)):
        program = program_of(each)
        if change == "prior on its own":
            program.add_prior("track_0.floor", 5.0, 0.1)
        else:
            program.set_loss(0, Loss(), np.array([0.0, 1.0, 1.0, 1.0, 1.0]))
            program.add_prior("track_0.floor", 5.0, 0.1)
            program.add_prior("track_0.height", 1.0, 0.1)
        solutions.append(program.solve())
    mine, other = solutions
    assert mine.converged
    assert mine.cost == pytest.approx(other.cost, rel=1e-7)
    assert mine.x == pytest.approx(other.x, rel=1e-5, abs=1e-5)


def test_another_block_on_shared_and_new_variables_is_welcome(block, linear_block):
    sum_of = linear_block(("rate", "other"), [[[1.0]], [[1.0]]], [[3.0]])
    mine, other = (
        program_of(each, sum_of, extra=["other"]).solve() for each in (block, DenseBlock(block))
    )
    assert mine.converged
    assert mine.x == pytest.approx(other.x, rel=1e-6, abs=1e-7)


def test_another_block_may_tie_two_observations_together(block, linear_block):
    tie = linear_block(("track_0.height", "track_1.height"), [[[30.0]], [[-30.0]]], [[0.0]])
    mine, other = (program_of(each, tie).solve() for each in (block, DenseBlock(block)))
    assert other.converged
    assert mine.converged
    assert mine.cost == pytest.approx(other.cost, rel=1e-6)


@pytest.mark.parametrize("change", ["nothing", "pinned shared", "pinned own", "no weight"])
def test_spreads_of_another_block_are_those_beside_a_dense_block(block, linear_block, change):
    slopes = np.random.default_rng(4).normal(size=(2, 3, 6))
    beside = linear_block(("rate", "other"), slopes, np.zeros((3, 6)))
    found = []
    for each in (block, DenseBlock(block)):
        program = program_of(each, beside, extra=["other"])
        if change.startswith("pinned"):
            program.fix("rate" if change == "pinned shared" else "track_1.height")
        if change == "no weight":
            program.set_loss(0, Loss(), np.array([0.0, 1.0, 1.0, 1.0, 1.0]))
        found.append(program.prediction_covariances(1, program.start))
    assert found[0].shape == (6, 3, 3)
    assert np.trace(found[0], axis1=1, axis2=2).sum() > 0.9
    np.testing.assert_allclose(found[0], found[1], atol=1e-10)


@given(SEED)
def test_the_eliminated_step_is_the_dense_step(seed):
    hessian, gradient, damping, own = random_system(seed)
    before = hessian.copy()
    step = eliminated_step(hessian, gradient, damping, own)
    dense = damped_step(hessian, gradient, damping)
    assert step == pytest.approx(dense, rel=1e-6, abs=1e-9 * np.abs(dense).max())
    assert np.array_equal(hessian, before)


def test_the_step_may_have_nothing_shared():
    hessian, gradient, damping, own = random_system(1, shared=0)
    step = eliminated_step(hessian, gradient, damping, own)
    assert step == pytest.approx(damped_step(hessian, gradient, damping))


@pytest.mark.parametrize("part", ["own", "shared"])
def test_a_matrix_that_is_not_positive_definite_gives_no_step(part):
    hessian, gradient, damping, own = random_system(2)
    shared = np.setdiff1d(np.arange(len(gradient)), own)
    i = own[1, 2] if part == "own" else shared[0]
    hessian[i, i] = -1.0
    assert damped_step(hessian, gradient, damping) is None
    assert eliminated_step(hessian, gradient, damping, own) is None
    hessian[i, i] = 1e3
    assert eliminated_step(hessian, gradient, damping, own) is not None


def test_a_unobservable_variable_asks_for_damping():
    hessian, gradient, _, own = random_system(2)
    hessian[own[0, 0]] = hessian[:, own[0, 0]] = 0.0
    gradient[own[0, 0]] = 0.0
    assert eliminated_step(hessian, gradient, np.zeros_like(gradient), own) is None
    damping = np.full_like(gradient, 1e-3)
    step = eliminated_step(hessian, gradient, damping, own)
    assert step == pytest.approx(damped_step(hessian, gradient, damping))
    assert step[own[0, 0]] == 0.0


@given(SEED)
def test_what_is_known_of_the_shared_ones_is_the_schur_complement(seed):
    block = make_block(seed % 1000)
    rng = np.random.default_rng(seed)
    x = start_of(block) + rng.normal(0.0, 0.1, 12)
    weight = rng.uniform(0.1, 2.0, 5)
    weight[0] = 0.0
    reduced = block.reduced_jacobian(block.evaluate_parts(x), weight)
    assert reduced.shape == (5 * 12, 2)
    dense = (block.evaluate(x)[1] * np.sqrt(weight)).reshape(12, -1)
    kept = [0, 1, *range(4, 12)]  # the weightless observation says nothing of its own
    information = (dense @ dense.T)[np.ix_(kept, kept)]
    a, b, c = information[:2, :2], information[2:, :2], information[2:, 2:]
    assert reduced.T @ reduced == pytest.approx(a - b.T @ np.linalg.solve(c, b), rel=1e-8)


@given(SEED)
def test_what_own_variables_take_up_is_the_diagonal_of_their_hat_matrix(seed):
    block = make_block(seed % 1000)
    parts = block.evaluate_parts(start_of(block))
    found = block.own_leverage(parts).reshape(5, 12)
    for own, leverage in zip(np.swapaxes(parts[2], 1, 2), found, strict=True):
        hat = own @ np.linalg.solve(own.T @ own, own.T)
        assert leverage == pytest.approx(np.diag(hat), abs=1e-9)

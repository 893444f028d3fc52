"""What a first body and a step of any body cost as poses become many."""

import numpy as np
import pytest

from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.guesses.start_search import searched_start
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_setup import Wishes, blank_body

from ..estimation.simulated_trees import one_arm
from .timing import best_ratio

pytestmark = pytest.mark.benchmark


def recorded(poses):
    """Return an arm of six joints with three tags before two cameras."""
    return one_arm(1, joints=6, markers=3, poses=poses, sensor="camera").data


def searched(data):
    return searched_start(data, blank_body(data, {}), None, Wishes(), 0)


def step_of(data):
    """Return a function that takes one step near the minimum."""
    start = searched(data).start
    residuals = TreeResiduals(TreeObservations.of(data), start.parameters)
    problem = TreeProblem(residuals, start.setup.free, start.setup.priors)
    values = start.values + 1e-5 * np.isin(start.parameters.names, list(start.setup.free))

    def step():
        problem._last = None
        problem.program(values, None).solve(max_iterations=1)

    return step


def test_a_step_of_four_times_the_poses_takes_little_more_than_four_times_as_long():
    # Both beyond what caches hold; what grew with the square would take sixteen times as long.
    few, many = step_of(recorded(2000)), step_of(recorded(8000))
    assert best_ratio(many, few, rounds=7) < 6.0


def test_two_starts_of_18000_rows_take_a_few_steps_of_all_of_them():
    data = recorded(3000)
    step = step_of(data)
    found = searched(data)
    assert len(found.costs) == 2
    assert found.start.cost / found.scalars < min(found.costs) + 0.1
    assert best_ratio(lambda: searched(data), step, rounds=3) < 9.0

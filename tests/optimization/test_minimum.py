"""Where programs end that Drake's solvers take, content or not."""

import numpy as np
import pytest
from pydrake.solvers import MathematicalProgram

from nico_selfmodel.optimization.minimum import minimum_near


def program(fails_after=np.inf):
    """Return a program whose cost can be told so many times, and two of its three variables."""
    made, asked = MathematicalProgram(), []
    x = made.NewContinuousVariables(3)

    def cost(values):
        asked.append(None)
        if len(asked) > fails_after:
            raise RuntimeError("no distance of shapes one inside the other")
        return (values[0] - 1.0) ** 2 + (values[1] - 2.0) ** 4 + (values[2] + 3.0) ** 2

    made.AddCost(cost, x)
    return made, x[[2, 0]]


def test_a_minimum_is_found_in_the_variables_that_are_asked_for():
    made, of = program()
    assert minimum_near(made, np.zeros(3), of) == pytest.approx([-3.0, 1.0], abs=1e-4)


def test_a_cost_that_cannot_be_told_leaves_what_the_solver_began_with():
    """Distances of shapes one inside the other ended a mirror test of five robots."""
    made, of = program(fails_after=2)
    np.testing.assert_array_equal(minimum_near(made, np.array([0.5, 0.6, 0.7]), of), [0.7, 0.5])

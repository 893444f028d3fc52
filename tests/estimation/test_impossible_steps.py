"""A step to what cannot be is refused and shortened; a start that cannot be is an error."""

from dataclasses import replace

import pytest

from nico_selfmodel.errors import ImpossibleModelError
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem

from .simulated_trees import one_arm

FOCAL = "left.fx"


@pytest.fixture(scope="module")
def mirrored_pictures():
    """A body whose pictures are mirrored: the likeliest focal length along u is negative."""
    body = one_arm(1, joints=2, poses=12, sensor="camera")
    width = body.data.sensors[0].image_size[0]
    values = body.data.observations.values.copy()
    values[:, 0] = width - 1.0 - values[:, 0]
    data = replace(body.data, observations=replace(body.data.observations, values=values))
    parameters = TreeParameters(body.tree)
    return TreeProblem(
        TreeResiduals(TreeObservations.of(data), parameters), frozenset((FOCAL,)), {}
    )


def test_a_step_to_a_negative_focal_length_is_refused(mirrored_pictures):
    start = mirrored_pictures.residuals.parameters.start
    solution = mirrored_pictures.program(start, None).solve()
    assert 0.0 < solution.x[0] < 0.1 * start[mirrored_pictures.columns[0]]
    assert solution.cost < solution.history[0]


def test_a_body_that_begins_with_a_negative_focal_length_is_an_error(mirrored_pictures):
    values = mirrored_pictures.residuals.parameters.start.copy()
    values[mirrored_pictures.columns[0]] = -500.0
    with pytest.raises(ImpossibleModelError, match="must be positive, got fx -500"):
        mirrored_pictures.program(values, None).solve()

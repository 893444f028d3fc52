"""Cross-validation holds a pose against what the other folds tell, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.judging import result_of
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree

from ..slow_rest import slow_rest
from .simulated_trees import one_arm


@pytest.mark.parametrize("alone", slow_rest([True, False]))
def test_a_marker_that_one_fold_alone_saw_is_not_predicted_by_the_others(alone):
    data = one_arm(3, joints=3, markers=2, poses=30).data
    table = data.observations
    seen = (0, 5, 10) if alone else (0, 1, 10)  # of five folds, dealt out in turn
    keep = (table.marker == 0) | np.isin(table.pose, seen)
    found = calibrate_tree(replace(data, observations=table.select(keep)), effects=())
    distance, rows = found.cross_validation.by_row(), found.data.observations
    assert np.isfinite(distance[rows.marker == 0]).all()
    assert np.isnan(distance[rows.marker == 1]).all() == alone
    counted = result_of(found).cross_validation.n
    assert counted == (30 if alone else 33)


@pytest.mark.parametrize("alone", slow_rest([True, False]))
def test_a_point_of_an_arm_that_one_fold_alone_saw_is_not_predicted_either(make_truth, alone):
    truth = make_truth(3, seed=2, markers=2)
    data = truth.dataset(truth.poses(30), sigma=2e-4, known_sigma=True)
    seen = (1, 6, 11) if alone else (1, 2, 11)
    data = data.select((data.marker == "hand") | np.isin(data.sample, seen))
    found = calibrate_kinematics(data, explain=False, effects=())
    told = np.isfinite(found.cross_validation)
    assert told[data.marker == "hand"].all()
    assert told[data.marker == "thumb"].any() != alone
    errors = result_of(found).cross_validation
    assert len(errors.position) == (30 if alone else 33)
    assert len(errors.compared) == 30

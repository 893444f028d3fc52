"""Joint noise is linear about where each pose shows its joints, not about their readings."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.noise.pose_groups import PoseGroups
from nico_selfmodel.estimation.noise.pose_noise import PoseNoise, PoseWhitening
from nico_selfmodel.estimation.tree.forward.joint_errors import joint_errors
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_errors import told_as
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.sessions.whole_body import whole_body_session, whole_nico
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

from .bodies_before_mirrors import knowing_body
from .whole_body_truth import axis_deviations

STIFF = replace(IMPERFECTIONS["thesis"], sag=0.0, wobble=0.0)
CORNER = 0.08
"""What good corners are found to in pictures [px]."""


def test_poses_are_explained_by_their_joints_to_the_noise_of_the_cameras():
    sigma = 0.01
    data = whole_body_session(STIFF, 0, 0, looks=10, hands=5, pixel_sigma=sigma)
    tree = knowing_body(STIFF, 0, data).tree
    observations = TreeObservations.of(told_as(tree, data))
    parameters, count = TreeParameters(tree), observations.scalars
    values, residuals = parameters.values_of(tree), TreeResiduals(observations, parameters)
    groups = PoseGroups(observations.visit, np.ones(count, dtype=bool), 1)
    noise = PoseNoise(1.0, np.full(len(tree.joints), STIFF.play / np.sqrt(3.0)))
    chi = []
    for _ in range(3):
        linear = residuals.linear(values)
        whitening = PoseWhitening(groups, (linear.by_joint / sigma)[:, None], noise)
        white, _ = whitening.whiten((linear.r / sigma)[None], np.zeros((0, 1, count)))
        chi.append(float(np.sum(white**2)) / count)
        errors = joint_errors(observations, whitening, linear.r / sigma, None)
        residuals = residuals.erring(errors)
    # Linear about the readings, what joint noise leaves looks like wrong corners.
    assert chi[0] > 2.0
    assert chi[2] == pytest.approx(1.0, abs=5.0 * np.sqrt(2.0 / count))
    # What no pixel tells of a joint is expected to be nothing: none is beyond its play by much.
    assert np.abs(residuals.joint_errors).max() < 1.5 * STIFF.play


@pytest.mark.slow
def test_axes_are_known_as_well_as_they_say_where_corners_are_good():
    squares = []
    for seed in (2, 3):
        data = whole_body_session(STIFF, seed, 0, looks=60, hands=80, pixel_sigma=CORNER)
        found = calibrate_tree(data, effects=None)
        squares.append(axis_deviations(found, whole_nico(STIFF, seed)[0]) ** 2)
        assert not found.solution.outliers.any()
    assert 0.6 < np.mean(squares) < 1.5
    assert np.max(squares) < 16.0

"""An arm and two cameras by name are the tree that they are written into."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from nico_selfmodel.estimation.body.arm_parameters import ArmParameters
from nico_selfmodel.estimation.body.body_problem import lines_of_tree
from nico_selfmodel.estimation.body.seen_body import SeenBody
from nico_selfmodel.estimation.observations.pixel_observations import PixelObservations
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_setup import blank_body
from nico_selfmodel.model.arm.bending import BEARING, COUPLING, EFFECTS, PARTS, Bending
from nico_selfmodel.model.arm.uniform_rods import uniform_rods
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.tree.tree_motion import TreeMotion

from ..slow_rest import slow_rest
from .simulated_bodies import Truth, blinded, body, poses


@pytest.fixture(scope="module")
def seen():
    """Return a body's truth and 15 poses, some of them seen by one camera only."""
    one = body()
    data = blinded(poses(one, 15), [2, 5], 0)
    pixels = PixelObservations.from_dataset(data)
    return Truth.of(one), SeenBody.of(pixels, data, None)


def bent(arm, size, effects=PARTS):
    """Return an arm in which everything bends by about so much."""
    rng = np.random.default_rng(3)
    loads, pivots = uniform_rods(arm.table)
    up = np.array([0.0, -0.6, -0.8])
    bending = Bending.none(arm.table.joints, up, loads, pivots).with_effects(*effects)
    moved = bending.with_values(size * rng.normal(size=len(bending.names)))
    return arm.with_bending(replace(moved, loads=loads, pivots=pivots))


def view(seen, arm):
    truth, found = seen
    like = blank_body(found.data, dict(zip(SIDES, truth.rig.cameras, strict=True)))
    parameters = ArmParameters(arm, truth.rig, like)
    return parameters, TreeResiduals(TreeObservations.of(found.data), parameters)


def pixels_of(seen, arm):
    """Return what rows and rig predict, less what was seen, as the tree's observations stand."""
    truth, found = seen
    own = found.pixels.arm
    p = arm.points(own.angles, own.marker, own.approach)
    off = (truth.rig.project(p) - found.pixels.pixels).reshape(len(p), 2, 2)
    table = found.data.observations
    return off[found.row, table.sensor].ravel()


def test_the_tree_sees_what_rows_and_rig_predict(seen):
    arm = seen[0].parameters
    parameters, residuals = view(seen, arm)
    assert_allclose(residuals.residuals(parameters.start), pixels_of(seen, arm), atol=1e-8)


def test_what_bends_is_told_from_other_frames_and_is_the_same(seen):
    one_by_one = [effect for effect in PARTS if effect not in (BEARING, COUPLING)]
    arm = bent(seen[0].parameters, 1e-3, one_by_one)
    parameters, residuals = view(seen, arm)
    assert parameters.bending_of(parameters.start).values == pytest.approx(arm.bending.values)
    assert_allclose(residuals.residuals(parameters.start), pixels_of(seen, arm), atol=1e-8)
    # Turns of a bearing about two axes differ by their order, moments by what couplings turn: by
    # squares of milliradians.
    arm = bent(seen[0].parameters, 1e-3, EFFECTS)
    parameters, residuals = view(seen, arm)
    assert_allclose(residuals.residuals(parameters.start), pixels_of(seen, arm), atol=1e-3)


@pytest.mark.parametrize("bends", slow_rest([False, True]))
def test_the_derivatives_by_name_are_those_of_central_differences(seen, bends):
    arm = seen[0].parameters
    rng = np.random.default_rng(5)
    arm = arm.with_values(arm.values + 0.01 * rng.normal(size=len(arm.values)))
    parameters, residuals = view(seen, bent(arm, 1e-6) if bends else arm)
    x = parameters.start + 1e-3 * rng.normal(size=len(parameters.start)) * (not bends)
    linear = residuals.linear(x)
    for i, name in enumerate(parameters.names):
        step = (1e-3 if abs(x[i]) > 10.0 else 1e-6) * (np.arange(len(x)) == i)
        moved = [residuals.residuals(x + way * step) for way in (1.0, -1.0)]
        numeric = (moved[0] - moved[1]) / (2.0 * step[i])
        assert_allclose(linear.J[i], numeric, atol=2e-4 * max(np.abs(numeric).max(), 0.1)), name


def test_the_lines_of_the_tree_are_those_of_the_arm(seen):
    truth, _ = seen
    parameters, _ = view(seen, truth.parameters)
    zero = truth.parameters.servos.offset
    lines = lines_of_tree(parameters.base, zero, truth.parameters.table.markers)
    chain = truth.parameters.table.to_chain()
    assert_allclose(lines.chain.directions, chain.directions, atol=1e-12)
    assert_allclose(lines.chain.p_WH_zero, chain.p_WH_zero, atol=1e-12)
    off = np.cross(lines.chain.points - chain.points, chain.directions)
    assert_allclose(off, 0.0, atol=1e-12)


def test_both_cameras_share_one_standard_deviation(seen):
    assert TreeObservations.of(seen[1].data).noise_groups == ("cameras",)


def test_the_tree_of_an_arm_has_its_cameras_where_the_rig_has_them(seen):
    truth, found = seen
    parameters, _ = view(seen, truth.parameters)
    data = found.data
    motion = TreeMotion.at(parameters.base, data.si_readings, data.X_flange)
    right = next(s for s in parameters.base.sensors if s.name == "right")
    assert_allclose(motion.pose_of(right)[1][:, 0], truth.rig.X_LR[:3, 3], atol=1e-12)

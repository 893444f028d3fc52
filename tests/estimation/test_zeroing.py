"""Which reading counts as zero is a choice of words: it changes no prediction."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.initialization.joint_zeros import meaningful_parameters
from nico_selfmodel.estimation.initialization.nominal_arm import NominalArm
from nico_selfmodel.estimation.observations.arm_estimate import ArmEstimate
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.arm.dh_table import DhTable

EXACT = 1e-12


def elsewhere(truth, seed=3):
    """Return the arm's own description: another frame, another zero, limits of +-1.5 rad."""
    rng = np.random.default_rng(seed)
    x = transform(rotation_from_vector(rng.normal(size=3)), rng.normal(size=3))
    n = len(truth.chain.joints)
    return NominalArm(truth.chain.moved(x), np.full(n, -1.5), np.full(n, 1.5))


def arm_and_angles(truth, seed=0):
    """Return the true arm with its zero at a random reading, and encoder angles."""
    data = truth.dataset(truth.poses(20, seed))
    observations = Observations.from_dataset(data)
    zero = observations.angles[0]
    q_zero = (zero - truth.servos.offset) / truth.servos.gear
    arm = ArmEstimate(truth.chain.rezeroed(q_zero), truth.servos.gear, zero)
    return arm, observations


@pytest.mark.parametrize("unit", ["rad", "deg", "counts"])
@pytest.mark.parametrize("kind", ["outlying", "elbow", "parallel"])
@pytest.mark.parametrize("described", [False, True])
def test_no_choice_of_zero_changes_a_prediction(make_truth, unit, kind, described):
    for seed in range(4):
        truth = make_truth(5, seed, unit=unit, kind=kind, markers=2)
        arm, seen = arm_and_angles(truth, seed)
        nominal = elsewhere(truth) if described else None
        for first in (None, 0.7):
            parameters = meaningful_parameters(
                arm,
                seen.units,
                np.full(5, unit != "counts"),
                nominal,
                first if described else None,
                np.median(seen.angles, axis=0),
            )
            p = parameters.predict(seen.angles, seen.marker)[0]
            assert p == pytest.approx(arm.predict(seen.angles, seen.marker), abs=EXACT)
            assert p == pytest.approx(seen.p_WH, abs=EXACT)


@pytest.mark.parametrize("described", [False, True])
def test_joint_angle_encoders_read_zero_at_zero(make_truth, described):
    truth = make_truth(4, 1, unit="deg", kind="elbow")
    arm, seen = arm_and_angles(truth)
    nominal = elsewhere(truth) if described else None
    middle = np.median(seen.angles, axis=0)
    found = meaningful_parameters(arm, seen.units, np.ones(4, dtype=bool), nominal, None, middle)
    assert found.servos.offset.tolist() == [0.0] * 4
    assert found.servos.to_joint(np.zeros(4)).tolist() == [0.0] * 4


def test_counts_alone_count_from_theta_zero(make_truth):
    truth = make_truth(4, 1, unit="counts", kind="elbow")
    arm, seen = arm_and_angles(truth)
    middle = np.median(seen.angles, axis=0)
    found = meaningful_parameters(arm, seen.units, np.zeros(4, dtype=bool), None, None, middle)
    assert found.table.theta_zero.tolist() == [0.0] * 4
    assert found.servos.gear == pytest.approx(truth.servos.gear)


@pytest.mark.parametrize("kind", ["outlying", "elbow", "parallel"])
def test_a_described_robot_lends_its_zero(make_truth, kind):
    truth = make_truth(5, 2, unit="counts", kind=kind)
    arm, seen = arm_and_angles(truth)
    nominal = elsewhere(truth)
    described = DhTable.from_chain(nominal.chain)
    middle = np.median(seen.angles, axis=0)
    first = float(truth.servos.offset[0])
    found = meaningful_parameters(arm, seen.units, np.zeros(5, dtype=bool), nominal, first, middle)
    assert found.table.theta_zero == pytest.approx(described.theta_zero, abs=EXACT)
    for part in ("D", "r", "alpha", "beta"):
        learned, expected = getattr(found.table, part), getattr(described, part)
        assert learned == pytest.approx(expected, abs=1e-9), part
    # The description is exact here, so that joint displacements are its own, all of them.
    assert found.servos.offset == pytest.approx(truth.servos.offset, abs=1e-9)


def test_displacements_stay_within_half_a_turn_of_the_data(make_truth):
    truth = make_truth(4, 2, unit="counts", kind="elbow")
    for turns in (-3, 0, 2):
        offset = truth.servos.offset + 2.0 * np.pi * turns * truth.servos.gear
        far = replace(truth, servos=replace(truth.servos, offset=offset))
        arm, seen = arm_and_angles(far)
        middle = np.median(seen.angles, axis=0)
        found = meaningful_parameters(
            arm, seen.units, np.zeros(4, dtype=bool), elsewhere(truth), None, middle
        )
        q = (seen.angles - found.servos.offset) / found.servos.gear
        assert np.abs(np.median(q, axis=0)).max() <= np.pi + 1e-9


@pytest.mark.slow
def test_the_first_zero_comes_from_the_limits_and_no_point_could_tell_it(make_truth):
    truth = make_truth(4, 2, unit="counts", kind="elbow")
    nominal = elsewhere(truth)
    data = truth.dataset(truth.poses(60, 1))
    stops = np.sort(truth.servos.to_encoder(np.outer([-1.5, 1.5], np.ones(4))), axis=0)
    joints = tuple(
        replace(joint, lower=low, upper=high)
        for joint, low, high in zip(data.joints, *stops.tolist(), strict=True)
    )
    with_limits = calibrate_kinematics(replace(data, joints=joints), nominal=nominal)
    only_first = (joints[0], *data.joints[1:])
    first_alone = calibrate_kinematics(replace(data, joints=only_first), nominal=nominal)
    for result in (with_limits, first_alone):
        assert result.model.servos.offset == pytest.approx(truth.servos.offset, abs=1e-6)
        assert result.model.dh.theta_zero == pytest.approx(
            DhTable.from_chain(nominal.chain).theta_zero, abs=1e-9
        )
        assert truth.errors(result.model, truth.poses(30)).max() < 1e-9

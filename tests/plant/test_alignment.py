from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vector_of
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model import DhTable, ParameterCovariance
from nico_selfmodel.plant import aligned_to, alignment

WHOLE_TURN = 2.0 * np.pi


def whole_turns(angle):
    return np.abs(np.remainder(np.asarray(angle) + np.pi, WHOLE_TURN) - np.pi)


def reversed_joints(chain, signs):
    return replace(chain, directions=chain.directions * np.asarray(signs, dtype=float)[:, None])


def with_covariance(model, seed=0):
    """Return the model with a covariance of all that is not gauge."""
    names = tuple(n for n in model.parameters.names if n not in model.parameters.gauge)
    a = np.random.default_rng(seed).normal(size=(len(names), len(names)))
    return replace(model, covariance=ParameterCovariance(names, 1e-6 * a @ a.T))


def assert_same_predictions(model, other):
    n = len(model.joints)
    readings = np.random.default_rng(2).uniform(-2000, 2000, (6, n))
    readings = readings if model.servos.unit[0] == "counts" else readings * 1e-3
    for marker in model.markers:
        before, after = model.predict(readings, marker), other.predict(readings, marker)
        np.testing.assert_allclose(after.p_WH, before.p_WH, atol=1e-12)
        if model.covariance is not None:
            scale = np.abs(before.covariance).max()
            np.testing.assert_allclose(after.covariance, before.covariance, atol=1e-8 * scale)


@pytest.mark.parametrize("kind", ["right_arm", "left_arm", "neck", "six", "seven", "near_parallel"])
@pytest.mark.parametrize("reverse", [False, True])
def test_aligning_changes_words_and_no_prediction(describe, build_individual, learn, kind, reverse):
    arm = describe(kind)
    n = len(arm.joints)
    nominal = DhTable.from_chain(arm.chain)
    signs = np.random.default_rng(5).choice([1.0, -1.0], n) if reverse else np.ones(n)
    chain = reversed_joints(build_individual(arm.chain, seed=1), signs)
    model = with_covariance(learn(chain))
    aligned = aligned_to(model, nominal)
    assert_same_predictions(model, aligned)
    like = DhTable.from_chain(aligned.chain, like=nominal)
    assert whole_turns(like.theta_zero - nominal.theta_zero).max() < 1e-9
    # The table itself is in the nominal one's form, so that a person can compare the rows.
    for part in ("D", "r", "alpha", "beta"):
        np.testing.assert_allclose(getattr(aligned.dh, part), getattr(like, part), atol=1e-9)
    assert whole_turns(aligned.dh.theta_zero - nominal.theta_zero).max() < 1e-9


def test_axes_that_the_geometry_tells_apart_count_as_the_robot_does(
    describe, build_individual, learn
):
    arm = describe("seven")
    nominal = DhTable.from_chain(arm.chain)
    for seed in range(5):
        signs = np.random.default_rng(seed).choice([1.0, -1.0], 7)
        model = learn(reversed_joints(build_individual(arm.chain, seed), signs))
        aligned = aligned_to(model, nominal)
        # Axes 1 and 2 meet at 90 deg and 2 is 34 mm from its neighbours on 1.3 m: too little.
        np.testing.assert_array_equal(aligned.servos.sign[2:], (signs * model.servos.sign)[2:])
        np.testing.assert_allclose(aligned.dh.D[2:], nominal.D[2:], atol=0.05)


def test_an_aligned_model_is_left_as_it_is_to_the_last_bit(describe, build_individual, learn):
    arm = describe("right_arm")
    nominal = DhTable.from_chain(arm.chain)
    once = aligned_to(with_covariance(learn(build_individual(arm.chain, 3))), nominal)
    twice = aligned_to(once, nominal)
    for part in ("X_W0", "D", "theta_zero", "r", "alpha", "beta", "p_NH"):
        np.testing.assert_array_equal(getattr(twice.dh, part), getattr(once.dh, part))
    np.testing.assert_array_equal(twice.servos.offset, once.servos.offset)
    assert twice.covariance is once.covariance


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_encoders_in_radians_or_degrees_mean_what_they_say(describe, build_individual, learn, unit):
    arm = describe("right_arm")
    nominal = DhTable.from_chain(arm.chain)
    model = learn(build_individual(arm.chain, 4), unit, nominal)
    aligned = aligned_to(model, nominal, X_WB=np.eye(4))
    np.testing.assert_array_equal(aligned.dh.theta_zero, model.dh.theta_zero)
    np.testing.assert_array_equal(aligned.servos.offset, model.servos.offset)
    np.testing.assert_array_equal(aligned.servos.sign, model.servos.sign)


def test_the_robots_stand_settles_the_first_joints_zero(describe, learn):
    arm = describe("right_arm")
    X_WB = transform(rotation_from_vector([0.3, -1.2, 0.5]), [0.1, 0.2, 0.3])
    turned = np.array([0.8, -0.3, 0.2, 0.5])
    model = learn(arm.chain.moved(X_WB).rezeroed(turned))
    nominal = DhTable.from_chain(arm.chain)
    roughly = X_WB @ transform(rotation_from_vector([0.0, 0.0, 0.02]), np.zeros(3))
    readings = np.array([100.0, 200.0, 300.0, 400.0])
    true_q = model.servos.to_joint(readings) + turned
    for known, tolerance in ((X_WB, 1e-9), (roughly, 0.03)):
        aligned = aligned_to(model, nominal, X_WB=known)
        q = aligned.servos.to_joint(readings)
        assert whole_turns(q - true_q).max() < tolerance
        assert_same_predictions(model, aligned)
    assert whole_turns(aligned_to(model, nominal).servos.to_joint(readings) - true_q)[0] > 0.1


def test_a_hand_on_the_last_axis_leaves_the_last_zero_alone(describe, build_individual, learn):
    arm = describe("on_axis")
    model = learn(build_individual(arm.chain, 1))
    aligned = aligned_to(model, DhTable.from_chain(arm.chain))
    assert_same_predictions(model, aligned)
    n = len(arm.joints) - 1
    assert abs(aligned.servos.offset[n]) == abs(model.servos.offset[n])


@pytest.mark.parametrize("vector", [[0.0, 0.0, 0.0], [0.4, -0.2, 1.0], [3.1, 0.1, 0.0]])
def test_the_derivative_of_a_turned_rotation_vector_holds_up_to_half_turns(vector):
    turn = np.diag([1.0, -1.0, -1.0])
    x = transform(rotation_from_vector(vector), np.zeros(3))
    derivative = alignment._rotation_vector_jacobian(x, turn)
    turned = rotation_vector_of(x[:3, :3] @ turn)
    for step in 1e-4 * np.eye(3):
        moved = rotation_from_vector(turned + derivative @ step)
        expected = rotation_from_vector(rotation_vector_of(x[:3, :3]) + step) @ turn
        np.testing.assert_allclose(moved, expected, atol=1e-7)


def test_other_joints_are_refused(describe, learn):
    neck = DhTable.from_chain(describe("neck").chain)
    with pytest.raises(ModelError, match="the robot neck_yaw, neck_pitch, neck_roll"):
        aligned_to(learn(describe("right_arm").chain), neck)

"""The self-model: what it predicts, and that nobody can change it."""

import dataclasses

import numpy as np
import pytest

from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel


@pytest.fixture
def readings(model):
    q = np.random.default_rng(1).uniform(-2.0, 2.0, (6, len(model.joints)))
    return model.servos.to_encoder(q)


def test_the_prediction_is_the_chain_at_the_joint_angles(model, readings):
    q = model.servos.to_joint(readings)
    for marker, index in ((None, 0), ("marker_1", 1), (np.ones(6, dtype=int), 1)):
        found = model.predict(readings, marker)
        assert found.p_WH == pytest.approx(model.chain.forward(q, index), abs=1e-12)
        assert found.p_WH == pytest.approx(model.dh.forward(q, index), abs=1e-12)
    mixed = model.predict(readings, np.array([0, 1] * 3)).p_WH
    assert mixed[1] == pytest.approx(model.chain.forward(q[1], 1), abs=1e-12)
    assert model.predict(readings[0]).p_WH.shape == (1, 3)


def test_the_covariance_of_a_prediction_is_that_of_the_parameters_carried_on(model, readings):
    prediction = model.predict(readings)
    parameters, h = model.parameters, 1e-6
    angles, marker = model.servos.to_radians(readings), np.zeros(6, dtype=int)
    columns = []
    for name in model.covariance.names:
        step = h * np.eye(len(parameters.names))[parameters.names.index(name)]
        ahead, behind = (
            parameters.with_values(parameters.values + s).predict(angles, marker)[0]
            for s in (step, -step)
        )
        columns.append((ahead - behind) / (2 * h))
    j = np.stack(columns, axis=2)
    expected = np.einsum("nij,jk,nlk->nil", j, model.covariance.matrix, j)
    assert prediction.covariance.shape == (6, 3, 3)
    assert prediction.covariance == pytest.approx(expected, rel=1e-5, abs=1e-12)


def test_the_covariance_of_a_prediction_is_the_spread_of_arms_drawn_from_it(model, readings):
    rng, parameters = np.random.default_rng(2), model.parameters
    small = ParameterCovariance(model.covariance.names, model.covariance.matrix * 1e-4)
    prediction = dataclasses.replace(model, covariance=small).predict(readings)
    columns = [parameters.names.index(name) for name in small.names]
    drawn = np.tile(parameters.values, (400, 1))
    drawn[:, columns] += rng.multivariate_normal(np.zeros(len(columns)), small.matrix, 400)
    angles, marker = model.servos.to_radians(readings), np.zeros(6, dtype=int)
    points = np.array([parameters.with_values(v).predict(angles, marker)[0] for v in drawn])
    spread = np.sqrt(np.mean((points - prediction.p_WH) ** 2, axis=(0, 2)))
    assert prediction.sigma / spread == pytest.approx(np.ones(6), abs=0.15)


def test_sigmas_are_of_one_coordinate_and_the_total_has_the_noise(model, readings):
    prediction = model.predict(readings)
    traces = np.array([np.trace(c) for c in prediction.covariance])
    assert prediction.sigma == pytest.approx(np.sqrt(traces / 3.0))
    assert prediction.total_sigma == pytest.approx(
        np.sqrt(traces / 3.0 + model.noise_sigma**2), rel=1e-12
    )


def test_what_is_not_known_is_none_and_not_zero(model, readings):
    nominal = dataclasses.replace(model, covariance=None, noise_sigma=None).predict(readings)
    assert (nominal.covariance, nominal.sigma, nominal.total_sigma) == (None, None, None)
    assert dataclasses.replace(model, noise_sigma=None).predict(readings).total_sigma is None


def test_a_wrong_question_names_the_right_ones(model):
    with pytest.raises(ValueError, match=r"shape \(N, 4\) for the joints joint_0, joint_1"):
        model.predict(np.zeros((5, 3)))
    with pytest.raises(ValueError, match=r"got \(2, 5, 4\)"):
        model.predict(np.zeros((2, 5, 4)))
    with pytest.raises(ValueError, match="no marker 'thumb'; there are marker_0, marker_1"):
        model.predict(np.zeros((5, 4)), "thumb")


def test_a_self_model_cannot_be_changed(model):
    for array in (model.dh.D, model.servos.gear, model.covariance.matrix, model.chain.points):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
    for mapping in (model.robot, model.fit, model.provenance):
        with pytest.raises(TypeError):
            mapping["new"] = 1
    with pytest.raises(AttributeError):
        model.name = "other"


def test_what_was_handed_in_is_copied(model):
    fit, matrix = {"rms": 1.0}, np.eye(2)
    covariance = ParameterCovariance(("joint_0.r", "joint_1.r"), matrix)
    copy = dataclasses.replace(model, fit=fit, covariance=covariance)
    fit["rms"], matrix[0, 0] = 2.0, 9.0
    assert copy.fit["rms"] == 1.0
    assert copy.covariance.matrix[0, 0] == 1.0


def test_servos_of_another_arm_are_refused(model, make_servos):
    with pytest.raises(ValueError, match="different joints"):
        SelfModel("mixed", model.dh, make_servos(("a", "b", "c", "d")))
    with pytest.raises(ValueError, match=r"covariance must have shape \(1, 1\)"):
        ParameterCovariance(("joint_0.r",), np.eye(2))


def test_the_chain_of_a_model_is_the_one_it_was_made_of(make_chain, make_servos):
    chain = make_chain(["generic", "intersecting"], 8, markers=2)
    servos = make_servos(chain.joints)
    model = SelfModel("arm", DhTable.from_chain(chain), servos)
    assert (model.joints, model.markers) == (chain.joints, chain.markers)
    assert model.chain.directions == pytest.approx(chain.directions, abs=1e-12)
    assert model.chain is model.chain

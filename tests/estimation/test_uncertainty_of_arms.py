"""What a calibration says of its own errors, against the errors of many recordings."""

import numpy as np
import pytest

from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.initialization.nominal_arm import NominalArm

SIGMA = 5e-4
RECORDINGS = 40


@pytest.fixture(scope="module", params=["counts", pytest.param("rad", marks=pytest.mark.slow)])
def recordings(request, make_truth, joined):
    """Return an arm and what forty recordings of the same poses say of it."""
    truth = make_truth(4, 6, unit=request.param, kind="elbow", markers=2)
    # The description fixes signs and kinds of rows, so that tables can be compared.
    nominal = NominalArm(truth.chain, np.full(4, -np.pi), np.full(4, np.pi))
    poses = truth.poses(60, 1)

    def one(seed):
        circles = truth.dataset(*truth.sweeps(10), sigma=SIGMA, seed=2 * seed, known_sigma=True)
        free = truth.dataset(poses, sigma=SIGMA, seed=2 * seed + 1)
        test = truth.dataset(truth.poses(60, 1000 + seed), sigma=SIGMA, seed=500 + seed)
        return calibrate_kinematics(
            joined(circles, free), test=test, nominal=nominal, starts=0, loss="none"
        )

    return truth, [one(seed) for seed in range(RECORDINGS)]


@pytest.mark.slow
def test_the_sigma_of_every_parameter_is_its_spread_over_recordings(recordings):
    _, results = recordings
    names = results[0].uncertainty.names
    assert all(result.uncertainty.names == names for result in results)
    columns = [results[0].model.parameters.names.index(name) for name in names]
    values = np.stack([result.model.parameters.values[columns] for result in results])
    stated = np.mean([result.uncertainty.sigma for result in results], axis=0)
    ratio = values.std(axis=0, ddof=1) / stated
    # The spread over 40 recordings is itself only known to a ninth.
    assert np.exp(np.mean(np.log(ratio))) == pytest.approx(1.0, abs=0.12)
    assert ratio.min() > 0.65
    assert ratio.max() < 1.45


@pytest.mark.slow
def test_the_stated_covariance_of_the_hand_is_that_of_its_errors(recordings):
    truth, results = recordings
    readings = truth.servos.to_encoder(truth.poses(40, 77))
    scores = []
    for result in results:
        for k, marker in enumerate(truth.chain.markers):
            predicted = result.model.predict(readings, marker)
            error = predicted.p_WH - truth.chain.forward(truth.servos.to_joint(readings), k)
            solved = np.linalg.solve(predicted.covariance, error[:, :, None])[:, :, 0]
            scores.append(np.mean(np.sum(error * solved, axis=1)) / 3.0)
    assert 0.85 < np.mean(scores) < 1.15


@pytest.mark.slow
def test_the_noise_is_the_one_that_was_added(recordings):
    _, results = recordings
    noise = np.array([result.model.noise_sigma for result in results])
    assert noise.mean() == pytest.approx(SIGMA, rel=0.02)
    assert np.abs(noise / SIGMA - 1.0).max() < 0.2


@pytest.mark.slow
def test_a_new_measurement_falls_within_the_total_sigma(recordings):
    truth, results = recordings
    inside = []
    for seed, result in enumerate(results):
        new = truth.dataset(truth.poses(40, 2000 + seed), sigma=SIGMA, seed=900 + seed)
        new = new.select(new.marker == "hand")
        predicted = result.model.predict(new.encoders, "hand")
        off = np.abs(predicted.p_WH - new.p_WH_measured) / predicted.total_sigma[:, None]
        inside.append(np.mean(off < 1.0))
    assert np.mean(inside) == pytest.approx(0.683, abs=0.02)


@pytest.mark.slow
def test_cross_validation_foretells_the_held_out_error(recordings):
    _, results = recordings
    foretold = np.mean([np.mean(result.cross_validation) for result in results])
    held_out = np.mean([result.test.statistics.mean for result in results])
    train = np.mean([result.train.statistics.mean for result in results])
    assert foretold == pytest.approx(held_out, rel=0.05)
    assert train < held_out
    for result in results:
        assert len(result.cross_validation) == len(result.train.observations)


@pytest.mark.slow
@pytest.mark.parametrize("unit", ["rad", "counts"])
def test_more_poses_make_everything_surer(make_truth, unit):
    truth = make_truth(4, 6, unit=unit, kind="elbow")
    few, many = (
        calibrate_kinematics(truth.dataset(truth.poses(count, 1), sigma=SIGMA), seed=1)
        for count in (40, 320)
    )
    assert few.uncertainty.names == many.uncertainty.names
    ratio = many.uncertainty.sigma / few.uncertainty.sigma
    assert np.median(ratio) == pytest.approx(np.sqrt(40.0 / 320.0), rel=0.4)
    assert ratio.max() < 0.8


@pytest.mark.slow
def test_the_measuring_noise_need_not_be_known(make_truth):
    """The stated sigma only whitens: the residuals say what the noise is."""
    truth = make_truth(3, 1, unit="counts")
    sure, unsure = (
        calibrate_kinematics(truth.dataset(truth.poses(60), sigma=SIGMA, known_sigma=known))
        for known in (True, False)
    )
    assert sure.model.noise_sigma == pytest.approx(unsure.model.noise_sigma, rel=1e-3)
    assert sure.uncertainty.sigma == pytest.approx(unsure.uncertainty.sigma, rel=1e-3)

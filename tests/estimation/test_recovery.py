"""From truth to data, from nothing to truth: as well as theory says, whatever the arm."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.initialization.nominal_arm import NominalArm
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform

from ..slow_rest import slow_rest

SIGMA = 3e-4


def assert_as_good_as_theory(result, truth, sigma=SIGMA, factor=1.6):
    """An efficient estimate of p numbers from N points errs by sigma sqrt(p / N)."""
    inliers = len(result.train.observations) - result.outliers.sum()
    expected = sigma * np.sqrt(len(result.free) / inliers)
    rms = np.sqrt(np.mean(truth.errors(result.model, truth.poses(150, 99)) ** 2))
    assert rms < factor * expected, (rms, expected)
    verdict = judge(result)
    assert verdict.status == "PASS", verdict.reasons
    assert result.uncertainty.rank == len(result.free)


def train_and_test(truth, joined, *, sweeps=True, count=None, **noise):
    n = len(truth.chain.joints)
    free = truth.dataset(truth.poses(count or 20 * n, 1), seed=1, **noise)
    train = joined(truth.dataset(*truth.sweeps(10), seed=2, **noise), free) if sweeps else free
    return train, truth.dataset(truth.poses(60, 3), seed=3, sigma=noise.get("sigma", 0.0))


@pytest.mark.parametrize(
    ("n", "unit", "kind", "markers"),
    slow_rest(
        [
            (2, "rad", "outlying", 1),
            (2, "counts", "outlying", 3),
            (3, "counts", "elbow", 1),
            (3, "deg", "parallel", 2),
            (4, "counts", "elbow", 2),
            (5, "counts", "parallel", 1),
            (5, "rad", "outlying", 3),
            (6, "deg", "parallel", 1),
            (6, "counts", "outlying", 2),
            (7, "rad", "elbow", 1),
            (7, "counts", "parallel", 3),
        ],
        plain=2,
    ),
)
def test_an_arm_is_recovered_from_sweeps_and_free_poses(make_truth, joined, n, unit, kind, markers):
    truth = make_truth(n, 5, unit=unit, kind=kind, markers=markers)
    missing = 0.15 if markers > 1 else 0.0
    train, test = train_and_test(truth, joined, sigma=SIGMA, missing=missing)
    result = calibrate_kinematics(train, test=test)
    gears = n if unit == "counts" else 0
    assert len(result.free) == 4 * n + 3 * markers + gears
    assert_as_good_as_theory(result, truth)
    assert result.model.servos.gear == pytest.approx(truth.servos.gear, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("n", "unit", "kind"),
    [
        (2, "counts", "outlying"),
        (4, "counts", "elbow"),
        (5, "rad", "parallel"),
        (6, "counts", "parallel"),
        (7, "rad", "outlying"),
    ],
)
def test_an_arm_is_recovered_without_sweeps_and_without_a_robot(make_truth, joined, n, unit, kind):
    truth = make_truth(n, 3, unit=unit, kind=kind, markers=2)
    train, test = train_and_test(truth, joined, sweeps=False, sigma=SIGMA, missing=0.15)
    result = calibrate_kinematics(train, test=test)
    assert result.circles is None
    assert set(result.search.labels) == {"random axes"}
    assert result.search.agreeing >= 3
    assert_as_good_as_theory(result, truth)


@pytest.mark.slow
@pytest.mark.parametrize("unit", ["rad", "counts"])
def test_data_without_noise_give_the_exact_arm(make_truth, joined, unit):
    truth = make_truth(4, 4, unit=unit, markers=2)
    for sweeps in (True, False):
        train, test = train_and_test(truth, joined, sweeps=sweeps)
        result = calibrate_kinematics(train, test=test)
        assert truth.errors(result.model, truth.poses(50)).max() < 1e-9
        assert not result.outliers.any()
        assert judge(result).status == "PASS"


@pytest.mark.parametrize("loss", slow_rest(["trimmed", "none", "huber", "cauchy", "tukey"]))
def test_every_loss_finds_the_arm_in_clean_data(make_truth, joined, loss):
    truth = make_truth(4, 6, unit="counts", kind="elbow")
    train, test = train_and_test(truth, joined, sigma=SIGMA)
    result = calibrate_kinematics(train, test=test, loss=loss)
    assert_as_good_as_theory(result, truth)
    assert result.outliers.sum() <= 1


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["trimmed", "huber", "cauchy", "tukey"])
def test_robust_losses_find_the_arm_and_the_outliers(make_truth, joined, loss):
    truth = make_truth(4, 6, unit="counts", kind="elbow", markers=2)
    train, test = train_and_test(truth, joined, sigma=SIGMA, outliers=0.1)
    result = calibrate_kinematics(train, test=test, loss=loss)
    assert_as_good_as_theory(result, truth, factor=2.2 if loss == "huber" else 1.6)
    off = truth.servos.to_joint(train.encoders)
    marker = np.where(train.marker == "hand", 0, 1)
    wrong = np.linalg.norm(train.p_WH_measured - truth.chain.forward(off, marker), axis=1)
    assert result.outliers[wrong > 10.0 * SIGMA].all()
    assert not result.outliers[wrong < 3.0 * SIGMA].any()
    plain = calibrate_kinematics(train, test=test, loss="none")
    assert plain.test.statistics.mean > 3.0 * result.test.statistics.mean


def nominal_of(truth, *, size=1.0, limits=True):
    """Return the arm as a description: elsewhere, a little different, with joint limits."""
    rng = np.random.default_rng(11)
    chain = truth.chain
    tilted = chain.directions + size * 0.025 * rng.normal(size=chain.directions.shape)
    built = replace(
        chain,
        directions=tilted / np.linalg.norm(tilted, axis=1, keepdims=True),
        points=chain.points + size * 0.002 * rng.normal(size=chain.points.shape),
        p_WH_zero=chain.p_WH_zero + size * 0.002 * rng.normal(size=chain.p_WH_zero.shape),
    )
    limit = np.full(len(chain.joints), 1.5 if limits else np.inf)
    elsewhere = transform(rotation_from_vector(rng.normal(size=3)), rng.normal(size=3))
    return NominalArm(built.moved(elsewhere), -limit, limit, {"urdf": "arm.urdf"})


def with_limits(dataset, truth):
    stops = truth.servos.to_encoder(np.outer([-1.5, 1.5], np.ones(len(truth.chain.joints))))
    joints = tuple(
        replace(joint, lower=low, upper=high)
        for joint, low, high in zip(dataset.joints, *np.sort(stops, axis=0).tolist(), strict=True)
    )
    return replace(dataset, joints=joints)


@pytest.mark.slow
@pytest.mark.parametrize("unit", ["rad", "counts"])
@pytest.mark.parametrize("n", [4, 7])
def test_a_described_robot_replaces_sweeps(make_truth, joined, n, unit):
    truth = make_truth(n, 2, unit=unit, markers=2)
    truth = replace(truth, servos=replace(truth.servos, offset=np.zeros(n)))
    train, test = train_and_test(truth, joined, sweeps=False, sigma=SIGMA)
    result = calibrate_kinematics(
        with_limits(train, truth), test=with_limits(test, truth), nominal=nominal_of(truth)
    )
    assert result.search.labels[0] == result.search.best_label == "robot"
    assert_as_good_as_theory(result, truth)
    assert result.model.robot["urdf"] == "arm.urdf"


@pytest.mark.slow
@pytest.mark.parametrize("limits", [True, False])
def test_counts_without_limits_cannot_be_placed_and_start_at_random(make_truth, joined, limits):
    truth = make_truth(4, 2, unit="counts")
    train, test = train_and_test(truth, joined, sweeps=False, sigma=SIGMA)
    nominal = nominal_of(truth, limits=limits)
    data = train if limits else with_limits(train, truth)
    result = calibrate_kinematics(data, test=test, nominal=nominal)
    assert set(result.search.labels) == {"random axes"}
    assert_as_good_as_theory(result, truth)


@pytest.mark.slow
def test_a_wrong_description_does_not_keep_the_arm_from_being_found(make_truth, joined):
    truth, other = make_truth(4, 2), make_truth(4, 9)
    train, test = train_and_test(truth, joined, sweeps=False, sigma=SIGMA)
    nominal = nominal_of(other, size=0.0)
    result = calibrate_kinematics(train, test=test, nominal=nominal)
    assert result.search.labels[0] == "robot"
    assert_as_good_as_theory(result, truth)


def test_a_description_of_another_chain_is_refused(make_truth):
    truth = make_truth(4, 2)
    nominal = nominal_of(make_truth(3, 2))
    with pytest.raises(ModelError, match=r"joint_0, joint_1, joint_2, the data set .*joint_3"):
        calibrate_kinematics(truth.dataset(truth.poses(60)), nominal=nominal)


@pytest.mark.slow
def test_the_same_data_and_seed_give_the_same_arm(make_truth, joined):
    truth = make_truth(4, 2, unit="counts")
    train, _ = train_and_test(truth, joined, sweeps=False, sigma=SIGMA)
    first, again = (calibrate_kinematics(train, seed=3).model for _ in range(2))
    assert np.array_equal(first.parameters.values, again.parameters.values)
    other = calibrate_kinematics(train, seed=4).model
    q = truth.servos.to_encoder(truth.poses(30))
    assert other.predict(q).p_WH == pytest.approx(first.predict(q).p_WH, abs=0.05 * SIGMA)


def test_circle_points_say_that_they_hold_nothing_fixed(make_truth):
    truth = make_truth(2, 1)
    pins = FixedParameters.from_text(["j1.gear=1"], ["j0.r"])
    with pytest.raises(ValueError, match=r"fix nor free j0\.r, j1\.gear: take the method"):
        calibrate_kinematics(truth.dataset(truth.poses(60)), method="circle-points", pins=pins)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "magic"}, "no method 'magic'; there are refine, circle-points"),
        ({"loss": "magic"}, "no loss 'magic'; there are trimmed, none, huber"),
    ],
)
def test_unknown_choices_list_those_there_are(make_truth, options, message):
    truth = make_truth(2, 1)
    with pytest.raises(ValueError, match=message):
        calibrate_kinematics(truth.dataset(truth.poses(60)), **options)

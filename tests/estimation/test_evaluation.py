"""A model held against data: what must agree, what may differ, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.arm.evaluation import evaluate
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.observations.observations import Observations

SIGMA = 3e-4


@pytest.fixture(scope="module")
def truth(make_truth):
    return make_truth(3, 2, unit="counts", markers=2)


@pytest.fixture(scope="module")
def model(truth):
    return calibrate_kinematics(truth.dataset(truth.poses(60, 1), sigma=SIGMA)).model


@pytest.fixture(scope="module")
def other(truth):
    return truth.dataset(truth.poses(30, 2), sigma=SIGMA, missing=0.2, seed=5)


def test_residuals_are_measured_minus_predicted_row_by_row(truth, model, other):
    found = evaluate(model, other)
    assert len(found.observations) == other.measured.sum()
    marker = np.where(other.marker == "hand", 0, 1)[other.measured]
    p = model.predict(other.encoders[other.measured], marker).p_WH
    assert found.residuals == pytest.approx(other.p_WH_measured[other.measured] - p)
    assert found.distances == pytest.approx(np.linalg.norm(found.residuals, axis=1))
    assert found.statistics.n == len(found.distances)
    assert found.statistics.rms < 3.0 * SIGMA


def test_joints_may_come_in_another_order(model, other):
    order = [2, 0, 1]
    turned = replace(
        other,
        joints=tuple(other.joints[i] for i in order),
        encoders=other.encoders[:, order],
    )
    assert evaluate(model, turned).distances == pytest.approx(evaluate(model, other).distances)


def test_one_marker_of_several_is_enough(model, other):
    thumb = other.select(other.marker == "thumb")
    found, all_of_it = evaluate(model, thumb), evaluate(model, other)
    of_thumb = all_of_it.observations.marker == 1
    assert found.distances == pytest.approx(all_of_it.distances[of_thumb])


def with_joint(dataset, **changes):
    return replace(dataset, joints=(replace(dataset.joints[0], **changes), *dataset.joints[1:]))


def without_last_joint(dataset):
    return replace(dataset, joints=dataset.joints[:-1], encoders=dataset.encoders[:, :-1])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (without_last_joint, "has the joints joint_0, joint_1, the self-model .*joint_2"),
        (lambda d: with_joint(d, name="knee"), "has the joints knee, .*must be the same"),
        (
            lambda d: with_joint(d, encoder_unit="rad", counts_per_turn=None),
            r"joint_0 is read in rad \(sign \+1\) in .* but in counts \(\d+ a turn, sign \+1\)",
        ),
        (lambda d: with_joint(d, counts_per_turn=4096.0), "4096 a turn.*10000 a turn"),
        (lambda d: with_joint(d, sign=-d.joints[0].sign), r"sign [+-]1.*sign [+-]1"),
        (
            lambda d: replace(d, marker=np.where(d.marker == "hand", "toe", d.marker)),
            "tracks toe, which the self-model does not know; it knows hand, thumb",
        ),
        (
            lambda d: replace(d, p_WH_measured=np.full((len(d), 3), np.nan)),
            "no measured point",
        ),
    ],
)
def test_data_of_another_arm_are_refused_with_both_sides(model, other, change, message):
    with pytest.raises(DataError, match=message):
        evaluate(model, change(other))


def test_a_marker_that_was_never_seen_is_left_out(truth):
    data = truth.dataset(truth.poses(60, 1), sigma=SIGMA)
    lost = np.where((data.marker == "thumb")[:, None], np.nan, data.p_WH_measured)
    result = calibrate_kinematics(replace(data, p_WH_measured=lost))
    assert result.model.markers == ("hand",)
    assert len(result.train.distances) == 60


def test_observations_are_the_measured_rows_in_radians(truth, other):
    found = Observations.from_dataset(other)
    assert found.markers == ("hand", "thumb")
    assert np.array_equal(found.rows, np.flatnonzero(other.measured))
    q = truth.servos.to_joint(other.encoders[found.rows])
    angles = truth.servos.offset + truth.servos.gear * q
    assert found.angles == pytest.approx(angles)
    assert found.size == pytest.approx(
        np.sqrt(np.mean(np.sum((found.p_WH - found.p_WH.mean(axis=0)) ** 2, axis=1)))
    )
    some = found.select(found.marker == 1)
    assert len(some) == (found.marker == 1).sum()
    assert np.array_equal(other.sample[some.rows], some.sample)


def test_too_few_samples_say_how_many_are_needed(make_truth):
    truth = make_truth(4, 2, unit="counts")
    with pytest.raises(DataError, match=r"7 measured points.*21 equations for 23.*least 8 points"):
        calibrate_kinematics(truth.dataset(truth.poses(7)))
    rad = make_truth(4, 2)
    with pytest.raises(DataError, match=r"6 measured points.*18 equations for 19.*least 7 points"):
        calibrate_kinematics(rad.dataset(rad.poses(6)))


@pytest.mark.parametrize("unit", ["rad", "counts"])
def test_a_joint_that_never_moved_is_named(make_truth, unit):
    truth = make_truth(4, 2, unit=unit)
    q = truth.poses(60)
    q[:, [0, 2]] = 0.3
    with pytest.raises(DataError, match=r"joint_0, joint_2 never moved.*its encoder stands still"):
        calibrate_kinematics(truth.dataset(q))


def test_points_that_never_moved_are_refused(truth):
    data = truth.dataset(truth.poses(60))
    still = np.tile(data.p_WH_measured[:1], (len(data), 1))
    with pytest.raises(DataError, match="do not move"):
        calibrate_kinematics(replace(data, p_WH_measured=still))


def test_nothing_measured_is_refused(truth):
    data = truth.dataset(truth.poses(60))
    empty = replace(data, p_WH_measured=np.full((len(data), 3), np.nan))
    assert isinstance(empty, Dataset)
    with pytest.raises(DataError, match="no measured point"):
        calibrate_kinematics(empty)

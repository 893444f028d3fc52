"""Backlash by the direction of approach: learned where data say from which side joints came."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.folder import load_dataset, save_dataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.monitoring.health import check_health
from nico_selfmodel.model.self_model_file import load_model, save_model

from .sagging_arms import SaggingArm


@pytest.fixture(scope="module")
def recorded():
    rng = np.random.default_rng((3, 93))
    arm = SaggingArm.drawn(rng, sag=0.0, backlash=0.4)
    train, _ = arm.recorded(rng, 60)
    return arm, train, *arm.recorded(rng, 100)


@pytest.fixture(scope="module")
def learned(recorded):
    _, train, test, _ = recorded
    return calibrate_kinematics(train, test=test, explain=False)


def nees(model, test, true, approach):
    found = model.predict(test.encoders, 0, approach)
    e = found.p_WH - true
    return float(np.mean(np.einsum("ni,nij,nj->n", e, np.linalg.inv(found.covariance), e))) / 3.0


@pytest.mark.slow
def test_the_column_takes_most_of_the_error_away(recorded, learned):
    arm, train, test, true = recorded
    without = calibrate_kinematics(replace(train, approach=None), explain=False)
    assert learned.ladder.kept == ("backlash",)
    before, after = (
        np.linalg.norm(model.predict(test.encoders, 0, side).p_WH - true, axis=1).mean()
        for model, side in ((without.model, None), (learned.model, test.approach))
    )
    assert after < 0.1 * before
    assert learned.model.bending.backlash == pytest.approx(arm.backlash, rel=0.06)
    assert judge(learned).status == "PASS"
    assert any("behind their drives" in reason for reason in judge(learned).reasons)


@pytest.mark.slow
def test_a_prediction_from_an_unknown_side_carries_the_half_width(recorded, learned):
    _, _, test, true = recorded
    sure, unsure = (
        learned.model.predict(test.encoders, 0, side).sigma for side in (test.approach, None)
    )
    assert (unsure > 3.0 * sure).all()
    assert 0.7 < nees(learned.model, test, true, None) < 1.3
    assert 0.3 < nees(learned.model, test, true, test.approach) < 2.0


@pytest.mark.slow
def test_a_healthy_arm_is_healthy_whether_its_sides_are_told_or_not(recorded, learned):
    _, _, test, _ = recorded
    for data in (test, replace(test, approach=None)):
        assert check_health(learned.model, data).healthy


@pytest.mark.slow
def test_units_and_wiring_change_nothing(recorded, learned):
    _, train, test, _ = recorded
    turned = tuple(replace(j, encoder_unit="deg", sign=-1) for j in train.joints)
    same = [
        replace(d, joints=turned, encoders=-np.degrees(d.encoders), approach=-d.approach)
        for d in (train, test)
    ]
    other = calibrate_kinematics(same[0], explain=False)
    assert other.model.bending.backlash == pytest.approx(learned.model.bending.backlash, rel=1e-4)
    both = (
        learned.model.predict(test.encoders, 0, test.approach).p_WH,
        other.model.predict(same[1].encoders, 0, same[1].approach).p_WH,
    )
    assert both[0] == pytest.approx(both[1], abs=1e-6)


@pytest.mark.slow
def test_a_rigid_arm_keeps_none_though_its_sides_are_told():
    rng = np.random.default_rng((4, 93))
    arm = SaggingArm.drawn(rng, sag=0.0)
    train, _ = arm.recorded(rng, 60)
    side = np.sign(np.diff(train.encoders, axis=0, prepend=0.0))
    learned = calibrate_kinematics(replace(train, approach=side), explain=False)
    assert learned.ladder.kept == ()
    assert "backlash" in {step.effect for step in learned.ladder.steps}


@pytest.mark.slow
def test_it_is_not_asked_where_nobody_tells_both_sides(recorded):
    _, train, _, _ = recorded
    for side in (None, np.ones(train.encoders.shape)):
        data = replace(train, approach=side)
        steps = calibrate_kinematics(data, explain=False).ladder.steps
        assert "backlash" not in {step.effect for step in steps}
    asked = calibrate_kinematics(
        replace(train, approach=None), explain=False, effects=("backlash",)
    )
    assert any("approach.<joint>" in words for words in judge(asked).warnings)


@pytest.mark.slow
def test_it_outlives_its_file(recorded, learned, tmp_path):
    _, _, test, _ = recorded
    save_model(learned.model, tmp_path / "model.yaml")
    again = load_model(tmp_path / "model.yaml")
    both = (m.predict(test.encoders, 0, test.approach).p_WH for m in (learned.model, again))
    assert next(both) == pytest.approx(next(both), abs=1e-12)
    save_dataset(test, tmp_path / "data")
    assert (load_dataset(tmp_path / "data").approach == test.approach).all()


@pytest.mark.slow
def test_sides_that_are_none_are_refused(recorded, learned, tmp_path):
    _, train, test, _ = recorded
    with pytest.raises(ValueError, match="approach must be -1, 0 or 1"):
        replace(train, approach=np.full(train.encoders.shape, 2))
    with pytest.raises(ValueError, match="approach must be -1, 0 or 1"):
        learned.model.predict(test.encoders, 0, np.full(test.encoders.shape, 0.5))
    save_dataset(train, tmp_path / "data")
    table = tmp_path / "data" / "samples.csv"
    lines = table.read_text().splitlines()
    place = lines[0].split(",").index("approach.j1")
    cells = lines[1].split(",")
    cells[place] = "3"
    table.write_text("\n".join([lines[0], ",".join(cells), *lines[2:]]) + "\n")
    with pytest.raises(DataError, match=r"line 2, column 'approach.j1': 3 is no side; expected 1"):
        load_dataset(tmp_path / "data")


def test_markers_of_one_sample_came_from_one_side():
    rng = np.random.default_rng((5, 93))
    arm = SaggingArm.drawn(rng, backlash=0.4, markers=2)
    train, _ = arm.recorded(rng, 3)
    side = train.approach.copy()
    side[1, 2] *= -1
    with pytest.raises(DataError, match="came from another side in row 0"):
        replace(train, approach=side)

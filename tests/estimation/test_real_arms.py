"""Real arms: a positioner on a grid of poses, and a Franka arm without any sweep."""

import numpy as np
import pytest

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.folder import load_dataset
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.judging import judge


@pytest.fixture(scope="module")
def positioner(project_root):
    return load_dataset(project_root / "examples" / "data" / "positioner_two_axis")


@pytest.fixture(scope="module")
def franka(project_root):
    return load_dataset(project_root / "examples" / "data" / "franka_fr3")


def between_axes_deg(result):
    first, second = result.model.chain.directions
    return np.degrees(np.arccos(abs(first @ second)))


def rms_mm(evaluation):
    return 1e3 * evaluation.statistics.rms


def test_the_positioners_axes_are_square_by_its_circles_alone(positioner):
    assert len(positioner) == 205
    result = calibrate_kinematics(positioner, method="circle-points")
    assert 89.95 <= between_axes_deg(result) <= 90.0
    radial = [1e3 * fit.circle.rms for fit in result.circles.circles]
    assert len(radial) == 13 + 16
    # Free circles lie within 0.43 mm; these also have to turn as their encoders say.
    assert np.median(radial) < 0.43


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["trimmed", "none", "cauchy"])
def test_the_positioner_is_refined_to_its_noise(positioner, loss):
    result = calibrate_kinematics(positioner, loss=loss)
    assert rms_mm(result.train) <= 0.405
    assert 89.95 <= between_axes_deg(result) <= 90.0
    assert not result.outliers.any()
    assert result.uncertainty.unobservable == ()
    assert np.sqrt(np.mean(result.cross_validation**2)) <= 0.41e-3
    assert judge(result).status == "NOT_EVALUATED"


@pytest.mark.slow
def test_a_positioner_whose_tilt_and_turn_are_swapped_in_order_does_not_fit(positioner):
    """A chain has an order: the base's joint comes first."""
    order = [1, 0]
    swapped = Dataset(
        name="swapped",
        joints=tuple(positioner.joints[i] for i in order),
        sample=positioner.sample,
        encoders=positioner.encoders[:, order],
        p_WH_measured=positioner.p_WH_measured,
    )
    verdict = judge(calibrate_kinematics(swapped))
    assert verdict.status == "FAIL", verdict


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_franka_arm_is_learned_from_nothing_but_poses(franka, seed):
    assert len(franka) == 114
    order = np.random.default_rng(0).permutation(114)
    train, test = franka.select(order[:80]), franka.select(order[80:])
    result = calibrate_kinematics(train, test=test, seed=seed)
    assert rms_mm(result.test) <= 2.40
    assert judge(result).status == "PASS"
    assert result.ladder.kept == ("coupling",)
    # Of an arm that bends at all gears are uncertain, too, held at 1 by what the data tell of them.
    gears = {f"{joint}.gear" for joint in result.model.joints}
    assert len(result.free - set(result.model.bending.names) - gears) == 4 * 7 + 3
    assert np.abs(result.model.servos.gear - 1.0).max() < 0.01
    assert result.circles is None
    assert result.search.agreeing >= 3


@pytest.mark.slow
def test_a_franka_arm_is_learned_with_the_projects_own_split_too(franka):
    train, test = franka.split(34 / 114, 0)
    assert (len(train), len(test)) == (81, 33)
    result = calibrate_kinematics(train, test=test)
    assert rms_mm(result.test) <= 2.40
    assert judge(result).status == "PASS"


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["none", "huber", "cauchy", "tukey"])
def test_a_franka_arm_is_learned_with_other_losses(franka, loss):
    order = np.random.default_rng(0).permutation(114)
    result = calibrate_kinematics(
        franka.select(order[:80]), test=franka.select(order[80:]), loss=loss
    )
    assert rms_mm(result.test) <= 2.40


@pytest.mark.slow
def test_a_frankas_axes_meet_at_right_angles_or_run_parallel(franka):
    """What its maker says of it, found without being told."""
    directions = calibrate_kinematics(franka, explain=False, effects=()).model.chain.directions
    at_zero = np.degrees(np.arccos(np.abs(np.sum(directions[:-1] * directions[1:], axis=1))))
    assert at_zero == pytest.approx(np.full(6, 90.0), abs=1.0)

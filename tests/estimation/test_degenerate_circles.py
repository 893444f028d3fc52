"""Circles that say nothing are recognised, with a reason, and the refinement does without them."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import NotIdentifiableError
from nico_selfmodel.estimation.arm.kinematic_task import sweeps_of
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.initialization.circle_points import analyse_circle_points
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.observations.observations import Observations

from ..slow_rest import slow_rest

SIGMA = 5e-4


@pytest.fixture(scope="module")
def axis_through_hand():
    """Return a function that moves an axis until it passes a distance from the hand."""

    def move(truth, joint, off=0.0):
        chain = truth.chain
        d, points = chain.directions[joint], chain.points.copy()
        aside = np.cross(d, [0.3, 0.5, 0.8])
        points[joint] = chain.p_WH_zero[0] - 0.1 * d + off * aside / np.linalg.norm(aside)
        return replace(truth, chain=replace(chain, points=points))

    return move


def circles_alone(truth, seed, points=20, arc=1.6):
    data = truth.dataset(*truth.sweeps(points, arc), sigma=SIGMA, seed=seed)
    return calibrate_kinematics(data, method="circle-points")


@pytest.mark.parametrize("unit", slow_rest(["counts", "rad"]))
@pytest.mark.parametrize("joint", [0, 1, 3])
def test_a_point_on_the_axis_is_never_silently_used(make_truth, axis_through_hand, joint, unit):
    for seed in range(6):
        truth = axis_through_hand(make_truth(4, seed, unit=unit), joint)
        with pytest.raises(NotIdentifiableError, match=f"joint_{joint}.*from its axis") as error:
            circles_alone(truth, seed)
        analysis = error.value.partial
        assert analysis.arm is None
        assert not analysis.trusted[joint:].any()
        assert np.isnan(analysis.directions[joint:]).all()


@pytest.mark.slow
@pytest.mark.parametrize("unit", ["rad", "counts"])
def test_an_axis_near_the_point_is_refused_or_as_good_as_it_says(
    make_truth, axis_through_hand, unit
):
    """A cloud of noise has a circle, too; what gives it away is that it does not turn."""
    used, wrong = 0, []
    for off in (0.0, 1e-3, 2e-3, 5e-3):
        for seed in range(30):
            truth = axis_through_hand(make_truth(2, seed, unit=unit), 0, off)
            data = truth.dataset(*truth.sweeps(20), sigma=SIGMA, seed=seed)
            observations = Observations.from_dataset(data)
            analysis = analyse_circle_points(
                observations,
                sweeps_of(data, observations),
                np.full(2, unit == "rad"),
                np.random.default_rng(seed),
            )
            if np.isfinite(analysis.directions[0]).all():
                used += 1
                cosine = np.clip(analysis.directions[0] @ truth.chain.directions[0], -1.0, 1.0)
                sigmas = np.arccos(cosine) / analysis.axis_sigma[0]
                wrong += [(off, seed, float(sigmas))] if sigmas > 8.0 else []
    assert used >= 20
    assert not wrong


@pytest.mark.parametrize("unit", ["rad", "counts"])
def test_a_short_arc_in_noise_is_refused_with_its_height(make_truth, unit):
    truth = make_truth(4, 1, unit=unit)
    q, labels = truth.sweeps(20)
    q[np.array(labels) == "joint_2"] *= 0.04
    data = truth.dataset(q, labels, sigma=SIGMA)
    with pytest.raises(NotIdentifiableError, match=r"joint_2 .*mm.*sweep it further"):
        calibrate_kinematics(data, method="circle-points")


def test_an_axis_that_few_points_leave_uncertain_is_refused_with_its_degrees(make_truth):
    truth = make_truth(3, 1, unit="counts")
    refused = []
    for seed in range(20):
        data = truth.dataset(*truth.sweeps(5, arc=0.9), sigma=3e-3, seed=seed)
        try:
            axis_sigma = calibrate_kinematics(data, method="circle-points").circles.axis_sigma
        except NotIdentifiableError as error:
            refused.append(str(error))
        else:
            assert (axis_sigma <= np.radians(15.0)).all()
    assert any("the axis of joint_" in r and "uncertain by" in r for r in refused)


def test_a_point_exactly_on_the_axis_draws_no_circle(make_truth, axis_through_hand):
    truth = axis_through_hand(make_truth(4, 1), 2)
    data = truth.dataset(*truth.sweeps(12))
    with pytest.raises(NotIdentifiableError, match="joint_2 has no sweep with three different"):
        calibrate_kinematics(data, method="circle-points")


def test_a_joint_without_a_sweep_is_named(make_truth):
    truth = make_truth(4, 1)
    q, labels = truth.sweeps(12)
    keep = np.array(labels) != "joint_1"
    with pytest.raises(NotIdentifiableError, match="joint_1 has no sweep"):
        calibrate_kinematics(truth.dataset(q, labels).select(keep), method="circle-points")
    with pytest.raises(NotIdentifiableError, match="joint_0 has no sweep"):
        calibrate_kinematics(truth.dataset(truth.poses(30)), method="circle-points")


@pytest.mark.slow
@pytest.mark.parametrize("unit", ["rad", "counts"])
def test_a_second_marker_off_the_axis_rescues_the_circle(make_truth, hand_on_last_axis, unit):
    """The marker on the axis draws a blob beside the other's circle."""
    ratios = []
    for seed in range(8):
        truth = make_truth(4, seed, unit=unit, markers=2)
        on_axis = hand_on_last_axis(truth, 0.0).chain.p_WH_zero[0]
        hands = np.stack([on_axis, truth.chain.p_WH_zero[1]])
        mixed = replace(truth, chain=replace(truth.chain, p_WH_zero=hands))
        ratios.append(
            mixed.errors(circles_alone(mixed, seed).model, mixed.poses(50)).mean()
            / truth.errors(circles_alone(truth, seed).model, truth.poses(50)).mean()
        )
    assert np.median(ratios) < 1.7
    assert max(ratios) < 4.0


@pytest.mark.slow
@pytest.mark.parametrize("unit", ["rad", "counts"])
@pytest.mark.parametrize("joint", [0, 1, 2])
def test_the_refinement_learns_the_arm_all_the_same(
    make_truth, axis_through_hand, joined, joint, unit
):
    truth = axis_through_hand(make_truth(4, 2, unit=unit), joint)
    circles = truth.dataset(*truth.sweeps(15), sigma=SIGMA)
    train = joined(circles, truth.dataset(truth.poses(60, 1), sigma=SIGMA, seed=1))
    test = truth.dataset(truth.poses(60, 2), sigma=SIGMA, seed=2)
    result = calibrate_kinematics(train, test=test)
    assert judge(result).status == "PASS"
    assert result.search.agreeing >= 3
    inliers = np.sqrt(len(result.free) / len(train))
    rms = np.sqrt(np.mean(truth.errors(result.model, truth.poses(100, 3)) ** 2))
    assert rms < 2.0 * inliers * SIGMA
    assert result.model.noise_sigma == pytest.approx(SIGMA, rel=0.15)


@pytest.mark.slow
def test_trusted_axes_narrow_the_random_starts(make_truth, axis_through_hand, joined):
    truth = axis_through_hand(make_truth(6, 1), 3)
    circles = truth.dataset(*truth.sweeps(15), sigma=SIGMA)
    train = joined(circles, truth.dataset(truth.poses(60, 1), sigma=SIGMA, seed=1))
    result = calibrate_kinematics(train)
    assert result.circles.arm is None
    assert result.circles.trusted.tolist() == [True] * 3 + [False] * 3
    assert set(result.search.labels) == {"random axes"}
    assert truth.errors(result.model, truth.poses(50)).max() < 3.0 * SIGMA

"""A self-model with cameras held against what they saw, and how its poses are counted."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.estimation import model_verdict as module
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.body.body_findings import _held_out_words, body_findings
from nico_selfmodel.estimation.body.body_options import BodyOptions
from nico_selfmodel.estimation.body.body_result import pixel_errors
from nico_selfmodel.estimation.body.stereo_points import StereoPoints
from nico_selfmodel.estimation.model_verdict import judge_evaluation
from nico_selfmodel.estimation.noise.hand_observations import by_pixels
from nico_selfmodel.estimation.observations.pixel_evaluation import evaluate_pixels
from nico_selfmodel.estimation.observations.pixel_observations import PixelObservations
from nico_selfmodel.estimation.results.verdict import significantly_above

from .simulated_bodies import blinded, body, learned, only_cameras, poses, scenario


@pytest.fixture(scope="module")
def refined():
    """Return a body, and what its cameras saw in new poses."""
    return learned(0).model, only_cameras(scenario().test)


@pytest.fixture(scope="module")
def arm_by_sight():
    """Return an arm that was learned from points its cameras rebuilt, with the cameras in it."""
    stereo = StereoPoints.of(scenario().cameras, scenario().train)
    return stereo.complete(calibrate_kinematics(stereo.train, loss="none", starts=3)).model


def judged(model, data):
    return judge_evaluation(model, data, evaluate_pixels(model, data))


def twice(data, marker="thumb"):
    """Return data in which every pose shows a second point, where the first is."""
    arrays = ("encoders", "p_WH_measured", "sample", "sweep", "marker", "pixels", "mirror")
    both = {name: np.repeat(getattr(data, name), 2, axis=0) for name in arrays}
    both["marker"] = np.array(["hand", marker] * len(data))
    return replace(data, **both, extra={})


def with_thumb(model):
    """Return the model with a second point, where the first is."""
    hand = np.repeat(model.table.p_NH, 2, axis=0)
    table = replace(model.table, markers=("hand", "thumb"), p_NH=hand)
    return replace(model, table=table, covariance=None)


def test_new_poses_of_the_same_body_pass_in_space_and_in_the_images(refined):
    verdict = judged(*refined)
    assert verdict.status == "PASS"
    assert "mm and" in verdict.reasons[0]
    assert "px, expected" in verdict.reasons[0]


def test_a_joint_that_slipped_fails(refined):
    model, data = refined
    slipped = data.encoders.copy()
    slipped[:, 1] += 0.03 * np.ptp(slipped[:, 1])
    assert judged(model, replace(data, encoders=slipped)).status == "FAIL"


def test_data_of_another_robot_are_asked_whose_they_are(refined):
    model, data = refined
    seen = data.pixels[::-1]
    (reason,) = judged(model, replace(data, pixels=seen)).reasons
    assert "with rows, joints and units as they were in training?" in reason
    assert reason.endswith(
        "`nico-selfmodel monitor` says which readings were taken wrongly, if it is that"
    )


@pytest.mark.parametrize(("times", "said"), [(21.0, "one robot"), (19.0, "something moved")])
def test_twenty_times_the_expected_error_is_no_change_of_a_body(times, said):
    errors = 1e-3 * times * np.ones(30)
    one = module._Compared.of(errors, 1e-3, 30, 100, 1e3, "mm")
    assert said in module._beside_training([one], None).reasons[0]


def test_pixels_alone_tell_of_a_camera_that_turned(refined):
    """One camera sees no depth: what moved shows in its image alone."""
    model, data = refined
    one_eyed = blinded(data, slice(None), 1)
    assert judged(model, one_eyed).status == "PASS"
    pixels = one_eyed.pixels + np.array([8.0, 0.0, 0.0, 0.0])
    assert judged(model, replace(one_eyed, pixels=pixels)).status == "FAIL"


def test_a_sighting_that_nothing_explains_is_named_though_the_rest_is_well(refined):
    model, data = refined
    pixels = data.pixels.copy()
    pixels[7, 0] += 60.0
    verdict = judged(model, replace(data, pixels=pixels))
    assert verdict.status == "PASS"
    assert f"1 of {len(data)} detections" in verdict.reasons[0]
    assert f"sample {data.sample[7]}" in verdict.reasons[0]


@pytest.mark.slow
def test_an_arm_learned_through_cameras_is_held_against_points_that_they_rebuild(
    arm_by_sight, refined
):
    data = refined[1]
    assert judged(arm_by_sight, data).status == "PASS"
    pixels = data.pixels.copy()
    pixels[7] += [60.0, 0.0, 0.0, 0.0]
    wrong = judged(arm_by_sight, replace(data, pixels=pixels))
    assert f"sample {data.sample[7]}" in wrong.reasons[0]


def test_a_model_that_does_not_say_what_to_expect_is_not_judged(refined):
    model, data = refined
    assert judged(replace(model, fit={}), data).status == "NOT_EVALUATED"
    assert judged(model, data.select(np.arange(len(data)) < 4)).status == "NOT_EVALUATED"


def test_pixels_of_a_model_without_cameras_are_refused_with_what_to_do(refined):
    model, data = refined
    unobservable = replace(model, cameras={}, covariance=None)
    with pytest.raises(ModelError, match="learn arm and cameras together"):
        by_pixels(unobservable, data)
    assert by_pixels(model, data)
    assert not by_pixels(model, scenario().test, "points")
    with pytest.raises(ValueError, match="no sensor"):
        by_pixels(model, data, "nose")


def test_a_sign_test_counts_its_witnesses():
    errors = np.repeat([0.5, 2.0], [30, 70])
    assert significantly_above(errors, 1.0, 100, 1000)
    assert not significantly_above(errors, 1.0, 30, 1000)
    assert not significantly_above(errors, 1.0, 100, 20)
    assert not significantly_above(errors, 1.9, 100, 1000)  # not by enough to matter


def test_two_points_in_a_pose_are_one_pose(refined):
    model, data = with_thumb(refined[0]), twice(refined[1])
    found = evaluate_pixels(model, data)
    assert len(found.observations) == 2 * found.pose_count == 2 * len(refined[1])
    assert pixel_errors(found).to_json()["poses"] == found.pose_count
    assert f"on {found.pose_count} poses that were held out" in _held_out_words(found)
    half = blinded(data, np.arange(len(data)) < 20, 0)
    assert f"{found.pose_count - 10} of them seen by both" in _held_out_words(
        evaluate_pixels(model, half)
    )


@pytest.mark.parametrize(
    ("free", "words"),
    [
        ({"left.k1", "hand.x"}, "lenses bend to fit the arm"),
        ({"right.fx"}, "focal lengths and image centres shift to fit the arm"),
        ({"right.pose.x", "hand.x"}, "holds the scale; its own"),
    ],
)
def test_lenses_bend_only_where_they_were_free_to(free, words):
    found = replace(
        learned(0),
        options=BodyOptions(variant="unanchored"),
        uncertainty=replace(learned(0).uncertainty, names=tuple(sorted(free))),
    )
    said = next(known.text for known in body_findings(found) if known.severity == "warning")
    assert words in said
    assert ("bend" in said) == ("k1" in str(free))


def test_a_refusal_counts_poses_not_rows():
    few = twice(only_cameras(poses(body(), 3)))
    with pytest.raises(DataError, match="6 observations in 3 poses, at least 8"):
        PixelObservations.from_dataset(few).require_both_cameras(8, few.name)

"""Each threshold of a verdict, from both sides: a test fails where one moves."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.diagnosis.score_test import Score
from nico_selfmodel.estimation.diagnosis.systematic_residuals import Pattern
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.mirrors import mirror_findings
from nico_selfmodel.estimation.mirrors.mirror import calibrate_mirrors
from nico_selfmodel.estimation.noise.pose_noise import PoseNoise
from nico_selfmodel.estimation.results.calibration_result import (
    CAUSE,
    MISFIT,
    NOTE,
    WARNING,
    CalibrationResult,
    Errors,
    Finding,
    Terms,
)
from nico_selfmodel.estimation.results.verdict import (
    FEWEST_BOARDS,
    held_out_is_worse,
    outliers_are_many,
)

from .mirror_scenes import body, poses, recording
from .simulated_bodies import learned

SIGMA = 3e-4


@pytest.mark.parametrize(("share", "many"), [(0.24, False), (0.25, False), (0.26, True)])
def test_a_quarter_of_outliers_is_no_accident(share, many):
    outliers = np.arange(100) < 100 * share
    assert (outliers_are_many(outliers) is not None) is many
    assert outliers_are_many(np.zeros(0, dtype=bool)) is None


def held_out_alone(count, terms):
    """A result of which nothing is known but how much was held out."""
    test = Errors(np.ones(count), poses=count) if count else None
    said = (Finding(NOTE, "good"), Finding(WARNING, "but"))
    return CalibrationResult(
        method="refine",
        parameters={},
        test=test,
        outliers=np.zeros(0, dtype=bool),
        outlier_names=(),
        converged=True,
        iterations=3,
        seconds=0.1,
        findings=said,
        details={},
        terms=terms,
    )


@pytest.mark.parametrize(("held_out", "status"), [(7, "NOT_EVALUATED"), (8, "PASS")])
def test_eight_held_out_poses_show_something(held_out, status):
    verdict = judge(held_out_alone(held_out, Terms()))
    assert verdict.status == status
    assert verdict.warnings == ("but",)
    if status != "PASS":
        assert verdict.reasons[0].startswith("only 7 poses held out")
        assert verdict.reasons[1] == "good"


@pytest.mark.parametrize(("held_out", "status"), [(1, "NOT_EVALUATED"), (2, "PASS")])
def test_two_held_out_boards_show_something(held_out, status):
    verdict = judge(held_out_alone(held_out, Terms("boards", fewest=FEWEST_BOARDS)))
    assert verdict.status == status


def spread_about(median: float, count: int = 41) -> np.ndarray:
    return median * np.linspace(0.9, 1.1, count)


@pytest.mark.parametrize(("ratio", "worse"), [(1.28, False), (1.32, True)])
def test_a_held_out_error_is_worse_from_a_ratio_of_medians_on(ratio, worse):
    assert (held_out_is_worse(spread_about(1.0), spread_about(ratio)) is not None) is worse


@pytest.mark.parametrize(("count", "worse"), [(4, False), (5, True)])
def test_five_errors_can_be_compared(count, worse):
    found = held_out_is_worse(spread_about(1.0, 400), spread_about(3.0, count))
    assert (found is not None) is worse
    assert (
        held_out_is_worse(spread_about(1.0, count), spread_about(3.0, 400)) is None
    ) is not worse


@pytest.mark.parametrize(("above", "worse"), [(11, False), (14, True)])
def test_a_held_out_error_is_worse_from_a_chance_of_one_in_two_thousand_on(above, worse):
    # Of 14 errors so many are larger than all 20 expected ones, the rest smaller: scores of rank
    # tests of 2.4 and 4.9.
    found = np.concatenate([np.full(14 - above, 0.5), np.full(above, 2.0)])
    assert (held_out_is_worse(np.linspace(0.9, 1.1, 20), found) is not None) is worse


def test_held_out_data_without_the_decisive_error_show_nothing():
    body = held_out_alone(9, Terms(decisive="px"))
    verdict = judge(body)
    assert verdict.status == "NOT_EVALUATED"
    assert verdict.reasons[0] == "nothing that was held out has an error in px: hold out more"
    seen = replace(body.test, pixels=np.ones(9))
    assert judge(replace(body, test=seen)).status == "PASS"


@pytest.mark.parametrize(("directions", "shown"), [(3, 3), (5, 4)])
def test_three_unobservable_directions_are_shown(directions, shown):
    names = tuple("abcde"[:directions])
    reasons = judge(replace(held_out_alone(9, Terms()), unobservable=names)).reasons
    assert len(reasons) == shown
    assert reasons[:3] == names[:3]
    assert directions == 3 or reasons[3] == "and 2 more unobservable directions"


@pytest.mark.parametrize(("bound", "status"), [(1000.0, "PASS"), (999.0, "FAIL")])
def test_a_bound_is_met_where_it_is_reached(bound, status):
    assert judge(held_out_alone(9, Terms()), bound).status == status
    assert judge(held_out_alone(9, Terms()), None, bound).status == "FAIL"  # no pixels held out


def test_a_cause_hides_what_follows_from_it_and_a_misfit_what_cannot_be_told():
    unobservable = replace(held_out_alone(9, Terms()), unobservable=("a",), converged=False)
    misfit = (Finding(MISFIT, "no"), *unobservable.findings)
    assert judge(replace(unobservable, findings=misfit)).reasons[0] == "no"
    assert "a" not in judge(replace(unobservable, findings=misfit)).reasons
    cause = replace(unobservable, findings=(Finding(CAUSE, "why"), *misfit))
    assert judge(cause).reasons == ("why", "no")


@pytest.fixture(scope="module")
def arm(make_truth):
    truth = make_truth(4, 2, unit="counts", kind="elbow")
    train = truth.dataset(truth.poses(60, 1), sigma=SIGMA, seed=1, known_sigma=True)
    test = truth.dataset(truth.poses(20, 2), sigma=SIGMA, seed=2)
    return calibrate_kinematics(train, test=test)


def with_noise(arm, *, of_size=None, sensor=None, joint=None):
    """Return a calibration that found other noise."""
    noise = arm.noise
    if of_size is not None:
        sigma = of_size * arm.train.observations.size
        return replace(arm, point_sigma=None, model=replace(arm.model, noise_sigma=sigma))
    sensor = noise.sensor_sigma if sensor is None else sensor
    joints = noise.joint_sigma if joint is None else np.array([0.0, joint, 0.0, 0.0])
    return replace(arm, noise=PoseNoise(sensor, joints))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"of_size": 0.049}, None),
        ({"of_size": 0.051}, "the residuals are"),
        ({"sensor": 9.9 * SIGMA}, None),
        ({"sensor": 10.1 * SIGMA}, "10 times the stated point_sigma_m"),
        ({"joint": np.radians(4.9)}, None),
        ({"joint": np.radians(5.1)}, "would have to be off by 5.1 deg"),
    ],
)
def test_noise_that_explains_nothing_fails(arm, changes, words):
    verdict = judge(with_noise(arm, **changes))
    assert (verdict.status == "FAIL") is (words is not None)
    assert words is None or words in verdict.reasons[0]


@pytest.mark.parametrize(("of_size", "fails"), [(0.019, False), (0.021, True)])
def test_residuals_that_depend_on_the_pose_fail_where_they_are_large(arm, of_size, fails):
    score = Score(50.0, 1, np.ones(1), np.ones(1), 1e-3, 1.1)
    bent = replace(with_noise(arm, of_size=of_size), patterns=(Pattern("x", score, np.zeros(0)),))
    assert (judge(bent).status == "FAIL") is fails
    assert judge(with_noise(arm, of_size=of_size)).status == "PASS"


@pytest.mark.parametrize(
    ("better", "size", "fails"),
    [(1.51, 5.1e-3, True), (1.49, 5.1e-3, False), (1.51, 4.9e-3, False)],
)
def test_an_uneven_joint_fails_where_it_is_most_of_what_is_missed_and_far(arm, better, size, fails):
    score = Score(50.0, 1, np.ones(1), np.ones(1), 1e-3, better)
    pattern = Pattern("x", score, np.zeros(0), uneven="joint_0", size=size)
    verdict = judge(replace(with_noise(arm, of_size=0.01), patterns=(pattern,)))
    assert (verdict.status == "FAIL") is fails
    (said,) = [words for words in (*verdict.reasons, *verdict.warnings) if "depend on x" in words]
    assert said.endswith("check joint_0 there") is fails


@pytest.mark.parametrize(("stated", "said"), [(2.9, False), (3.1, True)])
def test_scatter_above_three_stated_sigmas_is_told_to_be_joint_noise(arm, stated, said):
    model = replace(arm.model, noise_sigma=stated * SIGMA)
    noise = PoseNoise(SIGMA, np.full(4, 1e-3))
    words = judge(replace(arm, model=model, noise=noise)).warnings
    assert any("joint noise of" in warning for warning in words) is said


@pytest.mark.parametrize(("part", "said"), [(9.0, False), (11.0, True)])
def test_scatter_far_below_the_stated_sigma_asks_for_its_unit(arm, part, said):
    model = replace(arm.model, noise_sigma=SIGMA / part)
    words = judge(replace(arm, model=model)).warnings
    assert any("is its unit metres?" in warning for warning in words) is said


@pytest.mark.slow
@pytest.mark.parametrize(("degrees", "fails"), [(4.9, False), (5.1, True)])
def test_a_body_fails_where_its_joints_would_have_to_be_loose(degrees, fails):
    found = learned(0)
    bent = replace(found, noise=replace(found.noise, joint_sigma=np.radians(degrees)))
    assert any("joint noise would have to be" in reason for reason in judge(bent).reasons) is fails


@pytest.mark.parametrize(("share", "fails"), [(0.24, False), (0.27, True)])
def test_a_body_fails_where_more_than_a_quarter_are_outliers(share, fails):
    found = learned(0)
    outliers = np.arange(len(found.outliers)) < share * len(found.outliers)
    words = " ".join(judge(replace(found, outliers=outliers)).reasons)
    assert ("of the observations contradict" in words) is fails


@pytest.mark.parametrize(("more", "fails"), [(0, False), (1, True)])
def test_a_body_fails_where_lenses_lose_the_hand_in_more_than_one_of_fifty_poses(more, fails):
    found = learned(0)
    seen = found.train.p_LH_seen.copy()
    both = np.flatnonzero(found.train.observations.by_both & ~found.outliers)
    seen[both[: int(0.02 * found.train.pose_count) + more]] = np.nan
    bent = replace(found, train=replace(found.train, p_LH_seen=seen))
    words = " ".join(judge(bent).reasons)
    assert ("no point in front of the refined cameras" in words) is fails


@pytest.fixture(scope="module")
def mirror():
    data, test = recording(poses(20, 1)), recording(poses(10, 2), seed=5, first=101)
    return calibrate_mirrors(data, body(), test=test)


@pytest.mark.parametrize(("share", "fails"), [(0.25, False), (0.3, True)])
def test_a_mirror_fails_where_more_than_a_quarter_are_outliers(mirror, share, fails):
    outliers = np.arange(20) < share * 20
    bent = replace(mirror, solution=replace(mirror.solution, outliers=outliers))
    words = " ".join(judge(bent).reasons)
    assert ("of the reflections contradict" in words) is fails


@pytest.mark.parametrize(("ratio", "fails"), [(4.9, False), (5.1, True)])
def test_a_mirror_fails_where_reflections_miss_by_more_than_explained(mirror, ratio, fails):
    uncertainty = replace(mirror.solution.uncertainty, variance_factor=ratio**2)
    bent = replace(mirror, solution=replace(mirror.solution, uncertainty=uncertainty))
    assert any("miss their plane" in reason for reason in judge(bent).reasons) is fails


@pytest.mark.parametrize(("degrees", "fails"), [(4.9, True), (5.1, False)])
def test_a_mirror_fails_where_it_is_seen_edge_on(mirror, monkeypatch, degrees, fails):
    angles = np.full(20, np.radians(degrees))
    monkeypatch.setattr(mirror_findings, "grazing_angles", lambda calibration: angles)
    assert any("seen edge-on" in reason for reason in judge(mirror).reasons) is fails


@pytest.mark.parametrize(("spread", "warns"), [(0.0098, True), (0.0102, False)])
def test_poses_within_a_centimetre_are_one_point_to_a_mirror(mirror, spread, warns):
    rows = mirror.solution.reflections
    about = rows.p_WQ - rows.p_WQ.mean(axis=0)
    factor = spread / np.sqrt(np.sum(np.var(about, axis=0)))
    near = replace(rows, p_WQ=rows.p_WQ.mean(axis=0) + factor * about)
    bent = replace(mirror, solution=replace(mirror.solution, reflections=near))
    assert any("of one point" in warning for warning in judge(bent).warnings) is warns


@pytest.mark.parametrize(("count", "fails"), [(5, False), (6, True)])
def test_held_out_outliers_fail_where_chance_does_not_make_so_many(arm, count, fails):
    covariance = arm.test.covariance.copy()
    covariance[:count] *= 1e-4
    bent = replace(arm, test=replace(arm.test, covariance=covariance))
    assert bent.test.outliers.sum() == count
    words = " ".join(judge(bent).reasons)
    assert ("held-out points are further off" in words) is fails


@pytest.mark.parametrize(("before", "fails"), [(3, True), (4, False)])
def test_many_held_out_outliers_fail_where_the_training_has_fewer(arm, before, fails):
    """Six of 20 poses are many: the chance of so many beside 3 and 4 of 60 is 0.006 and 0.013."""
    covariance = arm.test.covariance.copy()
    covariance[:6] *= 1e-4
    bent = replace(arm, test=replace(arm.test, covariance=covariance))
    outliers = np.arange(len(arm.outliers)) < before
    bent = replace(bent, outliers=outliers, cross_validation=np.zeros(0))
    words = " ".join(judge(bent).reasons)
    assert ("held-out points are further off" in words) is fails


def test_three_patterns_are_named(arm):
    score = Score(50.0, 1, np.ones(1), np.ones(1), 1e-3, 1.1)
    patterns = tuple(Pattern(f"cause {i}", score, np.zeros(0)) for i in range(5))
    words = " ".join(judge(replace(arm, patterns=patterns)).warnings)
    assert [f"cause {i}" in words for i in range(5)] == [True, True, True, False, False]

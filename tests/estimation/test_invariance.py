"""How an arm, cameras or a mirror are written down changes no verdict and no error."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.body.body import calibrate_body
from nico_selfmodel.estimation.body.body_options import BodyOptions
from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.mirrors.mirror import calibrate_mirrors
from nico_selfmodel.geometry.rotation import rotation_from_vector

from .mirror_scenes import body, poses, recording
from .random_arms import random_recording
from .simulated_boards import boards, pictures
from .simulated_bodies import scenario

COUNTS = 2.0**24
"""A turn of an encoder so fine that its rounding is no part of the question."""


def in_counts(data: Dataset, gear: np.ndarray | float) -> Dataset:
    """Write angles down as counts of encoders before a gear."""
    joints = tuple(JointInfo(joint.name, "counts", COUNTS) for joint in data.joints)
    return replace(data, joints=joints, encoders=data.encoders * gear * COUNTS / (2.0 * np.pi))


def in_degrees(data: Dataset) -> Dataset:
    joints = tuple(JointInfo(joint.name, "deg") for joint in data.joints)
    return replace(data, joints=joints, encoders=np.degrees(data.encoders))


def other_names(count: int) -> tuple[str, ...]:
    """Return names in an order of letters that is not that of the joints."""
    return tuple(f"a{count - i}" for i in range(count))


def renamed(data: Dataset) -> Dataset:
    """Give joints other names."""
    names = other_names(len(data.joints))
    joints = tuple(replace(j, name=name) for j, name in zip(data.joints, names, strict=True))
    names = dict(zip(data.joint_names, (joint.name for joint in joints), strict=True))
    sweep = [names.get(name, name) for name in data.sweep.tolist()]
    return replace(data, joints=joints, sweep=np.array(sweep))


def finer(data: Dataset) -> Dataset:
    """Read the same angles by encoders of three times the counts."""
    joints = tuple(replace(j, counts_per_turn=3.0 * (j.counts_per_turn or 0)) for j in data.joints)
    return replace(data, joints=joints, encoders=3.0 * data.encoders)


def turned(data: Dataset, by: list[float], shift: list[float]) -> Dataset:
    """Measure from another place."""
    points = data.p_WH_measured @ rotation_from_vector(by).T + np.array(shift)
    return replace(data, p_WH_measured=points)


def scaled(data: Dataset, factor: float) -> Dataset:
    return replace(data, p_WH_measured=factor * data.p_WH_measured)


def found(data: Dataset) -> tuple[str, list[str], float]:
    """Return the verdict, the first words of what it warns of, and the mean held-out error."""
    train, test = data.split(0.3, 1)
    calibration = calibrate_kinematics(train, test=test)
    verdict = judge(calibration)
    assert calibration.test is not None
    doubts = [" ".join(words.split()[:4]) for words in (*verdict.reasons[1:], *verdict.warnings)]
    return verdict.status, doubts, calibration.test.statistics.mean


def arms():
    """Sound arms, a bent one, and one whose encoder jumped, all in radians."""
    chosen = []
    for kind in ("clean", "joint noise", "eccentricity", "encoder jump"):
        seeds = (seed for seed in range(8000, 8100))
        drawn = (random_recording(kind, seed, fresh=1) for seed in seeds)
        chosen.append(next(r.dataset for r in drawn if r.arm.unit == "rad" and len(r.arm.gear) < 6))
    return chosen


@pytest.fixture(scope="module", params=range(4), ids=["clean", "noisy", "eccentric", "jumped"])
def written(request) -> tuple[Dataset, tuple]:
    data = arms()[request.param]
    gear = np.ones(len(data.joints))
    return data, found(in_counts(data, gear))


@pytest.mark.slow
@pytest.mark.parametrize("gear", [0.5, 5.0, 50.0, 200.0, None])
def test_a_gear_changes_no_verdict(written, gear):
    data, before = written
    drawn = np.exp(np.random.default_rng(1).uniform(0.0, np.log(200.0), len(data.joints)))
    status, doubts, error = found(in_counts(data, drawn if gear is None else gear))
    assert (status, doubts) == before[:2]
    assert error == pytest.approx(before[2], rel=1e-3)


@pytest.mark.slow
def test_degrees_and_radians_are_the_same(written):
    data, _ = written
    a, b = found(data), found(in_degrees(data))
    assert a[:2] == b[:2]
    assert a[2] == pytest.approx(b[2], rel=1e-5)


@pytest.mark.slow
def test_order_names_and_place_change_no_verdict(written):
    data, _ = written
    status, doubts, error = found(data)
    order = np.random.default_rng(2).permutation(len(data))
    for other, factor in (
        (renamed(data), 1.0),
        (data.select(order), 1.0),
        (turned(data, [0.3, -1.0, 0.7], [0.4, 2.0, -1.0]), 1.0),
        (scaled(data, 20.0), 20.0),
        (scaled(data, 0.05), 0.05),
    ):
        again = found(other)
        assert again[0] == status
        # Names, and lengths in words, differ; their number does not.
        assert len(again[1]) == len(doubts)
        assert again[2] == pytest.approx(factor * error, rel=2e-2)


def boards_found(views: BoardViews) -> tuple[str, float]:
    train, test = views.select(np.arange(14)), views.select(np.arange(14, 18))
    assessment = CameraAssessment.from_calibration(calibrate_cameras(train), CameraOptions(), test)
    assert assessment.test_distances is not None
    return judge(assessment).status, float(np.mean(assessment.test_distances))


@pytest.mark.slow
def test_order_and_size_of_boards_change_no_verdict_on_cameras():
    views = pictures(boards(18), sigma=0.2)
    status, error = boards_found(views)
    assert status == "PASS"
    order = np.r_[np.random.default_rng(1).permutation(14), 14:18]
    for other in (views.select(order), replace(views, p_GQ=30.0 * views.p_GQ)):
        again = boards_found(other)
        assert again[0] == status
        assert again[1] == pytest.approx(error, rel=1e-3)


@pytest.mark.slow
@settings(max_examples=6)
@given(seed=st.integers(0, 1000))
def test_order_names_and_units_change_no_verdict_on_a_mirror(seed):
    data, test = recording(poses(14, 1)), recording(poses(10, 2), seed=5, first=101)
    before = calibrate_mirrors(data, body(), test=test)
    names, model = other_names(4), body()
    servos = replace(model.servos, joints=names, unit=("deg",) * 4)
    model = replace(model, table=replace(model.table, joints=names), servo_map=servos)
    order = np.random.default_rng(seed).permutation(len(data))
    other, other_test = (in_degrees(renamed(part)) for part in (data.select(order), test))
    after = calibrate_mirrors(other, model, test=other_test)
    assert judge(after).status == judge(before).status == "PASS"
    assert after.test is not None
    assert before.test is not None
    means = [found.test.pixel_statistics.mean for found in (before, after)]
    assert means[0] == pytest.approx(means[1], rel=1e-6)
    assert after.mirrors["glass"].angle_to(before.mirrors["glass"]) < 1e-6


@pytest.mark.slow
def test_order_names_and_counts_change_no_verdict_on_a_body():
    recorded, results = scenario(), []
    order = np.random.default_rng(3).permutation(len(recorded.train))
    for train, test in (
        (recorded.train, recorded.test),
        (finer(renamed(recorded.train.select(order))), finer(renamed(recorded.test))),
    ):
        found = calibrate_body(train, recorded.cameras, recorded.boards, BodyOptions(), test=test)
        results.append((judge(found).status, found.test.pixel_statistics.mean))
    assert results[0][0] == results[1][0] == "PASS"
    assert results[0][1] == pytest.approx(results[1][1], rel=1e-3)

"""Each threshold of what is said of a body of any tree, from both sides."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.errors import DataError, NotConvergedError
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.tree.contradictions import off_at_once
from nico_selfmodel.estimation.tree.contradictions.ran_away import check_that_it_stayed
from nico_selfmodel.estimation.tree.contradictions.standing_still import (
    check_that_it_moved,
    still_readings,
)
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters

from .simulated_trees import one_arm

SIGMA = 3e-4


@pytest.fixture(scope="module")
def slider():
    """An arm of which the second joint shifts, its tracker's sigma stated."""
    shifts = np.array([False, True, False, False])
    sim = one_arm(5, joints=4, markers=3, poses=50, sigma={"points": SIGMA}, shifts=shifts)
    data = sim.data
    sensors = tuple(replace(sensor, sigma=SIGMA) for sensor in data.sensors)
    data = replace(data, sensors=sensors)
    return calibrate_tree(data, effects=())


def said(calibration, **solution):
    """All that is said of a calibration whose solution is another one."""
    bent = replace(calibration, solution=replace(calibration.solution, **solution))
    verdict = judge(bent)
    return " ".join([*verdict.reasons, *verdict.warnings])


def with_noise(calibration, **noise):
    return said(calibration, noise=replace(calibration.solution.noise, **noise))


@pytest.mark.parametrize(("times", "fails"), [(4.9, False), (5.1, True)])
def test_a_sensor_that_measures_five_times_worse_than_stated_fails(slider, times, fails):
    words = with_noise(slider, sensor=np.array([times * SIGMA]))
    assert ("is off by" in words) is fails


@pytest.mark.parametrize(("times", "asked"), [(9.8, False), (10.2, True)])
def test_a_sensor_that_measures_ten_times_better_than_stated_is_doubted(slider, times, asked):
    words = with_noise(slider, sensor=np.array([SIGMA / times]))
    assert ("is the unit of its sigma right?" in words) is asked


@pytest.mark.parametrize(("times", "named"), [(1.95, False), (2.05, True)])
def test_a_joint_twice_as_loud_as_others_is_named(slider, times, named):
    joint = np.full(4, 1e-3)
    joint[2] *= times
    words = with_noise(slider, joint=joint, loud=frozenset({2}))
    assert ("times as badly as others" in words) is named


@pytest.mark.parametrize(("share", "fails"), [(0.098, False), (0.102, True)])
def test_noise_of_a_tenth_of_what_a_joint_slid_is_none(slider, share, fails):
    joint = slider.solution.noise.joint.copy()
    joint[1] = share * np.ptp(slider.data.si_readings[:, 1])
    assert ("noise of joint 'j2' would have to be" in with_noise(slider, joint=joint)) is fails


@pytest.mark.parametrize(("count", "named"), [(1, False), (2, True)])
def test_two_outliers_of_a_marker_name_it(slider, count, named):
    table = slider.data.observations
    outliers = np.zeros(len(table), dtype=bool)
    outliers[np.flatnonzero(table.marker == 1)[:count]] = True
    assert ("hand_tag1 (" in said(slider, outliers=outliers)) is named


@pytest.mark.parametrize(
    ("ratio", "poses", "named"),
    [(3.9, 50, False), (4.1, 50, True), (9.0, 19, False), (9.0, 20, True)],
)
def test_a_sensor_off_at_once_is_named_by_four_in_twenty_poses(
    slider, monkeypatch, ratio, poses, named
):
    monkeypatch.setattr(off_at_once, "at_once", lambda left, pose: (1.0, ratio, 3.0, poses))
    assert bool(off_at_once.sensors_off_at_once(slider)) is named


@pytest.mark.parametrize(
    ("joint", "travel", "still"),
    [(0, 0.9e-3, True), (0, 1.1e-3, False), (1, 0.9e-5, True), (1, 1.1e-5, False)],
)
def test_a_joint_that_hardly_moved_stands_still(slider, joint, travel, still):
    data = slider.data
    readings = data.readings.copy()
    per_unit = data.joints[joint].si_per_unit
    readings[:, joint] = np.linspace(0.0, travel, len(readings)) / per_unit
    found = still_readings(replace(data, readings=readings))
    assert (data.joints[joint].name in found) is still


def first_poses(data: BodyDataset, count: int) -> BodyDataset:
    """A few poses, in which the tracker told one value of the first marker."""
    data = data.select(np.arange(len(data.sample)) < count)
    table = data.observations
    values = table.values.copy()
    values[table.marker == 0] = values[table.marker == 0][0]
    return replace(data, observations=replace(table, values=values))


def test_a_value_that_is_the_same_in_three_poses_is_no_accident(slider):
    check_that_it_moved(first_poses(slider.data, 2), np.ones(4, dtype=bool), described=True)
    with pytest.raises(DataError, match="the same to the last digit in all 3 poses"):
        check_that_it_moved(first_poses(slider.data, 3), np.ones(4, dtype=bool), described=True)


@pytest.mark.parametrize("largest", [0.0, 0.5])
@pytest.mark.parametrize(("times", "stays"), [(99.0, True), (101.0, False)])
def test_no_body_is_a_hundred_of_its_lengths_away(slider, largest, times, stays):
    parameters = TreeParameters(slider.tree)
    metres = np.array(parameters.layout.units) == "m"
    start = np.where(metres, 0.0, 0.1)
    start[np.flatnonzero(metres)[0]] = largest
    values = start.copy()
    values[np.flatnonzero(metres)[1]] = times * (largest or 0.1)  # of nothing known, a decimetre
    if stays:
        check_that_it_stayed(parameters, start, values)
    else:
        with pytest.raises(NotConvergedError, match="the adjustment ran away"):
            check_that_it_stayed(parameters, start, values)

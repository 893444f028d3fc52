"""A sensor that lags behind the readings is off alike in all that it sees of a pose."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.sensors import SensorInfo
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.tree.timing.off_at_once import LEAST_RATIO, at_once
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.model.tree.body_tree import Attached

from .simulated_trees import looking_at, observed, two_arms


@pytest.mark.slow
@pytest.mark.parametrize(("lag", "named"), [(0.0, False), (0.05, True)])
def test_a_tracker_that_lags_behind_cameras_and_encoders_is_named(lag, named):
    made = two_arms(3, poses=40)
    rng, q, data = np.random.default_rng(3), made.readings_true, made.data
    at = Attached("laser", -1, looking_at(np.array([1.0, 1.0, 1.0]), [0.0, 0.0, 0.3]))
    tree = replace(made.tree, sensors=(*made.tree.sensors, at))
    infos = data.joints, data.markers, (*data.sensors, SensorInfo("laser", "points"))
    how = {"joint_sigma": np.radians(0.02), "sigma": {"camera": 0.3, "points": 1e-4}}
    late = q + lag * np.radians(10.0) * rng.normal(size=q.shape)  # 10 deg a second
    now, then = (observed(tree, *infos, at, rng, **how) for at in (q, late))
    values, by_laser = now.observations.values.copy(), now.observations.sensor == 2
    values[by_laser] = then.observations.values[then.observations.sensor == 2]
    table = replace(now.observations, values=values)
    some = ~by_laser | (table.marker < 3)
    found = calibrate_tree(replace(now, observations=table.select(some)), effects=())
    words = [word for word in judge(found).warnings if "is off alike" in word]
    assert [f"{'laser'!r}" in word for word in words] == [True] * named


def test_what_markers_have_of_their_own_and_alike_is_told_apart():
    rng, pose = np.random.default_rng(0), np.repeat(np.arange(400), 3)
    alone, alike = 2.0 * rng.normal(size=(1200, 2)), 3.0 * rng.normal(size=(400, 2))
    own, ratio, markers, poses = at_once(alone + alike[pose], pose)
    assert (markers, poses) == (3.0, 400)
    assert own == pytest.approx(2.0, rel=0.05)
    assert ratio == pytest.approx(1.0 + 3.0 * 9.0 / 4.0, rel=0.15)
    assert at_once(alone, pose)[1] == pytest.approx(1.0, abs=0.15)
    assert at_once(alone[:3], np.arange(3)) == (0.0, 1.0, 0.0, 0)


def test_chance_alone_never_names_a_sensor():
    rng, pose = np.random.default_rng(1), np.repeat(np.arange(20), 2)
    ratios = [at_once(rng.normal(size=(40, 2)), pose)[1] for _ in range(2000)]
    assert 2.0 < max(ratios) < LEAST_RATIO

"""One of several sensors that contradicts all the others is named."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.sensors import SensorInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.contradictions import against_the_rest
from nico_selfmodel.estimation.tree.contradictions.against_the_rest import (
    largest_error,
    refuse_odd_sensor,
)
from nico_selfmodel.estimation.tree.guesses.start_search import searched_start
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.estimation.tree.tree_setup import Wishes, blank_body
from nico_selfmodel.model.tree.body_tree import WORLD, Attached

from .simulated_trees import observed, one_arm


def before_cameras_and_a_tracker(seed, poses=40):
    """An arm that two cameras and a tracker see, and how it is made of its tree."""
    sim = one_arm(seed, joints=4, markers=4, poses=poses, sensor="cameras")
    tracker = Attached("tracker", WORLD, np.eye(4))
    tree = replace(sim.tree, sensors=(*sim.tree.sensors, tracker))
    sensors = [*sim.data.sensors, SensorInfo("tracker", "points")]
    how = {"sigma": {"points": 2e-4, "camera": 0.3}, "joint_sigma": np.radians(0.05)}
    rng = np.random.default_rng((seed, 1))
    return observed(tree, sim.data.joints, sim.data.markers, sensors, sim.readings_true, rng, **how)


def changed(data, sensor, change):
    """The same recording with what one sensor saw changed."""
    own = data.observations.sensor == [s.name for s in data.sensors].index(sensor)
    values = data.observations.values.copy()
    values[own] = change(values[own])
    return replace(data, observations=replace(data.observations, values=values))


def upside_down(values):
    return values * [1, -1, 1, 1, 1, 1] + [0, 479, 0, 0, 0, 0]


def upside_down_and_aside(values):
    """As from a picture that was turned half round: no body fits it, left-handed or not."""
    return values * [1, -0.8, 1, 1, 1, 1] + [0, 479, 0, 0, 0, 0]


def left_handed(values):
    return values * [1, -1, 1, 1, 1, 1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sensor", "change", "said"),
    [
        ("left", upside_down, "(contradicts all the rest|the rest fits)"),
        ("right", upside_down, "(contradicts all the rest|the rest fits)"),
        ("tracker", left_handed, "measured fits the rest if one of its axes is negated"),
    ],
)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_sensor_whose_axes_are_wrong_is_named(seed, sensor, change, said):
    data = before_cameras_and_a_tracker(seed)
    with pytest.raises(DataError, match=rf"{sensor}.* {said}"):
        calibrate_tree(changed(data, sensor, change), effects=())


@pytest.mark.slow
def test_a_left_handed_tracker_beside_one_camera_is_told_from_a_wrong_camera():
    """By leaving one out nothing can be told: a camera alone learns no arm."""
    data = before_cameras_and_a_tracker(3)
    data = data.of_rows(data.observations.sensor != 1)
    with pytest.raises(DataError, match=r"sensor 'tracker' .* if one of its axes is negated"):
        calibrate_tree(changed(data, "tracker", left_handed), effects=())
    with pytest.raises(DataError, match=r"sensor 'left' of data set .* contradicts all the rest"):
        calibrate_tree(changed(data, "left", upside_down_and_aside), effects=())


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_no_sensor_of_a_sound_recording_is_odd(seed):
    data = before_cameras_and_a_tracker(seed)
    blank = blank_body(data, {})
    found = searched_start(data, blank, None, Wishes(), 0)
    assert largest_error(found, data) < 0.01


@pytest.mark.parametrize(
    ("worst", "left", "named"),
    [
        (0.049, {"left": 0.001}, None),
        (0.051, {"left": 0.001}, "what sensor 'left' of"),
        (0.1, {"left": 0.029}, "what sensor 'left' of"),
        (0.1, {"left": 0.031}, None),
        (0.9, {"left": 0.049}, "what sensor 'left' of"),
        (0.9, {"left": 0.051}, None),
        (0.9, {"left": 0.01, "tracker": 0.032}, "without 'left' or 'tracker' the rest"),
        (0.9, {"left": 0.01, "tracker": 0.035}, "what sensor 'left' of"),
    ],
)
def test_a_sensor_is_odd_where_all_others_fit_far_better_without(monkeypatch, worst, left, named):
    data = before_cameras_and_a_tracker(1, poses=6)
    names = np.array([sensor.name for sensor in data.sensors])

    def error(found, data):
        gone = np.setdiff1d(np.arange(len(names)), data.observations.sensor)
        return left.get(names[gone[0]], worst) if len(gone) else worst

    monkeypatch.setattr(against_the_rest, "largest_error", error)
    monkeypatch.setattr(against_the_rest, "explained_by_lag", lambda *_: False)
    parameters = TreeParameters(blank_body(data, {}))
    found = SimpleNamespace(start=SimpleNamespace(parameters=parameters))
    if named is None:
        refuse_odd_sensor(found, data, lambda *_: None, 0)
        return
    with pytest.raises(DataError, match=named):
        refuse_odd_sensor(found, data, lambda *_: None, 0)
    monkeypatch.setattr(against_the_rest, "explained_by_lag", lambda *_: True)
    refuse_odd_sensor(found, data, lambda *_: None, 0)


def test_a_sensor_that_alone_sees_a_joint_is_not_odd(monkeypatch):
    data = before_cameras_and_a_tracker(1, poses=6)
    tip = data.markers[0].on
    seen = (data.observations.sensor == 0) | (data.observations.marker == 0)
    others = data.of_rows(seen)
    joints = [j for j in data.joint_names if j != tip]
    markers = [m if k else replace(m, on=joints[-1]) for k, m in enumerate(data.markers)]
    others = replace(others, markers=tuple(markers))
    monkeypatch.setattr(
        against_the_rest,
        "largest_error",
        lambda found, data: 0.9 if 0 in data.observations.sensor else 0.001,
    )
    monkeypatch.setattr(against_the_rest, "explained_by_lag", lambda *_: False)
    parameters = TreeParameters(blank_body(others, {}))
    found = SimpleNamespace(start=SimpleNamespace(parameters=parameters))
    refuse_odd_sensor(found, others, lambda *_: None, 0)

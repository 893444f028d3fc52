"""A whole Nico learns its head by looking about a room, and its hands where the head looks."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_folder import load_body_dataset, save_body_dataset
from nico_selfmodel.dataset.body.sensors import MarkerInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.tree.guesses.camera_guess import resected
from nico_selfmodel.estimation.tree.guesses.carried_cameras import body_from_carried_cameras
from nico_selfmodel.estimation.tree.guesses.point_guess import SeenPoints
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_observations import SensorRows, TreeObservations
from nico_selfmodel.estimation.tree.tree_setup import (
    KNOWN_PLACES,
    Description,
    TreeSetup,
    blank_body,
)
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.sessions.whole_body import whole_body_session, whole_nico
from nico_selfmodel.systems.looking import HEAD_JOINTS
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

from .whole_body_truth import axis_deviations, hand_errors, true_motion


def of_the_room(data):
    """The observations of the room alone, what tells the head; arms that nobody saw stand still."""
    known = np.array([marker.xyz is not None for marker in data.markers])
    table, readings = data.observations, data.readings.copy()
    readings[:, len(HEAD_JOINTS) :] = 0.0
    return replace(data, observations=table.select(known[table.marker]), readings=readings)


@pytest.fixture(scope="module")
def looked_about():
    return of_the_room(whole_body_session(IMPERFECTIONS["clean"], 0, 0, looks=40, hands=0))


@pytest.mark.slow
def test_a_head_is_found_from_nothing_but_a_room_that_it_looks_about_in(looked_about):
    data = looked_about
    guess = body_from_carried_cameras(data, blank_body(data, {}), TreeObservations.of(data), 0)
    nico, true = whole_nico(IMPERFECTIONS["clean"], 0)
    learned = TreeMotion.at(guess, data.si_readings)
    there = true_motion(nico, data.readings)
    for mine, its in zip(guess.sensors, true.sensors, strict=True):
        apart = learned.pose_of(mine)[1] - there.pose_of(its)[1]
        assert np.median(np.linalg.norm(apart, axis=0)) < 0.02
    assert guess.gear[:6] == pytest.approx(nico.mechanics.servos.gear[:6], abs=0.05)


@pytest.mark.slow
def test_known_places_stand_for_the_world_and_tell_lengths(looked_about):
    found = calibrate_tree(looked_about, effects=())
    assert isinstance(found.setup, TreeSetup)
    assert found.setup.world == found.setup.scale_from == KNOWN_PLACES
    assert not any(name.startswith("card") for name in found.setup.free)
    assert found.agreeing >= 2
    nico, _ = whole_nico(IMPERFECTIONS["clean"], 0)
    assert np.abs(axis_deviations(found, nico)).max() < 4.0


def test_places_of_markers_are_kept_in_the_recordings_file(looked_about, tmp_path):
    save_body_dataset(looked_about, tmp_path / "room")
    again = load_body_dataset(tmp_path / "room")
    assert [m.xyz for m in again.markers] == [m.xyz for m in looked_about.markers]
    assert [(j.lower, j.upper) for j in again.joints] == [
        (j.lower, j.upper) for j in looked_about.joints
    ]


@pytest.mark.parametrize("place", [[1, 2], "here", [0.0, 1.0, float("nan")]])
def test_a_place_that_is_none_is_refused(place):
    with pytest.raises(DataError, match="'xyz' must be three numbers"):
        MarkerInfo.from_mapping({"name": "a", "on": "world", "xyz": place}, "here")


def test_a_camera_that_sees_too_little_of_the_room_says_so(looked_about):
    table = looked_about.observations
    few = looked_about.observations.marker < 6 + 5
    dark = replace(looked_about, observations=table.select(few))
    with pytest.raises(DataError, match="left_wide_camera' saw 6 of the markers at known places"):
        calibrate_tree(dark)


def test_a_known_room_and_a_description_are_two_worlds(looked_about):
    described = Description(blank_body(looked_about, {}))
    with pytest.raises(DataError, match="leave out --robot"):
        calibrate_tree(looked_about, description=described)


def test_arms_that_the_head_saw_nothing_of_are_named():
    data = whole_body_session(IMPERFECTIONS["clean"], 0, 0, looks=12, hands=0)
    known = np.array([marker.xyz is not None for marker in data.markers])
    table = data.observations
    hidden = replace(data, observations=table.select(known[table.marker]))
    with pytest.raises(DataError, match=r"saw nothing that right_shoulder_pitch, .* move: let"):
        calibrate_tree(hidden)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_head_and_hands_of_the_thesis_world_are_learned_as_well_as_their_mechanics_allow(seed):
    world = IMPERFECTIONS["thesis"]
    train = whole_body_session(world, seed, 0, looks=60, hands=80)
    test = whole_body_session(world, seed, 1, looks=20, hands=60)
    found = calibrate_tree(train, test=test, effects=())
    nico, _ = whole_nico(world, seed)
    assert judge(found).status == "PASS"
    deviations = axis_deviations(found, nico)
    assert deviations.shape == (len(HEAD_JOINTS), 4)
    assert np.mean(np.abs(deviations) < 3.0) >= 0.95
    for side in ("right", "left"):
        learned, left = hand_errors(found, nico, test, side)
        assert learned < 1.15 * left


def test_a_pixel_without_a_ray_does_not_end_a_resection():
    lens = Camera(381.0, 381.0, 319.5, 239.5, (640, 480), k1=-0.45)
    rng = np.random.default_rng(0)
    p = rng.uniform([-0.3, -0.2, 0.5], [0.3, 0.2, 1.0], (12, 3))
    pixels = lens.project(p)
    pixels[0] = 0.0
    assert np.isnan(lens.directions(pixels[:1])).any()
    numbered = np.arange(12)
    rows = SensorRows(
        0, "left", "camera", numbered, numbered, 0 * numbered, 0 * numbered - 1, pixels, 0
    )
    points = SeenPoints(numbered, 0 * numbered, p)
    assert resected(rows, lens, points, "left", rng) == pytest.approx(np.eye(4), abs=1e-6)

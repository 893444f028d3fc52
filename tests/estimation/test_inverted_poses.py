"""Poses of a flange, or of what a sensor saw, that are told the other way round or otherwise."""

import re
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.sensors import SensorInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.diagnosis.turns_written import meant_turns
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.tree.guesses.flange_guess import CARRIED_NEARER, either_way
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.geometry.rotation import (
    rotation_from_quaternion,
    rotation_from_rpy,
    rotation_from_vector,
    rotation_vectors_of,
    rpy_of,
)
from nico_selfmodel.geometry.transform import inverse, transform

from ..slow_rest import slow_rest
from .simulated_trees import assembled, observed, serial, tags
from .test_hand_eye_by_corners import recorded
from .test_one_problem import flange_dataset, hand_eye_poses

OF_FLANGE = r"invert poses of the flange, which seem to tell the base in it \('target' is then"
OF_SENSOR = (
    "invert the poses that 'camera' tells of 'target', or exchange 'on' of both, if 'camera' is on "
    "the flange and 'target' stands"
)


def poses(seed, near=0.1, far=0.7):
    """Poses of a flange that carries a target so far off, of a sensor so far from its base."""
    X, Z, F, M = hand_eye_poses(np.random.default_rng(seed), 20)
    noise = inverse(X) @ inverse(F) @ Z @ M
    X[:3, 3] *= near / np.linalg.norm(X[:3, 3])
    Z[:3, 3] *= far / np.linalg.norm(Z[:3, 3])
    return F, inverse(Z) @ F @ X @ noise


@pytest.mark.parametrize("seed", range(4))
def test_which_side_of_a_hand_eye_calibration_is_inverted_is_told(seed):
    F, M = poses(seed)
    for told, words in (((inverse(F), M), OF_FLANGE), ((F, inverse(M)), OF_SENSOR)):
        with pytest.raises(DataError, match=f"the other way round: {words}"):
            calibrate_tree(flange_dataset(*told))


def test_both_sides_inverted_fit_and_are_doubted_where_the_hand_would_carry_what_stands():
    F, M = poses(1)
    said = [
        judge(calibrate_tree(flange_dataset(*told))).warnings
        for told in ((F, M), (inverse(F), inverse(M)))
    ]
    doubts = [[words for words in one if "inverted" in words] for one in said]
    assert doubts[0] == []
    words = "'target' would be 700 mm from 'tcp' that carries it, 'camera' 100 mm from its base"
    assert doubts[1][0].startswith(words)


@pytest.mark.parametrize(
    ("ratio", "flange", "sensor"), [(0.95, True, True), (1.05, True, False), (1 / 4.2, False, True)]
)
def test_both_sides_are_named_where_nothing_tells_which_is_carried(ratio, flange, sensor):
    F, M = poses(2, near=0.1, far=0.1 * CARRIED_NEARER * ratio)
    with pytest.raises(DataError) as caught:
        calibrate_tree(flange_dataset(inverse(F), M))
    assert ("invert poses of the flange" in str(caught.value)) == flange
    assert ("invert the poses that 'camera' tells" in str(caught.value)) == sensor


@pytest.mark.parametrize("seed", [2, 4, 6])
def test_three_poses_tell_neither_which_way_they_go_nor_which_of_them_is_wrong(seed):
    """Any two of them fit a body, and all three inverted: each had been blamed for it."""
    F, M = poses(seed)
    rng = np.random.default_rng(seed)
    turns, shifts = 0.02 * rng.normal(size=(20, 3)), 5e-3 * rng.normal(size=(20, 3))
    F = F @ transform(rotation_from_vector(turns), shifts)
    for first in range(0, 18, 3):
        three = slice(first, first + 3)
        found = calibrate_tree(flange_dataset(F[three], M[three]), effects=())
        assert not found.solution.outliers.any()


@pytest.mark.parametrize(("noise", "refused"), [(0.05, True), (0.5, False)])
def test_poses_that_fit_neither_way_are_not_called_inverted(noise, refused):
    F, M = poses(3)
    rng = np.random.default_rng(3)
    F = F @ transform(rotation_from_vector(noise * rng.normal(size=(20, 3))), np.zeros(3))
    words = ("tcp", "camera", "target")
    if refused:
        with pytest.raises(DataError, match="the other way round"):
            either_way(inverse(F), M, words, carried=False)
    else:
        either_way(inverse(F), M, words, carried=False)


def test_a_flange_that_is_inverted_before_corners_is_told():
    _, data = recorded(np.random.default_rng(0))
    F = inverse(data.X_flange[:, 0])
    told = np.hstack([F[:, :3, 3], rotation_vectors_of(F[:, :3, :3])])[:, None]
    with pytest.raises(DataError, match=r"invert poses of the flange, .*'camera' is then"):
        calibrate_tree(replace(data, flanges=told))


def misread(vectors, how):
    """Turns as they are read where they were written otherwise, as rotation vectors."""
    R = rotation_from_vector(vectors)
    if how == "quaternions w, x, y, z were taken for x, y, z, w":
        half = 0.5 * np.linalg.norm(vectors, axis=1, keepdims=True)
        q = np.hstack([np.cos(half), np.sin(half) * vectors / (2.0 * half)])
        return rotation_vectors_of(rotation_from_quaternion(q))
    if how == "inverse turns were taken beside places as they are":
        return -vectors
    rpy = np.array([rpy_of(one) for one in R])
    if how == f"{RPY} were taken for rotation vectors":
        return rpy
    return rotation_vectors_of(np.array([rotation_from_rpy(*one) for one in rpy[:, ::-1]]))


RPY = "angles about fixed x, y, z (roll, pitch, yaw)"
MISREAD = [
    "quaternions w, x, y, z were taken for x, y, z, w",
    "inverse turns were taken beside places as they are",
    f"{RPY} were taken for rotation vectors",
    f"{RPY} were taken for angles about moving z, y, x (A, B, C)",
]


@pytest.mark.parametrize("how", MISREAD)
def test_how_turns_were_written_is_told_from_what_they_were_taken_for(how):
    meant = np.random.default_rng(0).normal(size=(20, 3))

    def misfit(R, share=0.0):
        off = rotation_from_vector(meant + share).mT @ R
        return float(np.median(np.linalg.norm(rotation_vectors_of(off), axis=1)))

    told = misread(meant, how)
    off = misfit(rotation_from_vector(told))
    assert how in meant_turns(off, misfit, told)
    assert meant_turns(off, lambda R: misfit(R, off), told) == []


@pytest.mark.parametrize("how", slow_rest(MISREAD, 1))
def test_a_hand_eye_calibration_says_whose_turns_were_taken_for_others(how):
    data = flange_dataset(*poses(0))
    flanges, values = np.array(data.flanges), np.array(data.observations.values)
    flanges[:, 0, 3:] = misread(flanges[:, 0, 3:], how)
    values[:, 3:] = misread(values[:, 3:], how)
    seen = replace(data.observations, values=values)
    for told, words in (
        (replace(data, flanges=flanges), f"in turns of the flange {how}"),
        (replace(data, observations=seen), f"in the turns that 'camera' tells {how}"),
        (replace(data, flanges=flanges, observations=seen), f"in turns of both {how}"),
    ):
        with pytest.raises(DataError, match=re.escape(words)):
            calibrate_tree(told)


@pytest.mark.parametrize("seed", range(3))
def test_quaternions_of_a_flange_that_points_down_are_not_taken_for_inverted_poses(seed):
    """Shifted by one, (1, 0, 0, 0) and its neighbours turn almost the other way round."""
    rng = np.random.default_rng(seed)
    X = transform(rotation_from_vector(0.5 * rng.normal(size=3)), 0.05 * rng.normal(size=3))
    Z = transform(rotation_from_vector(np.array([1.2, -1.2, 1.0])), np.array([1.4, 0.3, 0.7]))
    w, p = 0.3 * rng.normal(size=(20, 3)), 0.07 * rng.normal(size=(20, 3))
    down = transform(rotation_from_vector(np.array([np.pi, 0.0, 0.0])), np.array([0.45, 0.0, 0.4]))
    F = down @ transform(rotation_from_vector(w), p)
    data = flange_dataset(F, inverse(Z) @ F @ X)
    flanges = np.array(data.flanges)
    flanges[:, 0, 3:] = misread(flanges[:, 0, 3:], MISREAD[0])
    with pytest.raises(DataError, match=re.escape(f"in turns of the flange {MISREAD[0]}")):
        calibrate_tree(replace(data, flanges=flanges))


def test_a_flange_whose_angles_were_taken_for_rotation_vectors_is_told_before_corners():
    _, data = recorded(np.random.default_rng(0))
    flanges = np.array(data.flanges)
    flanges[:, 0, 3:] = misread(flanges[:, 0, 3:], MISREAD[2])
    with pytest.raises(DataError, match=re.escape(f"in turns of the flange {MISREAD[2]}")):
        calibrate_tree(replace(data, flanges=flanges))


@pytest.mark.parametrize("how", slow_rest(MISREAD, 1))
def test_turns_of_a_tracker_that_were_taken_for_others_are_told_by_the_places_it_tells(how):
    data = before_poses(5)
    values = np.array(data.observations.values)
    values[:, 3:] = misread(values[:, 3:], how)
    with pytest.raises(DataError, match=f"'tracker' .* contradict its places .*{re.escape(how)}"):
        calibrate_tree(replace(data, observations=replace(data.observations, values=values)))


def before_poses(seed):
    """An arm of four joints before a tracker that tells turns, too."""
    rng, names = np.random.default_rng(seed), ["j1", "j2", "j3", "j4"]
    chain, frames = serial(rng, names, "world", 0.5)
    markers, attached = tags(rng, "hand", "j4", 1)
    sensors = [SensorInfo("tracker", "poses")]
    tree = assembled(chain, frames, markers, attached, sensors, [np.eye(4)], {})
    q, sigma = rng.uniform(-1.2, 1.2, size=(40, 4)), {"points": 2e-4, "turn": 2e-3}
    return observed(tree, chain, markers, sensors, q, rng, sigma=sigma, joint_sigma=1e-3)
